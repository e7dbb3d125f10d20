"""Repeated readings are found in a polled gauge, and in no other signal that stays constant."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dehyst.models.recording import Floats
from dehyst.models.signals.repeats import frozen_readings, repeated_readings

T = np.arange(6000) * 1e-3
SMOOTH = 5.0 + 4.0 * np.sin(2 * np.pi * 0.7 * T) * np.cos(2 * np.pi * 0.13 * T)


def noisy(rms: float, seed: int = 1) -> np.ndarray:
    return SMOOTH + rms * np.random.default_rng(seed).standard_normal(T.size)


@settings(max_examples=60, deadline=None)
@given(
    times=st.integers(2, 60),
    phase=st.integers(0, 59),
    step=st.sampled_from([0.0, 1e-4, 1e-3]),
    seed=st.integers(0, 99),
)
def test_each_reading_of_a_polled_gauge_counts_once(
    times: int, phase: int, step: float, seed: int
) -> None:
    fresh = noisy(5e-3, seed)
    fresh = np.round(fresh / step) * step if step else fresh
    at = np.maximum((np.arange(T.size) + phase) // times * times - phase, 0)
    polled = fresh[at]
    expected = np.r_[False, polled[1:] == polled[:-1]]
    assert np.array_equal(repeated_readings(polled, SMOOTH), expected)
    assert expected.mean() == pytest.approx(1.0 - 1.0 / times, abs=0.1)


def test_a_gauge_of_another_rhythm_is_polled_too() -> None:
    held = noisy(5e-3)[(np.floor(T / 0.0073 + 1e-9) * 7.3).astype(int)]  # 7 or 8 rows each
    assert repeated_readings(held, SMOOTH).mean() == pytest.approx(1.0 - 1.0 / 7.3, abs=0.01)


def test_missing_readings_are_no_repeats() -> None:
    polled = noisy(5e-3)[np.arange(T.size) // 10 * 10]
    polled[::7] = np.nan
    again = repeated_readings(polled, SMOOTH)
    assert not again[::7].any()
    assert np.unique(polled[~again & np.isfinite(polled)]).size == (~again).sum() - 858


@pytest.mark.parametrize(
    "reading",
    [
        noisy(5e-3),
        np.round(noisy(5e-3) / 0.05) * 0.05,  # coarse steps
        np.round(SMOOTH / 0.002) * 0.002,  # steps without noise
        np.round(T * 1.7 / 0.03) * 0.03,  # one slow ramp in steps
        np.round(np.abs(np.mod(T, 2.0) - 1.0) / 0.005) * 0.005,  # triangles in steps
        np.where(T > 1.0, 5.0, SMOOTH),  # a gauge that stopped
        np.full(T.size, 3.0),
        np.full(T.size, np.nan),
        noisy(5e-3)[:60],
        np.floor(T),  # a staircase
        # rests at levels, in steps that are coarser than the noise
        np.repeat(0.05 * np.random.default_rng(2).integers(0, 25, 120), 50),
    ],
    ids=range(11),
)
def test_what_stands_still_for_another_reason_is_left(reading: np.ndarray) -> None:
    assert not repeated_readings(reading, SMOOTH).any()


def test_a_stage_that_stands_with_its_drive_is_read_anew() -> None:
    """Commands that are held for ten rows each, and a reading without noise."""
    held = SMOOTH[np.arange(T.size) // 10 * 10]
    assert not repeated_readings(0.9 * held + 0.01 * held**2, held).any()


@pytest.mark.parametrize(("hold", "times"), [(300, 5), (300, 12), (300, 29), (30, 5), (30, 12)])
def test_a_gauge_that_is_polled_while_the_drive_is_held_counts_each_reading_once(
    hold: int, times: int
) -> None:
    """Most rows belong to rests of the drive, as in a recording of holds; readings are renewed
    there, too."""
    held = SMOOTH[np.arange(T.size) // hold * hold]
    fresh = held + 5e-3 * np.random.default_rng(3).standard_normal(T.size)
    polled = fresh[np.arange(T.size) // times * times]
    expected = np.r_[False, polled[1:] == polled[:-1]]
    again = repeated_readings(polled, held)
    assert again.mean() == pytest.approx(expected.mean(), abs=1e-9)


@pytest.mark.parametrize("fault", ["stuck", "at its limit"])
def test_a_gauge_that_is_stuck_or_at_its_limit_is_found(fault: str) -> None:
    y = noisy(5e-3)
    if fault == "stuck":
        y[2000:2400] = y[2000]
        gone = np.arange(2000, 2400)
    else:
        y = np.minimum(y, 7.0)
        gone = np.flatnonzero(y == 7.0)
    found = frozen_readings(y, 10.0 * SMOOTH)
    assert not np.any(found[np.setdiff1d(np.arange(T.size), gone)])
    assert np.count_nonzero(found) > 0.9 * gone.size


@pytest.mark.parametrize(
    ("kind", "y", "u"),
    [
        ("noise", noisy(5e-3), SMOOTH),
        ("coarse", np.round(noisy(5e-3), 1), SMOOTH),
        ("without noise, with a dead zone", np.maximum(SMOOTH, 4.0), SMOOTH),
        ("drive at rest", np.where(T < 2.0, 5.0, noisy(5e-3)), np.where(T < 2.0, 5.0, SMOOTH)),
        ("polled", np.repeat(noisy(5e-3)[::20], 20), SMOOTH),
    ],
)
def test_what_stays_for_another_reason_is_not_frozen(kind: str, y: Floats, u: Floats) -> None:
    assert not frozen_readings(y, u).any(), kind
