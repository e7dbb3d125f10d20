"""Columns that cannot be drive and displacement of one stage are refused in one sentence."""

from types import SimpleNamespace

import numpy as np
import pytest

from dehyst.models.errors import BadRecording
from dehyst.models.hysteresis.forward import simulate_hysteresis
from dehyst.models.identify import describe, identify
from dehyst.models.identify.plausibility.recordings import require_better_than_a_line
from dehyst.models.model import Hysteresis
from dehyst.models.recording import Recording

T = 1e-3
STAGE = Hysteresis(r=[0.0, 0.4, 1.5], b=[0.8, 0.3, 0.3], c=[2.0, 1.0])
t = np.arange(5000) * T
u = 5 - 2 * np.cos(2 * np.pi * 10 * t) - 3 * np.cos(2 * np.pi * 5 * t)
y = simulate_hysteresis(STAGE, u, T) + 0.01 * np.random.default_rng(0).standard_normal(t.size)


def test_swapped_columns_are_refused() -> None:
    with pytest.raises(BadRecording, match="columns swapped") as error:
        identify([Recording(t, y, u)])
    assert "\n" not in str(error.value)


def test_a_loop_that_leads_is_no_swap_where_the_reading_has_the_noise() -> None:
    """Springs that lead (elasto-slide elements and a linear one in parallel) reverse the loop."""
    leading = 2.0 * u - y
    found = identify([Recording(t, u, leading)])
    assert found.model.fit.rms < 0.03
    with pytest.raises(BadRecording, match="columns swapped"):
        identify(
            [Recording(t, u + 0.01 * np.random.default_rng(2).standard_normal(t.size), leading)]
        )


def test_recordings_of_different_stages() -> None:
    """The message has a figure for each recording, and names the one that does not belong."""
    v = 4 - 4 * np.cos(2 * np.pi * 3 * t)
    other = 1.6 * simulate_hysteresis(STAGE, v, T) + 0.01 * np.random.default_rng(
        1
    ).standard_normal(t.size)
    recordings = [Recording(t, u, y, name="a.csv"), Recording(t, v, other, name="b.csv")]
    with pytest.raises(BadRecording, match="does not match the others") as error:
        identify(recordings)
    assert all(name in str(error.value) for name in ("a.csv", "b.csv", "alone"))


def test_a_recording_that_runs_the_other_way_is_named_with_figures() -> None:
    v = 4 - 4 * np.cos(2 * np.pi * 3 * t)
    right = simulate_hysteresis(STAGE, v, T)
    recordings = [
        Recording(t, u, y, name="a.csv"),
        Recording(t, v, -1.7 * right, name="b.csv"),
        Recording(t, v, right, name="c.csv"),
    ]
    says = r"^b\.csv does not match the others.*a\.csv [0-9.]+ um/V, b\.csv -[0-9.]+ um/V, c"
    with pytest.raises(BadRecording, match=says) as error:
        identify(recordings)
    assert "\n" not in str(error.value)


def test_a_recording_that_is_a_little_different_is_reported_and_not_refused() -> None:
    v = 4 - 4 * np.cos(2 * np.pi * 3 * t)
    noise = 0.05 * np.random.default_rng(4).standard_normal((2, t.size))
    alike = simulate_hysteresis(STAGE, v, T) + noise[0]
    for gain, reported in ((1.0, 0), (1.08, 1)):
        both = [Recording(t, u, y + noise[1]), Recording(t, v, gain * alike, name="b.csv")]
        notes = identify(both).notes
        assert sum("differs from the others" in note for note in notes) == reported


def test_a_recording_none_of_whose_rows_counts_is_refused_by_its_name() -> None:
    both = [SimpleNamespace(u=u, y=y, name=name) for name in ("a.csv", "b.csv")]
    counted, none = np.ones(t.size, bool), np.zeros(t.size, bool)
    setup = SimpleNamespace(rows=both)
    with pytest.raises(BadRecording, match=r"b\.csv: none of its rows can be used") as error:
        require_better_than_a_line(setup, [0.01 * y, y], [counted, none])  # type: ignore[arg-type]
    assert "\n" not in str(error.value)
    require_better_than_a_line(setup, [0.01 * y, 0.01 * y], [counted, counted])  # type: ignore[arg-type]


@pytest.mark.parametrize("every", [2, 3])
def test_a_slow_sensor_is_used_for_what_it_is(every: int) -> None:
    slow = np.full(y.size, np.nan)
    slow[::every] = y[::every]
    found = identify([Recording(t, u, slow)])
    assert found.noise_rms == pytest.approx(0.01, rel=0.15)
    v = 3.5 - 3.5 * np.cos(2 * np.pi * 2 * t)
    error = simulate_hysteresis(found.model.hysteresis, v, T) - simulate_hysteresis(STAGE, v, T)
    assert np.sqrt(np.mean(error**2)) < 0.01


def test_the_first_line_says_what_the_stage_is() -> None:
    """Stroke and hysteresis by hand: the major loop of three operators over 0 to 7.56 V."""
    found = describe(identify([Recording(t, u, y)]).model)
    top = float(u.max())
    stroke = 1.4 * top - 2 * (0.3 * 0.4 + 0.3 * 1.5)
    assert found.stroke == pytest.approx(stroke, rel=0.01)
    assert found.gain == pytest.approx(stroke / top, rel=0.01)
    assert found.hysteresis == pytest.approx(2 * (0.3 * 0.4 + 0.3 * 1.5) / stroke, rel=0.05)
    assert found.offset == pytest.approx(2.0, abs=0.02)
    assert found.sentence().endswith("um")
