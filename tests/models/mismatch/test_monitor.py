"""The mismatch monitor on a stage whose physics the model lacks."""

import copy

import numpy as np
import pytest

from dehyst.drivers.simulated.stage import SimulatedStage
from dehyst.models.identify import identify
from dehyst.models.inverse.compensator import Compensator
from dehyst.models.mismatch.monitor import MismatchMonitor
from dehyst.models.model import Model
from dehyst.models.recording import Recording

RATE, LEARNED_S, BAR_S, NOISE_UM = 200.0, 500, 10, 0.02


def stirring(seconds: float) -> np.ndarray:
    """Return a drive that keeps the stage moving: three sines, from 0 V."""
    t = np.arange(round(seconds * RATE)) / RATE
    waves = [a * np.sin(2 * np.pi * f * t) for a, f in ((22.0, 0.31), (13.0, 0.83), (6.0, 1.9))]
    return np.asarray((70.0 + np.sum(waves, axis=0)) * np.minimum(1.0, t / 2.0))


class Run:
    """Volts, prediction and measurement of a stage that is driven by `stirring`."""

    def __init__(self, seconds: float) -> None:
        t = np.arange(round(20 * RATE)) / RATE
        amplitude = 75.0 * np.abs(np.cos(np.pi * t / 20))
        volts = 75.0 - amplitude * np.cos(2 * np.pi * t) * np.minimum(1.0, t)
        volts *= np.minimum(1.0, t)
        stage = SimulatedStage()
        _, reading = stage.run(t, volts)
        held = np.concatenate([[0.0], volts[:-1]])
        self.model: Model = identify([Recording(t_s=t, drive=held, displacement=reading)]).model
        self.volts = stirring(seconds)
        t = np.arange(self.volts.size) / RATE
        _, self.measured = SimulatedStage().run(t, self.volts)
        compensator = Compensator(self.model, 1 / RATE, 0.0, 150.0, 1e6)
        state = compensator.init(0.0)
        self.predicted = np.empty(t.size)
        for i, u in enumerate(self.volts.tolist()):
            self.predicted[i] = state.reading
            compensator.applied(state, u)
        self.drive = np.concatenate([[0.0], self.volts[:-1]])

    def feed(
        self, watch: MismatchMonitor, first_s: float, end_s: float, extra: np.ndarray | None = None
    ) -> int:
        """Feed these seconds, with something added to the reading; return the seconds until the
        flag, or -1 if there is none."""
        for second in range(round(first_s), round(end_s)):
            part = slice(round(second * RATE), round((second + 1) * RATE))
            reading = self.measured[part]
            if extra is not None:
                start = round((second - first_s) * RATE)
                reading = reading + extra[start : start + reading.size]
            good = np.ones(reading.size, np.bool_)
            watch.update(self.drive[part], self.predicted[part], reading, good)
            if watch.mismatch:
                return second + 1 - round(first_s)
        return -1


@pytest.fixture(scope="module")
def run() -> Run:
    return Run(LEARNED_S + 60.0)


@pytest.fixture(scope="module")
def learned(run: Run) -> MismatchMonitor:
    watch = MismatchMonitor(run.model, 1 / RATE)
    assert run.feed(watch, 0, LEARNED_S) == -1, (watch.cause, watch.figures, watch.thresholds)
    return watch


def twice_the_noise(kind: str, moved: np.ndarray) -> np.ndarray:
    """Return what a change adds to the reading, scaled to an rms of twice the noise over BAR_S."""
    t = np.arange(moved.size) / RATE
    if kind == "gain":
        added = moved
    elif kind == "creep":
        added = np.zeros(moved.size)
        for tau_s in (0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0):
            state = 0.0
            for i, x in enumerate(moved.tolist()):
                state += -np.expm1(-1 / (RATE * tau_s)) * (x - state)
                added[i] += state
    elif kind == "resonance":  # a mode at 20 Hz that the steps of the drive excite
        w, z, x, v = 2 * np.pi * 20.0, 0.03, 0.0, 0.0
        added = np.zeros(moved.size)
        for i, target in enumerate(moved.tolist()):
            for _ in range(10):
                v += (w * w * (target - x) - 2 * z * w * v) / (10 * RATE)
                x += v / (10 * RATE)
            added[i] = x - target
    else:
        added = np.sin(2 * np.pi * 50.3 * t)
    bar = added[: round(BAR_S * RATE)]
    return np.asarray(added * (2 * NOISE_UM / np.sqrt(np.mean(bar**2))))


@pytest.mark.parametrize("kind", ["gain", "creep", "resonance", "hum"])
def test_what_adds_twice_the_noise_is_flagged_in_time(
    run: Run, learned: MismatchMonitor, kind: str
) -> None:
    watch = copy.deepcopy(learned)
    start = round(LEARNED_S * RATE)
    moved = run.predicted[start : start + round(2 * BAR_S * RATE)] - run.predicted[start]
    extra = twice_the_noise(kind, moved)
    flagged_s = run.feed(watch, LEARNED_S, LEARNED_S + BAR_S, extra)
    assert 0 < flagged_s <= BAR_S, (flagged_s, watch.figures, watch.thresholds)


def test_the_same_stage_goes_on_without_a_flag(run: Run, learned: MismatchMonitor) -> None:
    watch = copy.deepcopy(learned)
    assert run.feed(watch, LEARNED_S, LEARNED_S + 60) == -1
    assert watch.health < 1.0


def test_the_flag_ends_when_the_stage_is_in_order_again(run: Run, learned: MismatchMonitor) -> None:
    watch = copy.deepcopy(learned)
    extra = np.full(round(10 * RATE), 1.0)
    assert run.feed(watch, LEARNED_S, LEARNED_S + 10, extra) > 0
    ended = []
    for second in range(LEARNED_S + 10, LEARNED_S + 30):
        run.feed(watch, second, second + 1)
        ended.append(not watch.mismatch)
    assert ended[-1]


def test_it_says_that_it_still_learns_until_it_has_seen_enough_motion(
    run: Run, learned: MismatchMonitor
) -> None:
    watch = MismatchMonitor(run.model, 1 / RATE)
    assert run.feed(watch, 0, 40) == -1
    assert watch.health == pytest.approx(-(1 - 40 / 400), abs=0.01)
    assert type(watch.health) is float  # it is sent in a message
    at_rest = MismatchMonitor(run.model, 1 / RATE)
    still, good = np.zeros(round(60 * RATE)), np.ones(round(60 * RATE), np.bool_)
    noise = NOISE_UM * np.random.default_rng(0).standard_normal(still.size)
    at_rest.update(still, still, noise, good)
    assert at_rest.health < -0.96  # rest does not count as learning
    assert learned.learning == 0.0
    assert 0.0 < learned.health < 1.0


def test_a_stage_that_was_moved_before_is_no_other_stage(run: Run) -> None:
    """The stage is a tenth of its stroke above its de-energised position until the drive has been
    through its range; the model does not know this."""
    stage = SimulatedStage()
    for volts in (0.0, 150.0, 0.0):
        stage.settle(volts, rest_s=1.0)
    volts = run.volts[: round(30 * RATE)]
    _, measured = stage.run(np.arange(volts.size) / RATE, volts)
    assert measured[0] - run.measured[0] > 0.5
    watch = MismatchMonitor(run.model, 1 / RATE)
    assert run.feed(watch, 0, 30, measured - run.measured[: volts.size]) == -1


def test_it_still_learns_where_the_first_second_is_far_out(run: Run) -> None:
    watch = MismatchMonitor(run.model, 1 / RATE)
    far = np.full(round(RATE), 5.0) * np.arange(round(RATE))
    run.feed(watch, 0, 1, far)
    assert watch.figures["fit"] > watch.thresholds["fit"]
    assert not watch.mismatch  # one second is too short to decide
    assert watch.health < 0.0


def test_another_stage_is_flagged_from_the_first(run: Run) -> None:
    watch = MismatchMonitor(run.model, 1 / RATE)
    other = 0.3 * (run.predicted - run.predicted.mean())  # moves by 30 % more
    assert 0 < run.feed(watch, 0, 30, other) <= 20


def test_a_reading_that_stands_still_is_called_stuck(run: Run, learned: MismatchMonitor) -> None:
    watch = copy.deepcopy(learned)
    start = round(LEARNED_S * RATE)
    assert watch.stuck_s == 0.0
    part = slice(start, start + round(3 * RATE))
    stuck = np.full(part.stop - part.start, run.measured[start])
    watch.update(run.drive[part], run.predicted[part], stuck, np.isfinite(stuck))
    assert watch.stuck_s > 2.0
    assert watch.mismatch


def test_invalid_readings_are_no_mismatch(run: Run, learned: MismatchMonitor) -> None:
    watch = copy.deepcopy(learned)
    part = slice(round(LEARNED_S * RATE), round((LEARNED_S + 20) * RATE))
    good = np.zeros(part.stop - part.start, np.bool_)
    watch.update(run.drive[part], run.predicted[part], np.full(good.size, np.nan), good)
    assert not watch.mismatch


def test_batches_of_any_length_give_the_same_figures(run: Run) -> None:
    one, many = MismatchMonitor(run.model, 1 / RATE), MismatchMonitor(run.model, 1 / RATE)
    n = round(20 * RATE)
    run.feed(one, 0, 20)
    at, sizes = 0, np.random.default_rng(0)
    while at < n:
        part = slice(at, min(n, at + int(sizes.integers(1, 300))))
        good = np.ones(part.stop - part.start, np.bool_)
        many.update(run.drive[part], run.predicted[part], run.measured[part], good)
        at = part.stop
    assert many.figures == pytest.approx(one.figures)
