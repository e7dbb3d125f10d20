"""Learning from pass to pass, on plants that are written down here."""

import math
import re
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dehyst.models.errors import BadInput
from dehyst.models.learning.passes import Learner, Outcome, Pass, fade_share
from dehyst.models.learning.reading import expected_reading
from dehyst.models.learning.tuning import TUNING
from dehyst.models.model import Block, Hysteresis, Model, Validity

PERIOD_S, N, NOISE, BOUND = 1e-3, 1000, 0.02, 1.5
T = PERIOD_S * np.arange(N)
TARGET = 5.0 + 2.0 * np.sin(2 * np.pi * T)
REPEATS = 0.05 * np.sin(2 * np.pi * 3 * T + 0.3) + 0.02 * np.cos(2 * np.pi * 17 * T) - 0.1


class Plant:
    """e = d + P u + noise, with P a filter of the whole periodic pass."""

    def __init__(self, gain: float | np.ndarray = 1.0, seed: int = 1) -> None:
        self.gain, self.rng = gain, np.random.default_rng(seed)
        self.learner = Learner(TARGET, PERIOD_S, NOISE, BOUND)
        self.rms: list[float] = []  # of the true error about its mean
        self.outcomes: list[Outcome] = []

    def go(
        self,
        passes: int,
        repeats: np.ndarray = REPEATS,
        spoil: Callable[[np.ndarray], np.ndarray] = lambda e: e,
        trimmed: bool = False,
    ) -> None:
        for _ in range(passes):
            u = self.learner.correction
            moved = np.fft.irfft(self.gain * np.fft.rfft(u), N)
            true = repeats + moved
            self.rms.append(float(true.std()))
            measured = spoil(true + self.rng.normal(0.0, NOISE, N))
            self.outcomes.append(self.learner.take(Pass(measured, u, trimmed)))


def test_what_repeats_is_gone_after_a_few_passes_and_the_noise_does_not_come_in() -> None:
    plant = Plant()
    plant.go(30)
    assert plant.rms[0] == pytest.approx(REPEATS.std())
    assert max(plant.rms[6:]) < 0.15 * plant.rms[0]
    assert max(plant.rms[20:]) < 0.1 * NOISE
    assert plant.learner.correction.mean() == pytest.approx(0.1, abs=3 * NOISE / math.sqrt(N))


def test_only_what_repeats_is_learned() -> None:
    """Two of 501 lines repeat: hardly any other is in the filter."""
    plant = Plant()
    plant.go(20)
    learned = np.flatnonzero(plant.learner.weights > 0.1)
    assert {3, 17} <= set(learned.tolist())
    assert learned.size < 30
    assert plant.learner.weights[3] > 0.98


def test_nothing_repeats_nothing_is_learned() -> None:
    plant = Plant()
    plant.go(20, np.zeros(N))
    assert plant.learner.correction.std() < 0.1 * NOISE


@pytest.mark.parametrize("gain", [0.7, 0.9, 1.1, 1.3])
def test_another_gain_of_the_stage_ends_at_the_same_error(gain: float) -> None:
    plant = Plant(gain)
    plant.go(30)
    assert max(plant.rms[20:]) < 0.12 * NOISE


def test_with_trim_the_mean_is_left_to_it() -> None:
    plant = Plant()
    plant.go(10, trimmed=True)
    assert abs(plant.learner.correction.mean()) < 1e-9
    assert max(plant.rms[8:]) < 0.2 * NOISE


def test_an_open_pass_is_learned_without_edges() -> None:
    """A ramp ends elsewhere than it began: it is mirrored, not taken as periodic."""
    target = 2.0 + 3.0 * T
    learner, rng = Learner(target, PERIOD_S, NOISE, BOUND), np.random.default_rng(2)
    repeats = 0.1 * T**2 + 0.03 * np.sin(2 * np.pi * 2.3 * T)
    for _ in range(20):
        left = repeats + learner.correction
        learner.take(Pass(left + rng.normal(0.0, NOISE, N), learner.correction))
    assert not learner.closed
    assert left.std() < 0.2 * NOISE
    assert np.abs(left).max() < NOISE


def test_a_resonance_that_would_grow_is_found_and_given_up() -> None:
    """P = 6 at 100 to 120 Hz: |1 - 0.8 P| = 3.8."""
    gain = np.ones(N // 2 + 1)
    gain[100:120] = 6.0
    plant = Plant(gain)
    shaken = REPEATS + 0.01 * np.sin(2 * np.pi * 110 * T)
    plant.go(25, shaken)
    assert max(plant.rms) < 6.0 * plant.rms[0]
    assert max(plant.rms[15:]) < 0.02
    said = " ".join(one.says for one in plant.outcomes)
    assert "learning stopped at" in said or "half the gain" in said


def test_a_wrong_sense_ends_no_worse_than_it_began() -> None:
    """P = -1 everywhere: every pass makes it worse."""
    plant = Plant(-1.0)
    plant.go(25)
    assert plant.rms[-1] < 1.5 * plant.rms[0]
    assert np.abs(plant.learner.correction).max() <= BOUND


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda e: np.where((T > 0.3) & (T < 0.33), e + 1.0, e), r"a knock of \+.* at 0\.3"),
        (lambda e: np.where((T > 0.3) & (T < 0.35), np.nan, e), "49 of 1000 samples"),
        (lambda e: np.where(np.arange(N) % 100 == 5, np.nan, e), "10 of 1000 samples"),
        (lambda e: np.full(N, np.nan), "1000 of 1000 samples"),
    ],
)
def test_a_spoiled_pass_teaches_nothing(
    spoil: Callable[[np.ndarray], np.ndarray], words: str
) -> None:
    plant = Plant()
    plant.go(8)
    before = plant.learner.correction.copy()
    plant.go(1, spoil=spoil)
    np.testing.assert_array_equal(plant.learner.correction, before)
    assert not plant.outcomes[-1].learned
    assert re.search(words, plant.outcomes[-1].says)
    plant.go(3)
    assert plant.outcomes[-1].learned
    assert plant.rms[-1] < 0.25 * NOISE


def test_single_missing_samples_are_bridged() -> None:
    plant = Plant()
    plant.go(10, spoil=lambda e: np.where(np.isin(np.arange(N), [200, 700]), np.nan, e))
    assert all(one.learned for one in plant.outcomes[1:])
    assert plant.rms[-1] < 0.3 * NOISE


def test_a_stage_that_has_changed_is_learned_anew() -> None:
    """The same error twice is not a knock."""
    plant = Plant()
    plant.go(10)
    other = REPEATS + np.where((T > 0.5) & (T < 0.55), 0.5, 0.0)
    plant.go(15, other)
    assert plant.outcomes[10].says.startswith("not used for learning: a knock")
    assert plant.outcomes[12].learned
    assert plant.rms[-1] < 0.3 * plant.rms[10]


def test_where_the_error_has_grown_it_goes_back_to_the_best_correction() -> None:
    """The repeating part has become three times as large, so its remainder grows to 76 nm rms."""
    plant = Plant()
    plant.go(10)
    plant.go(4, 3.0 * REPEATS)
    said = [one.says for one in plant.outcomes]
    assert not any("has grown" in words for words in said[:10])
    assert any("back to the best correction, with half the gain" in words for words in said[10:])


@pytest.mark.parametrize("settles", [0.0, 0.3])
def test_a_first_pass_that_comes_from_elsewhere_is_not_learned_from(settles: float) -> None:
    """A second pass whose end differs from its beginning is not learned from either."""
    plant = Plant()
    plant.go(1, REPEATS + settles * np.exp(-T / 0.1))
    assert not plant.outcomes[0].learned
    plant.go(1, REPEATS + settles * np.exp(-T / 0.1))
    assert plant.outcomes[1].learned == (settles == 0.0)
    assert plant.learner.correction.any() == (settles == 0.0)


def test_what_was_learned_is_taken_up() -> None:
    first = Plant()
    first.go(12)
    second = Plant(seed=5)
    second.learner = Learner(TARGET, PERIOD_S, NOISE, BOUND, first.learner.correction)
    second.go(6)
    assert max(second.rms) < 0.4 * NOISE


@settings(max_examples=30)
@given(
    st.lists(st.floats(-50, 50) | st.just(math.nan), min_size=1, max_size=6),
    st.floats(0.01, 3.0),
    st.integers(0, 2**31),
)
def test_the_correction_is_finite_and_bounded_whatever_is_measured(
    levels: list[float], bound: float, seed: int
) -> None:
    learner, rng = Learner(TARGET, PERIOD_S, NOISE, bound), np.random.default_rng(seed)
    for level in levels:
        error = level * rng.normal(size=N) + level
        out = learner.take(Pass(error, learner.correction))
        assert 0.0 < out.gain < 1.0
        assert np.isfinite(learner.correction).all()
        assert np.abs(learner.correction).max() <= bound * (1 + 1e-12)


def test_the_gain_falls_and_stays_below_one() -> None:
    plant = Plant()
    plant.go(60)
    gains = [one.gain for one in plant.outcomes if one.learned]
    assert max(gains) <= TUNING.gain < 1.0
    assert gains[-1] == TUNING.least_gain
    assert np.all(np.diff(gains) <= 0.0)


def test_a_fade_has_no_step() -> None:
    share = fade_share(np.arange(300), 100)
    assert share[0] < 1e-3
    assert share[-1] == 1.0
    assert np.diff(share).max() < 0.016
    assert np.all(np.diff(share) >= 0.0)


@pytest.mark.parametrize("target", [np.zeros(3), np.full(50, np.nan), np.zeros((20, 2))])
def test_bad_targets_are_refused(target: np.ndarray) -> None:
    with pytest.raises(BadInput, match="16 or more"):
        Learner(target, PERIOD_S, NOISE, BOUND)


def test_a_late_gauge_is_expected_late() -> None:
    """A pure delay of the sensor: sin(w (t - L))."""
    plays = Hysteresis(np.array([0.0]), np.array([1.0]), np.array([0.0, 1.0]))
    late = Model(
        plays,
        Validity(0.0, 10.0),
        blocks=(
            Block("delay", "sensor", {"delay_s": 0.004}),
            Block("lag", "drive", {"tau_s": 0.1}),
        ),
    )
    expected = 5.0 + 2.0 * np.sin(2 * np.pi * (T - 0.004))
    np.testing.assert_allclose(expected_reading(late, TARGET, PERIOD_S), expected, atol=1e-4)
    np.testing.assert_array_equal(
        expected_reading(Model(plays, Validity(0.0, 10.0)), TARGET, PERIOD_S), TARGET
    )
