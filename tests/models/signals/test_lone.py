"""A reading that a recorder wrote wrongly is found, and nothing that a stage does is."""

import numpy as np
import pytest
from tests.rigs.outside import plays

from dehyst.models.recording import Floats
from dehyst.models.signals.lone import lone_readings

T = np.arange(5000) / 1000.0
NOISE_UM = 0.008
SINES = 40.0 + 25.0 * np.sin(2 * np.pi * 1.7 * T) + 10.0 * np.sin(2 * np.pi * 11.0 * T)
DRIVES = {
    "sines": SINES,
    "triangle": 80.0 * np.abs(2 * ((3.0 * T) % 1.0) - 1),
    "steps": 10.0 * np.round(SINES / 10.0),
    "pulses of one row": np.where(np.arange(T.size) % 700 == 350, 60.0, 20.0),
}


def reading(u: Floats, seed: int) -> Floats:
    r = np.linspace(0.0, 30.0, 8)
    y = plays(u, r, 0.1 * np.exp(-r / 10.0) / np.exp(-r / 10.0).sum())
    return y + NOISE_UM * np.random.default_rng(seed).standard_normal(y.size)


@pytest.mark.parametrize("drive", DRIVES)
@pytest.mark.parametrize("seed", range(3))
def test_nothing_that_a_stage_does_is_a_lone_reading(drive: str, seed: int) -> None:
    y = reading(DRIVES[drive], seed)
    assert not lone_readings(y, DRIVES[drive]).any()
    assert not lone_readings(np.round(y, 1), DRIVES[drive]).any()


@pytest.mark.parametrize("frequency_hz", [180.0, 333.0, 497.0])
def test_a_ringing_mode_is_no_lone_reading(frequency_hz: float) -> None:
    grown = (T % 1.0) / 0.02
    ring = 0.3 * np.sin(2 * np.pi * frequency_hz * T) * grown * np.exp(1.0 - grown)
    assert not lone_readings(reading(SINES, 0) + ring, SINES).any()


@pytest.mark.parametrize("rows", [5.3, 8.0, 11.5])
@pytest.mark.parametrize("damping", [0.004, 0.05])
def test_the_crests_of_a_mode_that_steps_excite_are_no_lone_readings(
    rows: float, damping: float
) -> None:
    """Its first crest is the highest, and stands above the noise as no other row does."""
    step = np.arange(T.size) % 400
    fall = np.exp(-2 * np.pi * damping * step / rows) * np.where(np.arange(T.size) < 400, 0, 1)
    u = np.where((np.arange(T.size) // 400) % 2 > 0, 60.0, 20.0)
    for phase in np.linspace(0.0, 1.0, 20):
        ring = 3.0 * fall * np.cos(2 * np.pi * ((step + phase) / rows))
        assert not lone_readings(reading(u, 0) + ring, u).any()


@pytest.mark.parametrize("drive", ["sines", "triangle", "steps"])
@pytest.mark.parametrize(("count", "size_um"), [(1, 1.0), (3, 0.3), (12, 2.0), (4, -40.0)])
def test_every_lone_reading_is_found_and_no_other(drive: str, count: int, size_um: float) -> None:
    y, rng = reading(DRIVES[drive], 1), np.random.default_rng(count)
    at = 10 + 40 * rng.choice(120, count, replace=False)
    y[at] += size_um
    found = set(np.flatnonzero(lone_readings(y, DRIVES[drive])).tolist())
    beside = np.abs(np.diff(DRIVES[drive], prepend=0.0)) > 5.0  # an edge may explain it there
    judged = {i for i in at.tolist() if not beside[i - 3 : i + 4].any()}
    assert judged <= found <= set(at.tolist())
    assert judged


def test_missing_readings_do_not_hide_one() -> None:
    y = reading(SINES, 2)
    y[[700, 701, 900]] = np.nan
    y[1203] += 1.0
    assert np.flatnonzero(lone_readings(y, SINES)).tolist() == [1203]


def test_what_is_frequent_is_what_the_gauge_does() -> None:
    y = reading(SINES, 3)
    y[10:-10:20] += 1.0
    assert not lone_readings(y, SINES).any()
