"""The drive for identification, and what range and rates a drive covers."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from dehyst.models.drive_design.coverage import measure_coverage
from dehyst.models.drive_design.excitation import design
from dehyst.models.errors import BadInput, BadRecording
from dehyst.models.recording import Recording


@settings(max_examples=15)
@given(
    st.floats(-50, 80), st.floats(5, 100), st.floats(1, 40), st.integers(2, 5), st.integers(0, 99)
)
@example(low=-1.0, span=5.0, band=1.5, sines=5, seed=43)
def test_drive_keeps_its_promises(
    low: float, span: float, band: float, sines: int, seed: int
) -> None:
    high, seconds = low + span, 30.0 / band + 10.0
    e = design(low, high, band, seconds, 1000.0, sines=sines, seed=seed)
    assert np.all(np.diff(e.t_s) > 0)
    assert low <= e.u.min()
    assert e.u.max() <= high
    assert np.ptp(e.u) > 0.9 * span
    start = min(max(0.0, low), high)
    assert e.u[0] == e.u[-1] == start
    assert max(e.frequencies_hz) <= band * (1 + 1e-9)
    assert sum(e.amplitudes) == pytest.approx(0.5 * span)
    rate = np.abs(np.diff(e.u)) * 1000
    assert rate.max() == pytest.approx(e.rate_max)
    bend = np.abs(np.diff(e.u, 2)) * 1e6  # gentle: the rate never jumps
    swing = sum(
        a * (2 * np.pi * f) ** 2 for a, f in zip(e.amplitudes, e.frequencies_hz, strict=True)
    )
    lead = abs(start - low) * (np.pi / max(e.lead_s, 1e-9)) ** 2 if e.lead_s else 0.0
    assert bend.max() <= 1.2 * (swing + lead) + 1e-6


def test_drive_covers_range_and_rates_evenly() -> None:
    e = design(0, 10, 10, 10, 1000)
    covered = measure_coverage([Recording(e.t_s, e.u)])
    assert covered.covered > 0.9
    assert covered.missing == ()
    assert covered.missing_rate == ()
    speeds = np.histogram(np.abs(np.diff(e.u)) * 1000, bins=5, range=(0, e.rate_max))[0]
    assert speeds.min() > 0.02 * speeds.sum()


@pytest.mark.parametrize(
    ("low", "high", "band", "duration", "sampling"),
    [(0, 100, 5, 20, 200), (0, 10, 20, 10, 1000), (-20, 130, 1, 60, 100), (0, 75, 2, 30, 100)],
)
def test_a_designed_drive_passes_the_check(
    low: float, high: float, band: float, duration: float, sampling: float
) -> None:
    drive = design(low, high, band, duration, sampling)
    found = measure_coverage([Recording(drive.t_s, drive.u)])
    assert (found.missing, found.missing_rate) == ((), ())


def test_slew_limit_is_kept() -> None:
    free, slow = design(0, 10, 10, 20, 1000), design(0, 10, 10, 20, 1000, slew_per_s=80.0)
    assert slow.rate_max <= 80.0 < free.rate_max


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"high": -1.0}, "range"),
        ({"band_hz": 0.0}, "band"),
        ({"duration_s": 0.05}, "too short"),
        ({"sample_hz": 50.0}, "sampling rate"),
        ({"sines": 1}, "sines"),
        ({"slew_per_s": 0.1}, "too slow"),
        ({"duration_s": 1e9}, "too many"),
    ],
)
def test_contradictions_name_the_argument(change: dict[str, float], says: str) -> None:
    arguments = {"low": 0.0, "high": 10.0, "band_hz": 10.0, "duration_s": 10.0, "sample_hz": 1000.0}
    with pytest.raises(BadInput, match=says):
        design(**(arguments | change))


def test_one_sine_does_not_show_rate_dependence() -> None:
    t = np.arange(10_000) * 1e-3
    sine = Recording(t, 5 - 5 * np.cos(2 * np.pi * t))
    covered = measure_coverage([sine])
    assert "are correlated" in covered.missing_rate[0]
    assert any("loops of these sizes" in text for text in covered.missing)
    assert covered.cycles == pytest.approx(10, rel=0.01)
    with pytest.raises(BadRecording, match="does not move"):
        measure_coverage([Recording(t, np.ones(t.size))])
