"""Trials of offered models at high speed: simulated stage, controller and trial in this process, on
a clock of samples. The stage has a lag that the model in use lacks, and a different gain."""

import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
from tests.rigs.stage_model import kept_model
from tests.rigs.trimmed_stage import HIGH_V, LOW_V, SLEW, TrimmedStage

from dehyst.daemon import clock
from dehyst.daemon.config import parse_config
from dehyst.daemon.files import cases
from dehyst.daemon.files.cases import OfferTest
from dehyst.daemon.files.chosen import choose_model
from dehyst.daemon.files.models import save_model, write_text
from dehyst.daemon.gateway.history import TelemetryHistory
from dehyst.daemon.gateway.model_trial import ModelTrial, Over
from dehyst.daemon.rings.records import COMMAND, TELEMETRY, Flag, LoopCommand, model_digest
from dehyst.drivers.simulated.settings import StageSettings
from dehyst.models.model import Block, Floats, Model
from dehyst.models.modelfile import dumps

RATE_HZ, BATCH, AHEAD = 200.0, 20, 400
LAG_S = 0.02
CONFIG = """
name = "trial"
run_dir = "{folder}"
model = {{file = "{folder}/model.toml"}}
loop = {{rate_hz = {rate_hz}}}
actuator = {{driver = "simulated"}}
sensor = {{driver = "simulated"}}
limits = {{min_v = {low}, max_v = {high}, slew_v_per_s = {slew}}}
doctor = {{trial_s = {trial_s}, trial_limit_s = {most_s}}}
"""
MIDDLE, HALF = 7.5, 4.0  # um: the range of the motions


def scaled(by: float, lag: bool = False) -> Model:
    """Return the stage's own model with another gain; lag: with the stage's lag as a block."""
    model = kept_model()
    blocks = (Block("lag", "drive", {"tau_s": LAG_S}),) if lag else ()
    h = replace(model.hysteresis, c=model.hysteresis.c * by)
    return replace(model, hysteresis=h, blocks=blocks)


def setpoints(t: float) -> float:
    """A slow sine that a client sends at 20 Hz."""
    return MIDDLE + HALF * float(np.sin(2 * np.pi * 0.4 * np.floor(t * 20.0) / 20.0))


def holds(t: float) -> float:
    """A different place every 6 s."""
    return MIDDLE + HALF * float(np.random.default_rng(int(t // 6.0)).uniform(-1, 1))


def steps(t: float) -> float:
    """Back and forth, a step every 0.5 s."""
    return MIDDLE + HALF * (1.0 if int(t / 0.5) % 2 else -1.0)


def small_steps(t: float) -> float:
    """Steps of a tenth of that size."""
    return MIDDLE + 0.1 * (steps(t) - MIDDLE)


def rest(t: float) -> float:
    """No motion."""
    return MIDDLE


def raster(t: float) -> float:
    """The fast axis of a raster, rounded at its turns."""
    phase = 2 * np.pi * 1.0 * t
    return MIDDLE + HALF * float(np.arcsin(0.98 * np.sin(phase)) / np.arcsin(0.98))


Motion = Callable[[float], float]
SET: dict[str, Motion] = {"set-points": setpoints, "holds": holds, "steps": steps}
"""Motions by set-points; a raster is played as a trajectory."""


class TrialRig:
    """One stage on which a model is tried. Use within `reloads`."""

    def __init__(
        self,
        folder: Path,
        in_use: Model,
        trial_s: float = 3.0,
        most_s: float = 90.0,
        lag_s: float = LAG_S,
    ) -> None:
        self.folder = folder
        save_model(in_use, folder / "model.toml")
        text = CONFIG.format(
            folder=folder, rate_hz=RATE_HZ, low=LOW_V, high=HIGH_V, slew=SLEW, trial_s=trial_s,
            most_s=most_s,
        )  # fmt: skip
        self.config = parse_config(text)
        stage = StageSettings(
            rc_tau_s=0.0, mode_hz=0.0, sensor_tau_s=0.0, amplifier_tau_s=lag_s, seed=3
        )
        self.rig = TrimmedStage(in_use, stage, rate_hz=RATE_HZ)
        self.history = TelemetryHistory(100_000)
        self.running: Path | None = None
        self._use(in_use)
        self.start_gateway()
        self._sent = 0
        self._asked: float | None = None
        self.reload_asked = False
        self.begun_s = 0.0

    def start_gateway(self) -> None:
        """Start a new trial that knows the previous one only through the run folder."""
        self.trial = ModelTrial(self.config, lambda: (os.getpid(), self.running), self.history.get)
        self.trial.resume()

    def _use(self, model: Model) -> None:
        text = dumps(model)
        self.running = self.folder / f"model-{model_digest(text)}.toml"
        write_text(self.running, text)

    @property
    def now_s(self) -> float:
        """The time of the samples."""
        return len(self.rig.records) / RATE_HZ

    @property
    def clock_ns(self) -> int:
        """The clock that the trial sees: the samples' time since it was started."""
        return self._zero_ns + round((self.now_s - self.begun_s) * clock.NS)

    def go_on(self, motion: Motion, played: bool = False) -> None:
        """Run one batch of samples."""
        if self.reload_asked:
            self.reload_asked = False
            model, *_ = choose_model(self.config)
            self.rig.reload(model)
            self._use(model)
        first = len(self.rig.records)
        for _ in range(BATCH):
            self.rig.tick(self._points(motion) if played else self._setpoint(motion))
        samples = np.array(self.rig.records[first:], TELEMETRY)
        self.history.add(samples)
        self.trial.take_samples(samples)

    def _setpoint(self, motion: Motion) -> np.ndarray:
        """Return the set-point of a client that sends one when the place changes, but not during
        the approach to the first."""
        place = motion(self.now_s)
        flags = int(self.rig.records[-1]["flags"]) if self.rig.records else 0
        if place == self._asked or (flags & int(Flag.APPROACH) and self._asked is not None):
            return np.zeros(0, COMMAND)
        self._asked = place
        command = np.zeros(1, COMMAND)
        command["kind"], command["value"] = LoopCommand.SETPOINT, place
        return command

    def _points(self, motion: Motion) -> np.ndarray:
        if self._sent - len(self.rig.records) > AHEAD:
            return np.zeros(0, COMMAND)
        batch = np.zeros(AHEAD, COMMAND)
        at = self._sent + np.arange(AHEAD)
        batch["kind"], batch["trajectory"] = LoopCommand.POINT, 1
        batch["offset_ns"] = at * self.rig.period_ns
        batch["value"] = [motion(k / RATE_HZ) for k in at]
        self._sent += AHEAD
        return batch

    def go(self, motion: Motion, seconds: float, played: bool = False) -> None:
        """Run for this long."""
        end_s = self.now_s + seconds
        while self.now_s < end_s:
            self.go_on(motion, played)

    def offer(self, model: Model, promise: tuple[float, float] = (0.6, 0.05)) -> None:
        """Put a model on trial."""
        folder = self.folder / "mismatch-1.case"
        folder.mkdir(exist_ok=True)
        save_model(model, folder / cases.OFFERED)
        tested = OfferTest(in_use=promise[0], offered=promise[1], noise=0.02, seconds=10.0)
        self._zero_ns, self.begun_s = clock.monotonic_ns(), self.now_s
        self.trial.begin("mismatch-1", 1, folder, tested)

    def until_over(self, motion: Motion, played: bool, most_s: float) -> Over | None:
        """Return the result of the trial; None if it was not over by then."""
        end_s = self.now_s + most_s
        while self.now_s < end_s:
            self.go_on(motion, played)
            over = self.trial.check_outcome(self.clock_ns)
            if over is not None:
                return over
        return None

    def largest_step_v(self) -> float:
        """Return the largest step of the written voltage from sample to sample."""
        volts: Floats = np.array([float(r["volts"]) for r in self.rig.records])
        return float(np.abs(np.diff(volts)).max())


@contextmanager
def reloads(rig: TrialRig) -> Iterator[TrialRig]:
    """Make the rig the loop that receives SIGHUP."""

    def ask(*_: object) -> None:
        rig.reload_asked = True

    before = signal.signal(signal.SIGHUP, ask)
    try:
        yield rig
    finally:
        signal.signal(signal.SIGHUP, before)
