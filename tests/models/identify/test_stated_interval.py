"""What the 95 % interval of a model is stated of, and whether it is too narrow or too wide."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from tests.rigs.outside import noisy, stage, times

from dehyst.models.identify import Identification, identify
from dehyst.models.identify.band import is_rival
from dehyst.models.identify.validation import validate
from dehyst.models.recording import Recording

T = times(4.0)


def recorded(u: np.ndarray, seed: int) -> Recording:
    return Recording(T, u, noisy(stage(u), seed), name="drive.csv")


@cache
def found() -> Identification:
    u = 50 - 30 * np.cos(2 * np.pi * 2.0 * T) - 20 * np.cos(2 * np.pi * 5.4 * T)
    return identify([recorded(u, 1)])


def other() -> Recording:
    return recorded(50 + 40 * np.sin(2 * np.pi * 3.1 * T) * np.sin(2 * np.pi * (0.1 * T + 0.1)), 2)


def test_nothing_is_stated_of_a_hold_that_no_recording_had() -> None:
    u = np.where(T < 2.0, other().drive, 60.0)
    stated = validate(found().model, recorded(u, 3))
    assert 0.4 < stated.unstated < 0.7
    assert stated.within is not None
    still = validate(found().model, recorded(np.where(T < 0.4, other().drive, 60.0), 3))
    assert still.within is None
    assert still.interval_is == ""


def test_a_drive_of_other_rates_within_what_was_driven_is_judged() -> None:
    stated = validate(found().model, other())
    assert stated.unstated < 0.1
    assert stated.within is not None
    assert stated.interval_is == ""


@pytest.mark.parametrize(("times_band", "says"), [(0.0, "too narrow"), (1e3, "too wide")])
def test_both_sides_are_judged(times_band: float, says: str) -> None:
    model = found().model
    one = other()
    assert one.displacement is not None
    touched = replace(one, displacement=one.displacement + 0.3 * np.sin(2 * np.pi * 1.3 * T))
    band = times_band * (model.fit.band or 0.0)
    assert validate(replace(model, fit=replace(model.fit, band=band)), touched).interval_is == says


def test_a_structure_that_could_not_be_taken_does_not_widen_it() -> None:
    best, *others = found().tried
    alike = replace(best, shape=others[0].shape, invertible=True, superseded=False)
    assert is_rival(best, alike)
    assert not is_rival(best, replace(alike, invertible=False))
    assert not is_rival(best, replace(alike, superseded=True))
