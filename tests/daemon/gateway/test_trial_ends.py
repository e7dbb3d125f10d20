"""Every trial of an offered model ends, however the stage is moved.

The product's own step, stage and trial run in this process on a clock of samples. The old model
moves a fifth too far; offers are right or wrong.
"""

import os
import signal
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.rigs.stage_model import kept_model
from tests.rigs.trimmed_stage import Player, TrimmedStage

from dehyst.daemon import clock
from dehyst.daemon.bus.messages import DoctorState
from dehyst.daemon.config import Config, parse_config
from dehyst.daemon.files import cases
from dehyst.daemon.files.cases import OfferTest
from dehyst.daemon.files.chosen import choose_model, read_accepted
from dehyst.daemon.files.models import save_model
from dehyst.daemon.gateway.model_trial import TAKEN_S, ModelTrial
from dehyst.daemon.rings.records import TELEMETRY, Flag, model_digest
from dehyst.drivers.simulated.settings import StageSettings
from dehyst.models.model import Block, Model
from dehyst.models.modelfile import dumps

RATE_HZ = 200.0
TRIAL_S, LIMIT_S = 2.0, 60.0
CONFIG = """
name = "ends"
run_dir = "{folder}"
model = {{file = "{folder}/model.toml"}}
loop = {{rate_hz = 200.0}}
actuator = {{driver = "simulated"}}
sensor = {{driver = "simulated"}}
limits = {{min_v = 0.0, max_v = 150.0, slew_v_per_s = 4000.0}}
doctor = {{trial_s = {trial_s}, trial_limit_s = {limit_s}}}
"""


def scaled(by: float, preview: bool = False) -> Model:
    """Return the stage's own model with another gain; preview: with a small delay that requires a
    preview inverse."""
    model = kept_model()
    model = replace(model, hysteresis=replace(model.hysteresis, c=model.hysteresis.c * by))
    late = Block("delay", "drive", {"delay_s": 0.0005})
    return replace(model, blocks=(*model.blocks, late)) if preview else model


class Story:
    """A stage that runs with an old model, and an offered model."""

    def __init__(
        self, folder: Path, offered: Model, patch: pytest.MonkeyPatch, trial_s: float
    ) -> None:
        self.old, self.folder, self.offered = scaled(1.2), folder, offered
        save_model(self.old, folder / "model.toml")
        text = CONFIG.format(folder=folder, trial_s=trial_s, limit_s=LIMIT_S)
        self.config: Config = parse_config(text)
        plain = StageSettings(rc_tau_s=0.0, mode_hz=0.0, sensor_tau_s=0.0, seed=3)
        self.rig = TrimmedStage(self.old, plain, trim=False, rate_hz=RATE_HZ)
        self.running: Model | None = self.old
        self.passed_s, self._asked, self._seen, self._number = 0.0, False, 0, 0
        patch.setattr(clock, "monotonic_ns", lambda: round(self.now_s * clock.NS))
        patch.setattr(clock, "wall_ns", lambda: round((1e9 + self.now_s) * clock.NS))
        self.trial = self.new_trial()
        self.over: tuple[str, DoctorState, str] | None = None

    @property
    def now_s(self) -> float:
        return self.rig.now_ns * 1e-9 + self.passed_s

    def core(self) -> tuple[int, Path | None]:
        if self.running is None:
            return 0, None
        return os.getpid(), self.folder / f"model-{model_digest(dumps(self.running))}.toml"

    def new_trial(self) -> ModelTrial:
        """Return the trial of a gateway that has just started."""
        return ModelTrial(self.config, self.core, self.kept)

    def kept(self, first: int, end: int) -> np.ndarray:
        """Return the samples with these numbers."""
        return np.array(self.rig.records[max(0, first) : end], TELEMETRY)

    def reload(self, *_: object) -> None:
        self._asked = True

    def offer(self) -> None:
        case = self.folder / "mismatch-1.case"
        case.mkdir()
        save_model(self.offered, case / cases.OFFERED)
        tested = OfferTest(in_use=0.6, offered=0.05, noise=0.02, seconds=10.0)
        self.trial.begin("mismatch-1", 1, case, tested)

    def look(self) -> bool:
        """Do what the gateway does periodically; return whether the trial is over."""
        samples = np.array(self.rig.records[self._seen :], TELEMETRY)
        self._seen = len(self.rig.records)
        for first in range(0, samples.size, 20):
            self.trial.take_samples(samples[first : first + 20])
        if self._asked:
            self._asked = False
            self.running, *_ = choose_model(self.config)
            self.rig.reload(self.running)
        self.over = self.trial.check_outcome(clock.monotonic_ns()) or self.over
        return self.over is not None

    def move(self, how: "Move", seconds: float) -> bool:
        """Move until the trial is over or the time is up; return whether it is over."""
        end_s = self.now_s + seconds
        while self.now_s < end_s:
            how(self)
            if self.look():
                return True
        return False

    def play(self, target: np.ndarray) -> None:
        self._number += 1
        Player(self.rig, self._number).play(target, last=True)


Move = Callable[[Story], None]
TURN = 6.5 + 2.5 * np.sin(2 * np.pi * np.arange(400) / 400)


def set_points(story: Story) -> None:
    """Follow a sine by set-points, each for 0.05 s."""
    story.rig.go(6.5 + 2.5 * np.sin(2 * np.pi * 0.5 * story.now_s), 0.05)


def steps(story: Story) -> None:
    """Make large steps, each for 0.4 s; the slew limit delays them."""
    story.rig.go(float(np.random.default_rng(round(story.now_s * 100)).uniform(3.0, 10.0)), 0.4)


def holds(story: Story) -> None:
    """Go to another position every 4 s."""
    story.rig.go(3.0 + 7.0 * (round(story.now_s / 4.0) % 3) / 2, 4.0)


def raster(story: Story) -> None:
    """Play a trajectory."""
    story.play(TURN)


def rest(story: Story) -> None:
    """Keep the stage at rest."""
    story.rig.go(6.5, 1.0)


@pytest.fixture
def story(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Story]]:
    made: list[Story] = []

    def make(offered: Model, trial_s: float = TRIAL_S) -> Story:
        made.append(Story(tmp_path, offered, monkeypatch, trial_s))
        signal.signal(signal.SIGHUP, made[-1].reload)
        return made[-1]

    before = signal.getsignal(signal.SIGHUP)
    yield make
    signal.signal(signal.SIGHUP, before)


@pytest.mark.parametrize("preview", [False, True])
@pytest.mark.parametrize("move", [set_points, steps, holds, raster])
@pytest.mark.parametrize(("by", "state"), [(1.0, "accepted"), (1.5, "returned")])
def test_a_trial_is_judged_however_the_stage_is_moved(
    story: Callable[..., Story], move: Move, preview: bool, by: float, state: str
) -> None:
    one = story(scaled(by, preview))
    one.move(move, 5.0)
    one.offer()
    begun_s = one.now_s
    assert one.move(move, LIMIT_S + 5.0)
    assert one.over is not None
    assert one.over[1] == state, one.over
    assert one.now_s - begun_s < LIMIT_S  # decided by the motion, before the limit
    moved = np.array(one.rig.records, TELEMETRY)[-400:]
    if preview and move is set_points:
        assert np.all(moved["flags"] & int(Flag.FALLBACK))
    kept = read_accepted(one.config.directory)
    assert (kept is not None and not kept.trial) is (state == "accepted")


def test_a_stage_at_rest_settles_the_trial_at_its_bound(story: Callable[..., Story]) -> None:
    one = story(scaled(1.0))
    one.move(set_points, 6.0)
    one.move(rest, 4.0)
    one.offer()
    begun_s = one.now_s
    assert one.move(rest, LIMIT_S + 5.0)
    assert one.over is not None
    assert one.over[1] == "accepted"
    assert "limit of 60 s" in one.over[2]
    assert "unconfirmed" in one.over[2]
    assert one.now_s - begun_s == pytest.approx(LIMIT_S, abs=2.0)


@pytest.mark.parametrize(("by", "state"), [(1.0, "accepted"), (1.6, "returned")])
def test_little_motion_is_settled_by_what_was_seen(
    story: Callable[..., Story], by: float, state: str
) -> None:
    one = story(scaled(by), 20.0)
    one.move(set_points, 6.0)
    one.offer()
    one.move(set_points, 6.0)  # for the error to settle, then too little of the 20 s
    assert one.move(rest, LIMIT_S + 5.0)
    assert one.over is not None
    assert one.over[1] == state, one.over
    assert "after its limit of 60 s" in one.over[2]


def test_a_gateway_that_restarts_keeps_the_bound(story: Callable[..., Story]) -> None:
    one = story(scaled(1.0))
    one.offer()
    begun_s = one.now_s
    one.move(rest, 20.0)
    one.passed_s += 10.0  # without a gateway
    one.trial = one.new_trial()
    one.trial.resume()
    assert one.trial.case_on_trial == "mismatch-1"
    one.move(rest, 20.0)
    one.trial = one.new_trial()
    one.trial.resume()
    assert one.move(rest, LIMIT_S)
    assert one.now_s - begun_s == pytest.approx(LIMIT_S, abs=2.0)


@pytest.mark.parametrize("runs", [False, True])
def test_a_loop_that_never_runs_it_ends_the_trial(story: Callable[..., Story], runs: bool) -> None:
    """If the loop never runs the offered model, the trial ends and the old model is used."""
    one = story(scaled(1.0))
    one.move(set_points, 1.0)
    one.offer()
    one.running = one.old if runs else None
    one._asked = False
    one.passed_s += TAKEN_S + 1.0 if runs else LIMIT_S - 1.0
    assert one.look() is runs
    one.passed_s += 2.0
    assert one.look()
    assert one.over is not None
    assert one.over[1] == "returned"
    assert read_accepted(one.config.directory) is None


def test_an_error_that_passes_after_the_switch_does_not_end_it(
    story: Callable[..., Story],
) -> None:
    """An error that decays after the switch does not end the trial: the new model's state is
    computed from a bounded past, so older motion shows for a while."""
    one = story(scaled(1.0))
    one.move(set_points, 6.0)
    one.offer()
    look, switched_s = one.rig.stage.reading_um, one.now_s

    def reading() -> float:
        left = max(0.0, 1.0 - (one.now_s - switched_s) / 5.0)
        return look() + 2.5 * left * np.sin(2.0 * one.now_s)

    one.rig.stage.reading_um = reading  # type: ignore[method-assign]
    assert one.move(set_points, LIMIT_S)
    assert one.over is not None
    assert one.over[1] == "accepted", one.over
