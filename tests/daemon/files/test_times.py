"""The times of a file are cut where the clock went back, and rebuilt where they are rounded."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dehyst.daemon.files.times import doubt_seconds, repair_times
from dehyst.models.errors import BadRecording


def settled(t_s: np.ndarray, same: bool = False):
    return repair_times("a.csv", t_s, lambda row: same, lambda row: f"line {row + 2}")


@settings(max_examples=30)
@given(st.lists(st.integers(6, 40), min_size=1, max_size=5), st.floats(1e-5, 10.0))
def test_each_stretch_of_a_clock_that_went_back_stays_as_it_is(
    sizes: list[int], step: float
) -> None:
    # of six rows or more each: clocks that go back more often are refused as unsorted
    stretches = [step * np.arange(size) for size in sizes]
    times = settled(np.concatenate(stretches))
    assert [end - begin for begin, end in times.parts] == sizes
    for (begin, end), stretch in zip(times.parts, stretches, strict=True):
        np.testing.assert_array_equal(times.t_s[begin:end], stretch)
    assert len(times.said) == (len(sizes) > 1)


@settings(max_examples=30)
@given(st.floats(5e-4, 4e-3), st.floats(0.0, 1e6), st.sampled_from([np.round, np.floor]))
def test_rounded_times_of_an_even_rate_come_back(step: float, start: float, rounding) -> None:
    true = start + step * np.arange(2000)
    rounded = rounding(true / 0.01) * 0.01
    times = settled(rounded)
    assert np.all(np.diff(times.t_s) > 0.0)
    np.testing.assert_allclose(np.diff(times.t_s), step, rtol=0.02)
    assert np.max(np.abs(times.t_s - true)) < 0.011
    assert "rounded to 0.01 s" in times.said[0]


def test_rounded_times_with_a_pause_are_not_made_even() -> None:
    true = np.concatenate([0.003 * np.arange(200), 60 + 0.003 * np.arange(200)])
    with pytest.raises(BadRecording, match=r"line 3: the time does not increase.*--rate HZ"):
        settled(np.round(true, 2))


def test_one_time_in_all_rows_asks_for_the_rate() -> None:
    """As LabVIEW writes it where a loop writes one sample at a time."""
    with pytest.raises(BadRecording, match=r"the time is 0 in every row.*add --rate HZ"):
        settled(np.zeros(50))


def test_a_row_that_is_written_twice_is_left_out_once() -> None:
    t_s = np.array([0.0, 1.0, 1.0, 2.0, 3.0])
    times = settled(t_s, same=True)
    assert times.t_s.tolist() == [0, 1, 2, 3]
    assert times.parts == [(0, 4)]
    assert times.said == ["1 row that is written twice left out"]
    with pytest.raises(BadRecording, match="line 4: the time does not increase"):
        settled(t_s, same=False)


def test_a_column_that_is_no_time_is_not_cut_into_hundreds_of_parts() -> None:
    with pytest.raises(BadRecording, match="is this the column of the time"):
        settled(np.sin(np.arange(3000.0)))


@pytest.mark.parametrize(("step", "outcome"), [(0.01, ""), (0.5, "note"), (1.0, "note"), (5.0, "")])
def test_milliseconds_are_noticed_and_slow_recordings_taken(step: float, outcome: str) -> None:
    t_s = step * np.arange(4000)
    assert doubt_seconds("a.csv", t_s, said_by_user=True) == ""
    if step > 1.0:
        with pytest.raises(BadRecording, match="--time-unit ms"):
            doubt_seconds("a.csv", t_s, said_by_user=False)
    else:
        said = doubt_seconds("a.csv", t_s, said_by_user=False)
        assert bool(said) == (outcome == "note")
