"""What the 95 % interval of a model refers to, and whether it is too narrow or too wide."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from tests.rigs.outside import noisy, stage, times

from dehyst.models.identify import Identification, Options, identify
from dehyst.models.identify.band import is_rival, is_stated
from dehyst.models.identify.equations import Equations, Params, Shape, assemble
from dehyst.models.identify.tuning import TUNING
from dehyst.models.identify.uncertainty import leave_stretches_out
from dehyst.models.identify.validation import validate
from dehyst.models.model import Fit
from dehyst.models.recording import Recording

T = times(4.0)


def recorded(u: np.ndarray, seed: int) -> Recording:
    return Recording(T, u, noisy(stage(u), seed), name="drive.csv")


def two_sines(slow_hz: float, fast_hz: float) -> np.ndarray:
    slow, fast = (np.cos(2 * np.pi * hz * T) for hz in (slow_hz, fast_hz))
    return np.asarray(50 - 30 * slow - 20 * fast)


@cache
def found() -> Identification:
    return identify([recorded(two_sines(2.0, 5.4), 1)])


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


@pytest.mark.parametrize(("noises", "stated"), [(0.15, True), (1.0, False), (5.0, False)])
def test_an_interval_is_stated_where_the_model_leaves_mostly_noise(
    noises: float, stated: bool
) -> None:
    """A hum that the model lacks, as an rms in noises: with 1.0, half of the error is noise."""
    one = recorded(two_sines(2.0, 5.4), 1)
    assert one.displacement is not None
    noise = found().model.fit.noise_rms or 0.0
    hum = noises * noise * np.sqrt(2.0) * np.sin(2 * np.pi * 23.7 * T)
    hummed = identify([replace(one, displacement=one.displacement + hum)], Options(rate=False))
    assert hummed.model.fit.leaves_mostly_noise == stated
    assert (hummed.model.fit.band is not None) == stated
    judged = validate(hummed.model, other())
    assert judged.has_interval == stated
    assert (judged.unstated == 1.0) == (not stated)


@pytest.mark.parametrize(
    ("figures", "mostly"),
    [((1.0, 1.06, 1.0, None), True), ((1.0, 1.08, 1.0, None), False), ((3.0, 3.0, 1.0, 1.0), True)],
)
def test_noise_makes_up_seven_eighths_of_the_claimed_error(
    figures: tuple[float | None, ...], mostly: bool
) -> None:
    rms, holdout, noise, steady = figures
    assert Fit(rms, holdout, noise, steady_rms=steady).leaves_mostly_noise == mostly
    assert not Fit(rms, holdout, None, steady_rms=steady).leaves_mostly_noise


@pytest.mark.parametrize(
    ("band", "stroke", "stated"),
    [(3.9, 16.0, True), (4.0, 16.0, False), (3.9, 15.5, False), (0.1, 16.0, True)],
)
def test_an_interval_far_beyond_the_noise_or_near_the_stroke_is_not_stated(
    band: float, stroke: float, stated: bool
) -> None:
    """A recording that drifts adds its drift to the interval, not to the claim."""
    assert is_stated(Fit(3.0, 3.0, 1.0, steady_rms=1.05), band, stroke) == stated


def test_a_structure_that_could_not_be_taken_does_not_widen_it() -> None:
    best, *others = found().tried
    alike = replace(best, shape=others[0].shape, invertible=True, superseded=False)
    assert is_rival(best, alike)
    assert not is_rival(best, replace(alike, invertible=False))
    assert not is_rival(best, replace(alike, superseded=True))


@pytest.mark.parametrize(("count", "widened"), [(1, TUNING.near), (2, 1.0)])
def test_misfit_counts_by_how_it_is_distributed(
    count: int, widened: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A hum that the model lacks, on for a tenth of the time: 95 % of its values are within 3 times
    its rms. A single recording widens the interval to allow for another waveform, two do not."""
    monkeypatch.setattr("dehyst.models.identify.identification.is_stated", lambda *figures: True)
    hum = np.where(T % 0.4 < 0.04, 0.2 * np.sin(2 * np.pi * 23.7 * T), 0.0)
    given = [recorded(two_sines(2.0, 5.4), 0), recorded(two_sines(3.1, 4.6), 1)][:count]
    hummed = [replace(r, displacement=np.add(r.displacement, hum)) for r in given]
    band = identify(hummed, Options(rate=False)).model.fit.band
    assert band == pytest.approx(widened * np.quantile(np.abs(hum), 0.95), rel=0.1)


def test_errors_without_a_stretch_are_those_of_a_fit_without_it() -> None:
    """Compared with least squares on the other rows, for equations that are linear."""
    rng = np.random.default_rng(0)
    rows, count = 30 * 40, TUNING.stretches
    d, truth = rng.uniform(0.0, 1.0, (rows, 3)), np.array([1.0, 0.5, 2.0])
    y = d @ truth + np.repeat(rng.normal(size=count), rows // count) + 0.1
    none, lot = np.empty((rows, 0)), np.zeros(rows, np.int64)
    equations = [Equations(d, none, y, lot, lot.astype(np.int8), np.zeros(rows))]
    x = np.column_stack([d, np.ones(rows)])
    fitted = np.linalg.lstsq(x, y, rcond=None)[0]
    shape, params = Shape(False, (0,)), Params(fitted[:3], fitted[3:], np.zeros(0))
    free, whole = np.ones(4, dtype=bool), assemble(equations, shape, params)
    found = leave_stretches_out(equations, shape, params, free, whole)
    for at in np.split(np.arange(rows), count):
        rest = np.setdiff1d(np.arange(rows), at)
        without = np.linalg.lstsq(x[rest], y[rest], rcond=None)[0]
        assert found.left_out[at] == pytest.approx(y[at] - x[at] @ without, abs=1e-9)
    assert found.by_noise == pytest.approx(np.linalg.inv(x.T @ x), rel=1e-9)
