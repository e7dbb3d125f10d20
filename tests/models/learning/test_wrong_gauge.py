"""A gauge that is not what the model takes it for: learning does not make the stage worse."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dehyst.models.learning.passes import Learner, Outcome, Pass

PERIOD_S, N, NOISE, BOUND, PASSES = 1e-3, 1000, 0.02, 1.5, 12
T = PERIOD_S * np.arange(N)
TARGET = 5.0 + 2.0 * np.sin(2 * np.pi * T)
REPEATS = 0.05 * np.sin(2 * np.pi * 3 * T + 0.3) + 0.02 * np.cos(2 * np.pi * 17 * T)


def play(factor: float, delay: int) -> tuple[list[float], list[Outcome]]:
    """RMS of the true error about its mean in each pass, and what was learned. The gauge gives
    factor times the place of `delay` samples before."""
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
