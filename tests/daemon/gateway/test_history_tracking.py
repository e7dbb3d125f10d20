"""History against a plain list; tracking statistics against numpy on the same samples."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from dehyst.daemon.client.tracking import Tracking
from dehyst.daemon.gateway.history import TelemetryHistory, runs
from dehyst.daemon.rings.records import TELEMETRY, Flag, State


def numbered(seq: list[int]) -> np.ndarray:
    out = np.zeros(len(seq), TELEMETRY)
    out["seq"], out["volts"] = seq, 0.5 * np.array(seq, float)
    return out


@given(
    st.integers(1, 40),
    st.lists(st.tuples(st.integers(0, 5), st.integers(0, 60)), max_size=12),
    st.integers(0, 300),
    st.integers(0, 80),
)
def test_history_gives_what_a_list_would(
    capacity: int, adds: list[tuple[int, int]], first: int, length: int
) -> None:
    history, kept, seq = TelemetryHistory(capacity), [], 0
    for skipped, count in adds:
        seq += skipped
        new = list(range(seq, seq + count))
        seq += count
        history.add(numbered(new))
        kept += new
    kept = [n for n in kept if n > kept[-1] - capacity]
    expected = [n for n in kept if first <= n < first + length]
    got = history.get(first, first + length)
    assert got["seq"].tolist() == expected
    assert got["volts"].tolist() == [0.5 * n for n in expected]


def test_a_new_run_forgets() -> None:
    history = TelemetryHistory(10)
    history.add(numbered([1, 2, 3]))
    history.restart(2)
    assert history.get(0, 100).size == 0
    history.add(numbered([0, 1]))
    assert history.get(0, 100)["seq"].tolist() == [0, 1]


@given(st.sets(st.integers(0, 100)), st.integers(1, 20))
def test_runs_are_without_gaps_and_lose_nothing(numbers: set[int], longest: int) -> None:
    pieces = runs(numbered(sorted(numbers)), longest)
    assert [n for p in pieces for n in p["seq"].tolist()] == sorted(numbers)
    for piece in pieces:
        assert 1 <= piece.size <= longest
        assert np.all(np.diff(piece["seq"]) == 1)


@given(st.integers(1, 17), st.integers(0, 5))
def test_tracking_counts_the_trajectory_alone(batch: int, extra: int) -> None:
    rng = np.random.default_rng(5)
    samples = numbered(list(range(100 + extra)))
    samples["state"] = State.RUNNING
    samples["target"], samples["measured"] = rng.normal(size=(2, samples.size))
    samples["flags"][10:20] = Flag.APPROACH  # another set-point before it, the trajectory after it
    samples["flags"][30:33] = Flag.UNREACHABLE | Flag.SLEW
    samples["measured"][40] = np.nan
    samples["flags"][41] = Flag.SENSOR_INVALID
    tracking = Tracking(first_seq=5, expected=80)
    for start in range(0, samples.size, batch):
        tracking.add(samples[start : start + batch])
    part = samples[20:100]
    good = np.isfinite(part["measured"]) & (part["flags"] & Flag.SENSOR_INVALID == 0)
    error = (part["measured"] - part["target"])[good]
    assert tracking.complete
    assert tracking.samples == 80
    assert tracking.invalid == 2
    assert (tracking.unreachable, tracking.slew_limited) == (3, 3)
    assert np.isclose(tracking.rms_error, np.sqrt(np.mean(error**2)), rtol=1e-12)
    assert tracking.max_error == np.max(np.abs(error))
