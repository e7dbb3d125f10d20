"""A gauge that differs from what the model assumes: learning does not make the stage worse."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.rigs.plants.effects import linear_filter
from tests.rigs.plants.hysteresis import maxwell_slip

from dehyst.models.learning.passes import Learner, Outcome, Pass

PERIOD_S, N, NOISE, BOUND, PASSES = 1e-3, 1000, 0.02, 1.5, 12
STROKE, VOLTS = 17.0, 10.0
T = PERIOD_S * np.arange(N)
TARGET = 5.0 + 2.0 * np.sin(2 * np.pi * T)
REPEATS = 0.05 * np.sin(2 * np.pi * 3 * T + 0.3) + 0.02 * np.cos(2 * np.pi * 17 * T)


def play(factor: float, delay: int) -> tuple[list[float], list[Outcome]]:
    """Return the rms of the true error about its mean in each pass, and the outcomes. The gauge
    shows factor times the position of `delay` samples before."""
    learner, rng = Learner(TARGET, PERIOD_S, NOISE, BOUND), np.random.default_rng(1)
    true, outcomes = [], []
    for _ in range(PASSES + 1):
        used = learner.correction
        place = TARGET + REPEATS + used
        true.append(float((place - TARGET).std()))
        measured = factor * np.roll(place, delay) + rng.normal(0.0, NOISE, N)
        outcomes.append(learner.take(Pass(measured - TARGET, used)))
    return true, outcomes


@settings(deadline=None, max_examples=40)
@given(
    sign=st.sampled_from((-1.0, 1.0)),
    gain=st.one_of(st.floats(0.2, 0.45), st.floats(1.6, 5.0)),
    delay=st.integers(0, 30),
)
def test_a_gauge_of_another_scale_is_noticed_and_the_beginning_comes_back(
    sign: float, gain: float, delay: int
) -> None:
    true, outcomes = play(sign * gain, delay)
    assert true[-1] <= 1.05 * true[0]
    assert "check its sign, scale and delay" in outcomes[-1].says


@settings(deadline=None, max_examples=20)
@given(gain=st.floats(0.5, 1.5), delay=st.integers(0, 30))
def test_a_gauge_of_the_wrong_sign_is_noticed(gain: float, delay: int) -> None:
    true, outcomes = play(-gain, delay)
    assert true[-1] <= 1.05 * true[0]
    assert not outcomes[-1].learned


def test_a_gauge_that_is_right_is_still_learned_from() -> None:
    true, outcomes = play(1.0, 0)
    assert true[-1] < 0.15 * true[0]
    assert all(outcome.learned for outcome in outcomes[2:])
    assert true[0] == pytest.approx(REPEATS.std())


class Foreign:
    """A stage whose hysteresis and resonance the model lacks: 60 Maxwell-slip elements and a mode
    of 120 Hz, driven by a straight line through the ends of its stroke."""

    def __init__(self, target: np.ndarray) -> None:
        self.target, self.stage = target, maxwell_slip(np.random.default_rng(5))
        low, high = self.stage(np.array([0.0, VOLTS]))
        self.um_per_unit, self.shift = STROKE / (high - low), 0.0
        self.shift = float((self.place(np.zeros(N)) - target).mean())

    def place(self, correction: np.ndarray) -> np.ndarray:
        """Return the position (n,) in the second of two consecutive passes."""
        asked = self.target + correction - self.shift
        drive = np.clip(np.tile(asked / STROKE * VOLTS, 2), 0.0, VOLTS)
        w = 2.0 * np.pi * 120.0
        moved = linear_filter(
            [w * w], [1.0, 0.1 * w, w * w], self.um_per_unit * self.stage(drive), PERIOD_S
        )
        return moved[N:]


def learn_on(target: np.ndarray, gain: float, delay: int) -> tuple[list[float], list[Outcome]]:
    """Do as `play`, on the foreign stage; the gauge's scale is wrong about 8 um."""
    stage, learner = Foreign(target), Learner(target, PERIOD_S, NOISE, BOUND)
    rng, true, outcomes = np.random.default_rng(1), [], []
    for _ in range(PASSES + 1):
        used = learner.correction
        place = stage.place(used)
        true.append(float((place - target).std()))
        measured = 8.0 + gain * (np.roll(place, delay) - 8.0) + rng.normal(0.0, NOISE, N)
        outcomes.append(learner.take(Pass(measured - target, used)))
    return true, outcomes


SCANS = {
    f"{um} um at {hertz} Hz": 8.0 + um * np.sin(2 * np.pi * hertz * T)
    for um, hertz in ((2.0, 1.0), (4.0, 2.0), (0.5, 5.0))
}


@pytest.mark.parametrize("scan", SCANS)
@pytest.mark.parametrize(("gain", "delay"), [(-1.0, 0), (0.5, 0), (2.0, 0), (-1.0, 10), (0.5, 10)])
def test_on_a_stage_that_is_not_its_model_a_wrong_gauge_is_noticed(
    scan: str, gain: float, delay: int
) -> None:
    true, outcomes = learn_on(SCANS[scan], gain, delay)
    assert true[-1] <= 1.05 * true[0]
    assert "check its sign, scale and delay" in outcomes[-1].says


def test_on_a_stage_that_is_not_its_model_a_late_gauge_is_noticed() -> None:
    true, outcomes = learn_on(SCANS["4.0 um at 2.0 Hz"], 1.0, 20)
    assert true[-1] <= 1.05 * true[0]
    assert "degrees late" in outcomes[-1].says


@pytest.mark.parametrize("scan", SCANS)
def test_on_a_stage_that_is_not_its_model_a_right_gauge_is_learned_from(scan: str) -> None:
    true, outcomes = learn_on(SCANS[scan], 1.0, 0)
    assert max(true[-4:]) < 0.35 * true[0]
    assert outcomes[-1].learned
