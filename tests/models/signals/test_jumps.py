"""Jumps along the direction of the drive are counted as stick-slip; those of hum, outliers, a drive
in steps, and a polled or coarse reading are not."""

import numpy as np
import pytest
from tests.rigs.outside import ordinary, stage, stick_slip, times

from dehyst.models.recording import Floats
from dehyst.models.signals.jumps import measure_share_in_jumps

T_S = times(8.0)
SINE = 100.0 * np.sin(2 * np.pi * 0.5 * T_S)
GOOD = stage(SINE)
LEVELS = np.repeat(np.random.default_rng(1).uniform(-100.0, 100.0, 20), 200)
HOLDS = np.convolve(LEVELS, [0.1, 0.8, 0.1], "same")  # edges of three rows
LATER = np.convolve(LEVELS, [0.0, 0.2, 0.8], "same")  # what the stage has got when it is read
RNG = np.random.default_rng(3)
NOISE = 1e-3 * np.ptp(GOOD) * RNG.standard_normal(T_S.size)


@pytest.mark.parametrize("force", [16.0, 24.0, 40.0])
def test_a_stage_that_sticks_and_slips_goes_its_way_in_jumps(force: float) -> None:
    y = stick_slip(SINE, force) + 0.1 * RNG.standard_normal(T_S.size)
    share, count = measure_share_in_jumps(SINE, y)
    assert share == pytest.approx(1.0, abs=0.1)
    slips = np.count_nonzero(np.diff(stick_slip(SINE, force)))  # by the definition
    assert count == pytest.approx(slips, abs=2)


def polled(y: Floats, rows: int) -> Floats:
    """A gauge that is read once in so many rows, and held."""
    return np.repeat(y[::rows], rows)[: y.size]


ORDINARY = {
    "the stage itself": (SINE, GOOD + NOISE),
    "hum": (SINE, GOOD + NOISE + 0.05 * np.ptp(GOOD) * np.sin(2 * np.pi * 50.0 * T_S + 0.3)),
    "outliers": (SINE, GOOD + NOISE + 0.3 * np.ptp(GOOD) * (RNG.random(T_S.size) < 0.02)),
    "polled": (SINE, polled(GOOD + NOISE, 25)),
    "coarse": (SINE, np.round(GOOD + NOISE, 0)),
    "late": (SINE, np.roll(GOOD, 2) + NOISE),
    "rows lost": (SINE[RNG.random(T_S.size) < 0.3], None),
    "drive in steps": (polled(SINE, 100), stage(polled(SINE, 100)) + NOISE),
    "quick ramps, read late": (HOLDS, stage(LATER) + NOISE),
    "drive and reading held": (polled(SINE, 20), polled(GOOD, 20)),
    "at rest": (np.zeros(T_S.size), NOISE),
}


@pytest.mark.parametrize("kind", ORDINARY)
def test_what_is_no_stick_slip_makes_no_share_of_its_way_in_jumps(kind: str) -> None:
    u, y = ORDINARY[kind]
    y = stage(u) + NOISE[: u.size] if y is None else y
    assert measure_share_in_jumps(u, y)[0] < 0.05


@pytest.mark.parametrize("seed", range(12))
def test_an_ordinary_recording_has_no_jumps(seed: int) -> None:
    one = ordinary(seed)
    assert one.displacement is not None
    assert measure_share_in_jumps(one.drive, one.displacement)[0] < 0.05
