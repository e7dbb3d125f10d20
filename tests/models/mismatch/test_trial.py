"""A model on trial: when it stays, when it has to go; and what counts as a gauge that fails."""

import math

import numpy as np
import pytest

from dehyst.models.hysteresis.forward import simulate_hysteresis
from dehyst.models.mismatch.gauge import find_gauge_fault
from dehyst.models.mismatch.trial import ErrorMeter, Errors, say_proven, why_back
from dehyst.models.model import Fit, Hysteresis, Model, Validity
from dehyst.models.recording import Recording

NOISE = 0.02
REACH = (0.0, 17.0)
RNG = np.random.default_rng(3)


def stage(gain: float = 1.0) -> Model:
    h = Hysteresis(
        r=np.array([0.0, 10.0, 30.0]), b=np.array([0.8, 0.1, 0.1]), c=np.array([0.0, 0.11 * gain])
    )
    return Model(h, Validity(0.0, 150.0), fit=Fit(rms=NOISE, holdout_rms=NOISE, noise_rms=NOISE))


def recording(gain: float = 1.0, noise: float = NOISE) -> Recording:
    t = np.arange(2000) * 0.005
    u = 75.0 - 60.0 * np.cos(2 * np.pi * 0.7 * t) - 10.0 * np.cos(2 * np.pi * 2.3 * t)
    y = simulate_hysteresis(stage(gain).hysteresis, u, 1e9) + RNG.normal(0.0, noise, t.size)
    return Recording(t, u, y, name="x")


def changed(y: np.ndarray) -> Recording:
    whole = recording()
    return Recording(whole.t_s, whole.drive, y, name="x")


def test_a_meter_gives_the_figures_of_the_newest_seconds_by_a_closed_form() -> None:
    """0.3 and -0.3 in turn about a mean of 0.5: rms about the mean 0.3, about zero 0.583."""
    meter = ErrorMeter(2.0, 0.01)
    for _ in range(10):
        meter.add(np.full(100, 9.0), np.full(100, 9.0), np.ones(100, bool), np.ones(100, bool))
    assert meter.full
    for _ in range(4):
        e = 0.5 + 0.3 * np.resize([1.0, -1.0], 50)
        good = np.ones(50, bool)
        meter.add(e, e, good, good)
    found = meter.errors
    assert found.model == pytest.approx(0.3)
    assert found.tracking == pytest.approx(math.sqrt(0.34))
    assert found.seconds == pytest.approx(2.0)
    meter.clear()
    meter.add(np.ones(10), np.ones(10), np.zeros(10, bool), np.ones(10, bool))
    assert not meter.full
    assert math.isnan(meter.errors.model)


@pytest.mark.parametrize(
    ("before", "after", "stays"),
    [
        (Errors(0.3, 0.3, 10), Errors(0.03, 0.04, 10), True),
        (Errors(0.3, 0.3, 10), Errors(0.15, 0.2, 10), True),  # half of what was promised
        (Errors(0.3, 0.3, 10), Errors(0.2, 0.2, 10), False),  # less than half
        (Errors(0.3, 0.3, 10), Errors(0.4, 0.2, 10), False),
        (Errors(0.3, 0.3, 10), Errors(0.03, 0.5, 10), False),  # the stage follows worse
        (Errors(0.3, 0.3, 10), Errors(0.03, 0.28, 10), False),  # and no better is no help
        (Errors(0.3, 0.1, 10), Errors(0.03, 0.1, 10), True),  # the trim has made up for it before
        (Errors(0.3, 0.1, 10), Errors(0.03, 0.2, 10), False),  # and now follows worse
        (Errors(math.nan, math.nan, 0), Errors(0.03, 0.5, 10), True),  # nothing moved before
        (Errors(math.nan, math.nan, 0), Errors(0.29, 0.5, 10), False),
        (Errors(0.3, 0.3, 10), Errors(math.nan, 0.1, 10), False),
    ],
)
def test_it_stays_where_its_error_fell_by_half_of_the_promise(
    before: Errors, after: Errors, stays: bool
) -> None:
    assert (why_back(before, after, (0.3, 0.03), NOISE, "um") == "") is stays


def test_what_became_of_it_is_said_with_figures_and_unit() -> None:
    before, worse = Errors(0.3, 0.3, 10), Errors(0.2, 0.2, 10)
    assert why_back(before, worse, (0.3, 0.03), NOISE, "um") == (
        "the offered one's error has not come down to 0.165 um within 10 s of motion: it is 0.2 "
        "um, the model before had 0.3, and the test promised 0.03"
    )
    better, nothing = Errors(0.03, 0.04, 10), Errors(math.nan, math.nan, 0)
    assert say_proven(before, better, "um") == (
        "the offered model is proven over 10 s of motion: its error is 0.03 um, the model before "
        "had 0.3; tracking error 0.04, before 0.3"
    )
    assert "nan" not in say_proven(nothing, better, "um")


def stuck(y: np.ndarray) -> np.ndarray:
    return np.r_[y[:500], np.full(y.size - 500, y[500])]


def silent(y: np.ndarray) -> np.ndarray:
    return np.where(np.arange(y.size) % 2 == 0, np.nan, y)


def far(y: np.ndarray) -> np.ndarray:
    return np.where(np.arange(y.size) > 800, 70.0, y)


def jumping(y: np.ndarray) -> np.ndarray:
    return y + 8.0 * (np.arange(y.size) % 400 == 7)


def noisy(y: np.ndarray) -> np.ndarray:
    return y + RNG.normal(0.0, 0.2, y.size)


@pytest.mark.parametrize(
    ("fault", "word"),
    [
        (stuck, "stuck"), (silent, "no valid reading"), (far, "far outside"), (jumping, "jumps"),
        (noisy, "noisier"),
    ],
)  # fmt: skip
def test_a_gauge_that_fails_is_told(fault: object, word: str) -> None:
    y = recording().displacement
    assert y is not None
    assert word in find_gauge_fault(changed(fault(y)), stage(), REACH)  # type: ignore[operator]


def test_a_stage_that_has_changed_is_no_gauge_that_fails() -> None:
    for gain in (1.0, 0.8, 0.5):
        assert find_gauge_fault(recording(gain), stage(), REACH) == ""
    y = recording().displacement
    assert y is not None
    ringing = y + 0.3 * np.sin(2 * np.pi * 31.0 * np.arange(y.size) * 0.005)
    assert find_gauge_fault(changed(ringing), stage(), REACH) == ""
