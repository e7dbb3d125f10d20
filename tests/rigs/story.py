"""The demo's second act without processes and at high speed: simulated stage, controller, mismatch
watch, doctor and trial in this process, on a clock of samples.

Everything but the clock is the product's own: the step, the watch with its recordings, the doctor's
examination of the case that the watch has opened, the trial with its reload.
"""

import os
import signal
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from tests.rigs.trimmed_stage import HIGH_V, LOW_V, SLEW, Tamper, TrimmedStage

from dehyst.daemon import clock
from dehyst.daemon.bench.simulated import RATE_HZ
from dehyst.daemon.config import parse_config
from dehyst.daemon.demo.second_act import SETTINGS, pattern
from dehyst.daemon.doctor.examination import examine
from dehyst.daemon.files import cases
from dehyst.daemon.files.cases import Case, Examined
from dehyst.daemon.files.chosen import choose_model
from dehyst.daemon.files.models import save_model, write_text
from dehyst.daemon.gateway.history import TelemetryHistory
from dehyst.daemon.gateway.mismatch import MismatchWatch
from dehyst.daemon.gateway.model_trial import ModelTrial
from dehyst.daemon.rings.records import COMMAND, TELEMETRY, Flag, LoopCommand, model_digest
from dehyst.drivers.simulated.settings import StageSettings
from dehyst.models.model import Model
from dehyst.models.modelfile import dumps

CONFIG = """
name = "story"
run_dir = "{folder}"
model = {{file = "{folder}/model.toml"}}
loop = {{rate_hz = {rate_hz}}}
actuator = {{driver = "simulated"}}
sensor = {{driver = "simulated"}}
limits = {{min_v = {low}, max_v = {high}, slew_v_per_s = {slew}}}
"""
QUICK_STAGE = partial(StageSettings, rc_tau_s=0.0, mode_hz=0.0, sensor_tau_s=0.0)
"""Effects that end within a sample are omitted: they cost most of the time."""
BATCH, AHEAD = 20, 1000  # samples
SHARE = 0.9  # share of the reach, as in the demo
NOT_TRACKED = int(Flag.APPROACH | Flag.SENSOR_INVALID | Flag.SENSOR_HELD)


@dataclass
class Told:
    """An event."""

    at_s: float
    level: int
    code: str
    text: str


@dataclass
class OfflineStory:
    """One stage that follows the demo's pattern all the time. tamper: returns what the loop gets
    instead of each reading; events: all that the watch reported. Use with `with`."""

    folder: Path
    model: Model
    seed: int
    settings: str = SETTINGS
    tamper: Tamper | None = None
    events: list[Told] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.folder.mkdir(parents=True, exist_ok=True)
        save_model(self.model, self.folder / "model.toml")
        self.config = parse_config(
            CONFIG.format(folder=self.folder, rate_hz=RATE_HZ, low=LOW_V, high=HIGH_V, slew=SLEW)
            + self.settings
        )
        self.rig = TrimmedStage(self.model, QUICK_STAGE(seed=self.seed), rate_hz=RATE_HZ)
        low, high = self.rig.reach
        half = 0.5 * (high - low) * SHARE
        self._target = pattern(0.5 * (low + high), half, RATE_HZ)[1]
        self._sent = 0
        self.history = TelemetryHistory(round(self.config.telemetry.history_s * RATE_HZ) + 1)
        self.watch = MismatchWatch(self.config, self.history, self._tell)
        self.trial = ModelTrial(
            self.config, lambda: (os.getpid(), self.watch.model_path), self.history.get
        )
        self.watch.seen = self.trial.take_samples
        self._reload_asked = False
        self._use(self.model)

    def __enter__(self) -> Self:
        self._before = signal.signal(signal.SIGHUP, self._ask_reload)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        signal.signal(signal.SIGHUP, self._before)

    def _ask_reload(self, *_: object) -> None:
        self._reload_asked = True

    def _tell(self, level: int, code: str, text: str) -> None:
        self.events.append(Told(self.now_s, level, code, text))

    def _use(self, model: Model) -> None:
        """Set which model the loop runs."""
        text = dumps(model)
        path = self.folder / f"model-{model_digest(text)}.toml"
        write_text(path, text)
        self.watch.model_path = path

    @property
    def now_s(self) -> float:
        """Seconds since the first sample."""
        return self.rig.now_ns * 1e-9

    # -- advance time -----------------------------------------------------------------------------

    def go_on(self) -> None:
        """Run and judge one batch of samples."""
        if self._reload_asked:
            self._reload_asked = False
            model, *_ = choose_model(self.config)
            self.rig.reload(model)
            self._use(model)
        first = len(self.rig.records)
        for _ in range(BATCH):
            self.rig.tick(self._points(), self.tamper)
        samples = np.array(self.rig.records[first:], TELEMETRY)
        self.watch.add(1, samples, 0.0)
        self.history.add(samples)
        self.watch.judge_next()

    def _points(self) -> np.ndarray:
        """Return the next round of the pattern, well before it is needed."""
        if self._sent - len(self.rig.records) > AHEAD:
            return np.zeros(0, COMMAND)
        batch = np.zeros(self._target.size, COMMAND)
        batch["kind"], batch["trajectory"] = LoopCommand.POINT, 1
        batch["offset_ns"] = (self._sent + np.arange(batch.size)) * self.rig.period_ns
        batch["value"] = self._target
        self._sent += batch.size
        return batch

    def until(self, happened: Callable[[], bool], seconds: float) -> bool:
        """Continue until it has happened; return False if it has not within this many seconds."""
        end_s = self.now_s + seconds
        while not happened():
            if self.now_s > end_s:
                return False
            self.go_on()
        return True

    def wait(self, seconds: float) -> None:
        """Continue for this many seconds."""
        self.until(lambda: False, seconds)

    def learned(self) -> bool:
        """Return whether the watch knows the stage and reports nothing about it."""
        return self.watch.health > 0.0 and not self.watch.mismatch

    # -- the doctor -------------------------------------------------------------------------------

    def open_case(self) -> Path | None:
        """Return the newest case that is complete and not examined."""
        found = [
            f
            for f in cases.case_folders(self.config.watch_directory)
            if (f / cases.LATER).exists() and not (f / cases.EXAMINED).exists()
        ]
        return found[-1] if found else None

    def examine(self, folder: Path) -> Examined:
        """Return the doctor's result for a case."""
        found = examine(folder)
        cases.put_record(folder, cases.EXAMINED, found)
        return found

    def accept(self, folder: Path, seconds: float) -> tuple[str, str]:
        """Accept the offer of a case; return (result of the offer, in words)."""
        case, found = (
            cases.get_record(folder, name, kind)
            for name, kind in ((cases.CASE, Case), (cases.EXAMINED, Examined))
        )
        assert isinstance(case, Case)
        assert isinstance(found, Examined)
        assert found.tested is not None
        self.trial.begin(case.name, case.number, folder, found.tested)
        over: list[Any] = []

        def is_over() -> bool:
            over.append(self.trial.check_outcome(clock.monotonic_ns()))
            return over[-1] is not None

        return over[-1][1:] if self.until(is_over, seconds) else ("trial", "")

    def rms(self, first_s: float, end_s: float) -> float:
        """Return the rms of measured minus target between two times."""
        period_s = self.rig.period_ns * 1e-9
        samples = np.array(
            self.rig.records[max(0, round(first_s / period_s)) : round(end_s / period_s)], TELEMETRY
        )
        good = np.isfinite(samples["target"]) & np.isfinite(samples["measured"])
        good &= (samples["flags"] & NOT_TRACKED) == 0
        error = (samples["measured"] - samples["target"])[good]
        return float(np.sqrt(np.mean(error**2))) if error.size else float("nan")
