"""Very long recordings: time and memory are bounded, and the model fits the whole recording."""

import numpy as np
import pytest

from dehyst.models.hysteresis.forward import simulate_hysteresis
from dehyst.models.identify import Options, identify
from dehyst.models.identify.data.stretches import take_stretches
from dehyst.models.model import Hysteresis
from dehyst.models.recording import Recording

T = 1e-3
STAGE = Hysteresis(
    r=np.array([0.0, 0.4, 1.2]), b=np.array([0.9, 0.1, 0.15]), c=np.array([0.0, 1.0])
)


def long_one(n: int, hz: float, noise: float = 0.01) -> Recording:
    t = np.arange(n) * T
    u = 5 - 3.5 * np.cos(2 * np.pi * hz * t) - 1.5 * np.cos(2 * np.pi * 2.7 * hz * t)
    y = simulate_hysteresis(STAGE, u, T) + noise * np.random.default_rng(4).standard_normal(n)
    return Recording(t, u, y, channels={"temp_c": 20 + t}, name="long.csv")


@pytest.mark.parametrize(("hz", "count"), [(2.0, 4), (0.13, 2), (0.03, 1)])
def test_stretches_run_through_the_range_and_begin_at_the_start(hz: float, count: int) -> None:
    one = long_one(60_000, hz)
    taken = take_stretches(one, 20_000)
    assert taken.rows is not None
    assert taken.rows.size == 20_000
    parts = np.split(taken.rows, np.flatnonzero(np.diff(taken.rows) > 1) + 1)
    assert len(parts) == count
    assert parts[0][0] == 0
    for part in parts:
        assert np.ptp(one.drive[part]) >= 0.9 * np.ptp(one.drive)
    assert taken.recording.displacement is not None
    assert one.displacement is not None
    np.testing.assert_array_equal(taken.recording.displacement, one.displacement[taken.rows])
    np.testing.assert_array_equal(taken.recording.channels["temp_c"], 20 + taken.recording.t_s)
    assert "long.csv: 20000 of 60000 rows were used" in taken.note


def test_short_or_slow_recordings_are_taken_whole() -> None:
    for one, most in ((long_one(5000, 2.0), 5000), (long_one(60_000, 0.008), 20_000)):
        taken = take_stretches(one, most)
        assert taken.recording is one
        assert taken.note == ""
        values = np.arange(3.0)
        assert taken.spread(values, np.nan) is values


def test_the_model_of_stretches_predicts_the_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    from dehyst.models.identify.data import stretches

    monkeypatch.setattr(stretches.take_stretches, "__defaults__", (20_000,))
    one = long_one(60_000, 1.0)
    found = identify([one], Options(rate=False))
    assert found.residuals[0].shape == found.used[0].shape == (60_000,)
    fitted = ~np.isnan(found.residuals[0])
    assert np.count_nonzero(fitted) <= 20_000
    assert found.used[0].sum() > 10_000
    assert not found.used[0][~fitted].any()
    assert any("20000 of 60000 rows were used" in note for note in found.notes)
    assert one.displacement is not None
    left = one.displacement - simulate_hysteresis(found.model.hysteresis, one.drive, T)
    assert np.std(left) < 1.05 * 0.01
    for part in np.array_split(left, 6):
        assert np.std(part) < 1.1 * 0.01


def test_behind_a_long_gap_the_memory_is_unknown_though_the_start_was_at_rest() -> None:
    """The drive turns unseen in the gap: rows after it count once it has run through its range."""
    whole = long_one(20_000, 1.0)
    assert whole.displacement is not None
    kept = np.r_[0:7000, 12_345:20_000]
    gap = Recording(whole.t_s[kept], whole.drive[kept], whole.displacement[kept], name="gap.csv")
    found = identify([gap], Options(rate=False))
    assert found.used[0][:6900].all()
    assert not found.used[0][7000:7100].any()
    left = whole.displacement - simulate_hysteresis(found.model.hysteresis, whole.drive, T)
    assert np.std(left) < 1.05 * 0.01
