"""The slow trim, compared with closed forms, and its bounds for any gauge reading."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dehyst.models.learning import trim
from dehyst.models.learning.freeze_reason import FreezeReason
from dehyst.models.model import Block, Hysteresis, Model, Validity

PERIOD_S = 1e-3
REACH, NOISE = 17.0, 0.02


class Loop:
    """A stage whose inverse is exact, displaced by `off` from the model's prediction."""

    def __init__(self, **given: float) -> None:
        self.setting = trim.make_trim_setting(PERIOD_S, REACH, NOISE, True, **given)
        self.state = trim.begin_trim()
        self.trims: list[float] = []
        self.reported: list[FreezeReason] = []
        self.predicted = self.reading = 0.0

    def go(
        self, seconds: float, off: float, target: float = 5.0, held: bool = False,
        running: bool = True, reading: float | None = None, noise: float = 1e-6,
    ) -> None:  # fmt: skip
        for i in range(round(seconds / PERIOD_S)):
            self.predicted = target + float(self.state["trim"][0])
            self.reading = self.predicted + off + noise * (-1) ** i if reading is None else reading
            if trim.take(
                self.setting[0], self.state[0], self.reading, self.predicted, held, running
            ):
                self.reported.append(FreezeReason(int(self.state["lasting"][0])))
            self.trims.append(float(self.state["trim"][0]))

    @property
    def trim(self) -> float:
        return self.trims[-1]


def test_a_constant_difference_is_made_up_for_with_the_time_constant() -> None:
    """w_n = -d (1 - (1 + h / T)^-n), which is -d (1 - exp(-t / T)) up to order h / T."""
    loop = Loop(time_constant_s=0.5, limit=1.0, rate=100.0)
    loop.go(2.0, 0.3)
    n = 1 + np.arange(2000)
    np.testing.assert_allclose(loop.trims, -0.3 * (1 - 1.002**-n), atol=2e-6)
    np.testing.assert_allclose(loop.trims, -0.3 * (1 - np.exp(-n * PERIOD_S / 0.5)), atol=2e-4)


def test_no_frequency_is_amplified() -> None:
    """|S(jw)| = w T / sqrt(1 + (w T)^2), below 1 at every frequency."""
    for hertz in (0.1, 0.3, 1.0, 5.0):
        loop = Loop(time_constant_s=0.3, rate=100.0)
        n = round(20.0 / PERIOD_S)
        off = 0.05 * np.sin(2 * np.pi * hertz * PERIOD_S * np.arange(n))
        error = np.empty(n)
        for i in range(n):
            error[i] = off[i] + float(loop.state["trim"][0])
            loop.go(PERIOD_S, off[i])
        left = np.std(error[n // 2 :]) / np.std(off[n // 2 :])
        w = 2 * np.pi * hertz * 0.3
        assert left == pytest.approx(w / math.hypot(1.0, w), rel=0.02)


def test_no_windup_beyond_the_limit() -> None:
    """What exceeds the limit is not stored: the trim reverses at once."""
    loop = Loop(limit=0.2, rate=10.0)
    loop.go(10.0, 0.35)
    assert loop.trim == pytest.approx(-0.2, abs=1e-6)
    loop.go(PERIOD_S * 50, 0.1)
    assert loop.trim > -0.2 + 0.01


def test_frozen_while_nobody_commands_and_goes_on_without_a_jump() -> None:
    loop = Loop(rate=0.2)
    loop.go(3.0, 0.2)
    before = loop.trim
    loop.go(5.0, 0.25, running=False)
    assert loop.trim == before
    assert loop.reported[-1] is FreezeReason.NOT_RUNNING
    loop.go(1.0, 0.25)
    assert np.abs(np.diff(loop.trims)).max() <= 0.2 * PERIOD_S * (1 + 1e-9)
    assert loop.trim < before


def test_held_readings_move_nothing_and_the_next_one_counts_for_them() -> None:
    every, steady = Loop(rate=100.0), Loop(rate=100.0)
    for i in range(2000):
        every.go(PERIOD_S, 0.1, held=bool(i % 5))
    steady.go(2.0, 0.1)
    assert every.trim == pytest.approx(steady.trim, rel=0.01)


@pytest.mark.parametrize("bad", [math.nan, 90.0, -90.0])
def test_a_reading_that_is_none_or_beyond_belief_freezes(bad: float) -> None:
    loop = Loop()
    loop.go(3.0, 0.2)
    before = loop.trim
    loop.go(2.0, 0.0, reading=bad)
    assert loop.trim == pytest.approx(before, abs=1e-12)
    assert loop.reported[-1] in (FreezeReason.NO_READING, FreezeReason.BEYOND)
    loop.go(2.0, 0.2)
    assert loop.reported[-1] is FreezeReason.NOTHING
    assert loop.trim == pytest.approx(-0.2, abs=1e-3)


def test_a_stuck_gauge_freezes_and_what_it_moved_is_taken_back() -> None:
    loop = Loop(rate=100.0)
    loop.go(5.0, 0.2)
    before, stuck = loop.trim, loop.reading
    loop.go(3.0, 0.0, target=5.5, reading=stuck)
    assert loop.reported[-1] is FreezeReason.STUCK
    assert loop.trim == pytest.approx(before, abs=1e-3)


def test_what_a_stuck_gauge_moved_before_it_was_seen_is_taken_back() -> None:
    loop = Loop()
    loop.go(5.0, 0.2)
    before, stuck = loop.trim, loop.reading
    loop.go(0.3, 0.0, target=5.1, reading=stuck)
    assert abs(loop.trim - before) > 0.03
    loop.go(1.0, 0.0, target=5.5, reading=stuck)
    assert loop.reported[-1] is FreezeReason.STUCK
    assert loop.trim == pytest.approx(before, abs=1e-3)


def test_a_gauge_that_sticks_at_rest_moves_the_stage_by_little() -> None:
    loop = Loop()
    loop.go(5.0, 0.2)
    before, stuck = loop.trim, loop.reading
    loop.go(60.0, 0.0, target=5.05, reading=stuck)
    assert abs(loop.trim - before) < 10 * NOISE + 1e-3


def test_a_jump_is_not_followed_until_it_is_over() -> None:
    loop = Loop()
    loop.go(3.0, 0.2)
    before = loop.trim
    loop.go(5.0, 1.2)
    assert abs(loop.trim - before) < 2e-3
    assert loop.reported[-1] is FreezeReason.JUMPED
    loop.go(2.0, 0.21)
    assert loop.reported[-1] is FreezeReason.NOTHING
    assert loop.trim == pytest.approx(-0.21, abs=1e-3)


def test_a_jump_is_followed_once_the_zero_was_moved() -> None:
    loop = Loop()
    loop.go(3.0, 0.2)
    loop.go(1.0, 1.2)
    trim.move_zero(loop.state[0], -1.0)
    assert float(loop.state["zero"][0]) == -1.0
    loop.go(3.0, 0.25)
    assert loop.trim == pytest.approx(-0.25, abs=1e-3)


def test_a_gauge_that_drifts_and_jumps_back_is_trimmed_again() -> None:
    """3 um in 30 s: the trim follows to its limit; back at the truth the gauge is judged again."""
    loop = Loop()
    loop.go(5.0, 0.2)
    for i in range(300):
        loop.go(0.1, 0.2 + 3.0 * i / 300)
    assert loop.trim == pytest.approx(-1.7, abs=0.01)
    loop.reported.clear()
    loop.go(1.0, 0.2)
    assert loop.trim == pytest.approx(-1.7, abs=0.01)  # not at once
    loop.go(9.0, 0.2)
    assert loop.reported[-2:] == [FreezeReason.SETTLING, FreezeReason.NOTHING]
    assert loop.trim == pytest.approx(-0.2, abs=0.01)
    assert np.abs(np.diff(loop.trims)).max() <= float(loop.setting["rate"][0]) * PERIOD_S * 1.000001


@pytest.mark.parametrize("off", [0.2, 1.2])
def test_what_the_difference_usually_is_is_plausible(off: float) -> None:
    """A stage that is always 1.2 um off is as healthy as one that is right."""
    loop = Loop()
    loop.go(60.0, off)
    for i in range(200):
        loop.go(0.1, off + 1.0 * i / 200)
    loop.go(10.0, off)
    assert loop.trim == pytest.approx(-off, abs=0.01)


@pytest.mark.parametrize(("first", "off"), [(0.0, 0.34), (0.0, 0.6), (0.0, 1.5), (-0.8, 0.024)])
def test_a_state_of_the_model_that_is_in_doubt_is_judged_anew(first: float, off: float) -> None:
    """The state of a new loop lacks the distant past, which shows after the first readings."""
    loop = Loop()
    loop.go(0.5, first)
    loop.go(12.0, off)
    assert loop.trim == pytest.approx(-off, abs=0.01)


@given(
    st.floats(0.7, 3.3),
    st.booleans(),
    st.sampled_from(["stays", "jumps", "moves"]),
)
@settings(max_examples=30)
def test_a_gauge_that_stays_wrong_moves_nothing(wrong: float, up: bool, how: str) -> None:
    """The gauge jumps too far and does not return: at rest, in motion, back and forth."""
    loop = Loop()
    loop.go(5.0, 0.0)
    before, sign = loop.trim, 1.0 if up else -1.0
    for k in range(60):
        # back and forth faster than what counts as settled, and not by steps that would bring it
        # back
        here = wrong + (0.6 * (k % 2) if how == "jumps" else 0.0)
        target = 5.0 + (2.0 * math.sin(0.3 * k) if how == "moves" else 0.0)
        loop.go(0.5, sign * here, target=target)
    assert abs(loop.trim - before) < 5e-3
    assert loop.reported[-1] in (FreezeReason.JUMPED, FreezeReason.BEYOND)


@settings(max_examples=10)
@given(st.floats(0.0, 0.1), st.floats(0.2, 2.0))
def test_a_noisy_or_moving_reading_that_is_back_settles(noise: float, hertz: float) -> None:
    """With noise up to five times what the trim was set for, and a stage of another gain."""
    loop = Loop()
    loop.go(3.0, -0.3)
    loop.go(3.0, 1.0)
    rng = np.random.default_rng(5)
    for i in range(8000):
        target = 4.0 * math.sin(2 * np.pi * hertz * i * PERIOD_S)
        loop.go(PERIOD_S, 0.25 + 0.02 * target + float(rng.normal(0.0, noise)), target=target)
    assert loop.reported[-1] is FreezeReason.NOTHING
    assert loop.trim == pytest.approx(-0.25, abs=0.1)


def test_a_single_glitch_moves_nothing() -> None:
    loop, quiet = Loop(), Loop()
    for one, value in ((loop, 3.0), (quiet, 0.2)):
        one.go(3.0, 0.2)
        one.go(PERIOD_S, value)
        one.go(0.5, 0.2)
    assert loop.trim == pytest.approx(quiet.trim, abs=1e-3)
    assert loop.reported == quiet.reported


def test_a_misfit_that_moves_with_the_stage_is_no_jump() -> None:
    """A stage with 20 % more gain than its model, at 5 Hz over 8 um."""
    loop = Loop()
    for i in range(4000):
        target = 4.0 * math.sin(2 * np.pi * 5.0 * i * PERIOD_S)
        loop.go(PERIOD_S, 0.2 * target + 0.3, target=target, noise=1e-6 * (1 + i % 2))
    assert FreezeReason.JUMPED not in loop.reported
    assert np.mean(loop.trims[-1000:]) == pytest.approx(-0.3, abs=0.05)


def test_another_models_first_readings_are_no_jump_and_later_ones_are() -> None:
    """The new model has not seen the earlier drive: 0.8 um wrong for 50 ms; a jump is 0.43."""
    loop = Loop()
    loop.go(3.0, 0.2)
    trim.forget_trim(loop.state[0])
    loop.go(0.05, -0.8)
    loop.go(3.0, 0.1)
    assert FreezeReason.JUMPED not in loop.reported
    assert loop.trim == pytest.approx(-0.1, abs=1e-3)
    loop.go(1.0, 0.9)
    assert loop.reported[-1] is FreezeReason.JUMPED


def test_another_models_first_readings_far_off_are_not_believed() -> None:
    loop = Loop()
    trim.forget_trim(loop.state[0])
    loop.go(0.5, 4.0)
    assert loop.reported[-1] is FreezeReason.BEYOND
    assert loop.trim == 0.0


def test_a_glitch_among_another_models_first_readings_is_not_what_a_jump_is_measured_from() -> None:
    loop = Loop()
    trim.forget_trim(loop.state[0])
    loop.go(0.17, 0.1)
    loop.go(0.04, 4.0)
    loop.go(2.0, 0.1)
    assert FreezeReason.JUMPED not in loop.reported
    assert loop.trim == pytest.approx(-0.1, abs=1e-3)


def test_distrusted_it_stands_still() -> None:
    loop = Loop()
    loop.go(3.0, 0.2)
    before = loop.trim
    loop.state["distrusted"] = 1
    loop.go(1.0, 0.4)
    assert loop.trim == pytest.approx(before, abs=1e-12)
    assert loop.reported[-1] is FreezeReason.DISTRUSTED


def test_switched_off_it_adds_nothing_and_still_says_the_difference() -> None:
    loop = Loop()
    loop.setting["on"] = 0
    loop.go(2.0, 0.2)
    assert loop.trim == 0.0
    assert float(loop.state["seen"][0]) == pytest.approx(0.2, abs=1e-3)


readings = st.lists(
    st.tuples(
        st.floats(-100, 100) | st.just(math.nan) | st.floats(-1, 1),
        st.floats(-20, 20),
        st.booleans(),
        st.booleans(),
        st.integers(1, 40),
    ),
    max_size=30,
)


@settings(max_examples=100)
@given(readings, st.floats(0.01, 5.0), st.floats(0.001, 50.0))
def test_bounds_hold_whatever_the_gauge_says(todo: list, limit: float, rate: float) -> None:
    loop = Loop(limit=limit, rate=rate)
    for reading, target, held, running, times in todo:
        loop.go(times * PERIOD_S, 0.0, target, held, running, reading)
    path = np.array([0.0, *loop.trims])
    assert np.isfinite(path).all()
    assert np.abs(path).max() <= limit * (1 + 1e-12)
    assert np.abs(np.diff(path)).max(initial=0.0) <= rate * PERIOD_S * (1 + 1e-9)


def test_a_late_gauge_is_stable_down_to_the_least_time_constant() -> None:
    """The model lacks a delay L: exp(-s L) / (s T) is stable for L / T < pi / 2."""
    late_s = 0.05
    for time_constant_s, stable in ((trim.least_time_constant_s(late_s), True), (0.025, False)):
        setting = trim.make_trim_setting(PERIOD_S, REACH, NOISE, True, time_constant_s, rate=100.0)
        state, line = trim.begin_trim(), [0.0] * round(late_s / PERIOD_S)
        path = []
        for i in range(3000):
            now = float(state["trim"][0])
            line.append(now)
            trim.take(setting[0], state[0], 0.1 + line.pop(0) + 1e-9 * (-1) ** i, now, False, True)
            path.append(now)
        most = np.abs(path).max()
        assert most < 0.13 if stable else most > 0.3


def test_the_sensors_own_lag_and_delay_count_and_the_stages_do_not() -> None:
    plays = Hysteresis(np.array([0.0, 1.0]), np.array([1.0, 0.1]), np.array([0.0, 1.0]))
    blocks = (
        Block("lag", "sensor", {"tau_s": 0.02}),
        Block("delay", "sensor", {"delay_s": 0.003}),
        Block("lag", "drive", {"tau_s": 0.5}),
    )
    model = Model(plays, Validity(0.0, 10.0), blocks=blocks)
    assert trim.sensor_lag_s(model, 1e-3) == pytest.approx(0.023)
