"""A model on trial: when it stays, when it is withdrawn; and what counts as a failing gauge."""

import math

import numpy as np
import pytest

from dehyst.models.hysteresis.forward import simulate_hysteresis
from dehyst.models.mismatch.gauge import find_gauge_fault
from dehyst.models.mismatch.trial import (
    ErrorMeter,
    Errors,
    OfferErrors,
    Samples,
    judge_trial,
    settle_trial,
)
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


def batch(
    own: np.ndarray, other: np.ndarray | None = None, good: np.ndarray | None = None, **more: object
) -> Samples:
    yes, no = np.ones(own.size, bool), np.zeros(own.size, bool)
    good = yes if good is None else good
    nothing = np.full(own.size, math.nan)
    given = {
        "own": own, "other": nothing if other is None else other, "error": own, "good": good,
        "steps": np.zeros(own.size), "tracked": good, "without": no, "held": no,
    } | more  # fmt: skip
    return Samples(**given)  # type: ignore[arg-type]


def test_a_meter_gives_the_figures_of_the_newest_seconds_by_a_closed_form() -> None:
    """0.3 and -0.3 in turn about a mean of 0.5: the rms about the mean is 0.3, about zero 0.583."""
    meter = ErrorMeter(2.0, 0.01)
    for _ in range(10):
        meter.add(batch(np.full(100, 9.0)))
    assert meter.full
    for _ in range(4):
        e = 0.5 + 0.3 * np.resize([1.0, -1.0], 50)
        meter.add(batch(e, 2.0 * e, steps=np.ones(50), without=np.arange(50) < 25))
    found = meter.errors
    assert found.model == pytest.approx(0.3)
    assert found.other == pytest.approx(0.6)
    assert found.tracking == pytest.approx(math.sqrt(0.34))
    assert found.seconds == pytest.approx(2.0)
    assert (found.steps, found.without) == pytest.approx((1.0, 0.5))
    meter.clear()
    meter.add(batch(np.ones(10), good=np.zeros(10, bool)))
    assert not meter.full
    assert math.isnan(meter.errors.model)


def test_a_slow_gauge_counts_the_time_between_its_readings() -> None:
    meter = ErrorMeter(2.0, 0.01)
    held = np.arange(200) % 5 != 0
    meter.add(batch(np.zeros(200), good=~held, held=held))
    assert meter.full
    assert meter.errors.seconds == pytest.approx(2.0)


def test_the_model_before_counts_where_it_is_known_of_all_samples_alone() -> None:
    meter = ErrorMeter(2.0, 0.01)
    meter.add(batch(np.ones(50), np.ones(50)))
    assert math.isfinite(meter.errors.other)
    meter.add(batch(np.ones(50)))
    assert math.isnan(meter.errors.other)


PROMISE = OfferErrors(0.3, 0.03, NOISE)
NAN = math.nan


@pytest.mark.parametrize(
    ("before", "after", "outcome"),
    [
        (Errors(0.3, 0.3, 10), Errors(0.03, 0.04, 10), "stays"),
        (Errors(0.3, 0.3, 10), Errors(0.15, 0.2, 10), "stays"),  # half of the promised improvement
        (Errors(0.3, 0.3, 10), Errors(0.2, 0.2, 10), "goes"),  # less than half
        (Errors(0.3, 0.3, 10), Errors(0.4, 0.2, 10), "goes"),
        (Errors(0.3, 0.3, 10), Errors(0.03, 0.5, 10), "goes"),  # the stage follows worse
        (Errors(0.3, 0.3, 10), Errors(0.03, 0.28, 10), "goes"),  # no improvement
        (Errors(0.3, 0.1, 10), Errors(0.03, 0.1, 10), "stays"),  # the trim had corrected it
        (Errors(0.3, 0.1, 10), Errors(0.03, 0.2, 10), "goes"),  # and now follows worse
        (Errors(NAN, NAN, 0), Errors(0.03, 0.5, 10), "stays"),  # nothing moved before
        (Errors(NAN, NAN, 0), Errors(0.29, 0.5, 10), "goes"),
        (Errors(0.3, 0.3, 10), Errors(NAN, 0.1, 10), "open"),
        # on the same samples, the previous model's residual on them decides
        (Errors(0.3, 0.3, 10), Errors(0.2, 0.2, 10, other=0.9), "stays"),
        (Errors(0.3, 0.3, 10), Errors(0.05, 0.05, 10, other=0.06), "goes"),
        (Errors(0.3, 0.3, 10), Errors(0.02, 0.02, 10, other=0.025), "open"),
        (Errors(0.3, 0.3, 10), Errors(0.05, 0.02, 10, other=0.025), "goes"),
        # other motion says nothing about tracking; without preview the error need not fall
        (Errors(0.3, 0.3, 10, steps=0.01), Errors(0.03, 0.9, 10, steps=0.1), "stays"),
        (Errors(0.3, 0.3, 10, steps=0.01), Errors(0.03, 4.0, 10, steps=0.1), "stays"),
        (Errors(0.3, 0.3, 10, steps=0.06), Errors(0.03, 0.9, 10, steps=0.1), "goes"),
        (Errors(0.3, 0.3, 10), Errors(0.03, 0.28, 10, without=1.0), "stays"),
        (Errors(0.3, 0.3, 10), Errors(0.03, 0.5, 10, without=1.0), "goes"),
        (Errors(0.3, 0.9, 10), Errors(0.03, 0.85, 10), "stays"),  # mostly steps
    ],
)
def test_it_stays_where_its_error_fell_by_half_of_the_promise(
    before: Errors, after: Errors, outcome: str
) -> None:
    assert judge_trial(before, after, PROMISE, "um").outcome == outcome


@pytest.mark.parametrize(
    ("after", "outcome"),
    [
        (Errors(NAN, NAN, 0), "stays"),  # no evidence against it
        (Errors(0.4, 0.4, 0.5, other=0.3), "stays"),  # too short a time
        (Errors(0.4, 0.4, 2.0, other=0.3), "goes"),
        (Errors(0.02, 0.02, 10, other=0.025), "stays"),
        (Errors(0.03, 0.03, 2.0, other=0.3), "stays"),
    ],
)
def test_when_the_time_is_up_the_model_stays_unless_something_was_seen_against_it(
    after: Errors, outcome: str
) -> None:
    found = settle_trial(Errors(0.3, 0.3, 10), after, PROMISE, "um", 90.0)
    assert found.outcome == outcome
    assert found.why.startswith("the trial ends after its limit of 90 s")
    assert "nan" not in found.why


def test_what_became_of_it_is_said_with_figures_and_unit() -> None:
    before, worse = Errors(0.3, 0.3, 10), Errors(0.2, 0.2, 10)
    assert judge_trial(before, worse, PROMISE, "um").why == (
        "the offered one's error has not fallen to 0.166 um within 10 s of motion: it is 0.2 um, "
        "the previous model had 0.3, and the test promised 0.03"
    )
    better, nothing = Errors(0.03, 0.04, 10, other=0.25), Errors(NAN, NAN, 0)
    assert judge_trial(before, better, PROMISE, "um").why == (
        "the offered model is confirmed over 10 s of motion: its error is 0.03 um, the "
        "previous model leaves 0.25; tracking error 0.04, before 0.3"
    )
    assert "nan" not in judge_trial(nothing, better, PROMISE, "um").why


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
def test_a_gauge_that_fails_is_reported(fault: object, word: str) -> None:
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
