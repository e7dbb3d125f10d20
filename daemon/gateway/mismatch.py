"""The mismatch watch in the gateway: feeds telemetry to dehyst.models.mismatch.monitor and records
mismatches.

It runs in its own thread, so that neither compilation nor a slow disk delays telemetry. When the
stage stops behaving like its model, the samples around that moment are saved to a recording, and an
event names the recording and the command that diagnoses it.
"""

import logging
import shlex
import threading
from collections import deque
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dehyst.daemon import clock
from dehyst.daemon.config import Config
from dehyst.daemon.files.cases import drop_case
from dehyst.daemon.files.models import load_model
from dehyst.daemon.gateway.case_keeper import CaseKeeper, describe_case
from dehyst.daemon.gateway.history import TelemetryHistory
from dehyst.daemon.rings.records import Flag, State
from dehyst.models.errors import BadModel, DehystError
from dehyst.models.mismatch.monitor import MismatchMonitor

log = logging.getLogger(__name__)
WAITING_BATCHES = 4096  # 80 s at the default of 20 ms a batch
UNUSABLE = Flag.SENSOR_HELD | Flag.SENSOR_INVALID
STUCK, SILENT = "stuck", "silent"
LOST, SILENT_S = 0.2, 2
"""Share of invalid readings in a second, and number of such seconds, that mark a silent gauge."""
MEANS = {
    "gain": "its gain or its creep has changed",
    "offset": "its zero has moved",
    "whole": "its motion has changed",
    "all": "its motion has changed, or its zero has moved",
    "ringing": "it rings, or is made to vibrate",
    "short": "its reading is noisier",
    "fit": "the model fits far worse than it claims",
    STUCK: "its reading is stuck",
    SILENT: "its gauge gives no valid reading",
}

Trust = Callable[[bool], None]
"""Reports to the loop whether stage and gauge are to be trusted."""
Report = Callable[[int, str, str], None]
"""Reports an event: (level, code, text)."""
See = Callable[[NDArray[Any]], None]
"""Receives the samples that were judged, to follow a model on trial."""


class MismatchWatch:
    """Judges telemetry. `add` is called by the publisher, `run` is its thread.

    health, mismatch, figure: as reported in the status; figure is "" while nothing is wrong, health
    is below 0 while the watch is still learning."""

    def __init__(self, config: Config, history: TelemetryHistory, report: Report) -> None:
        self._config, self._history, self._report = config, history, report
        self._batches: deque[tuple[int, NDArray[Any], float, float]] = deque(maxlen=WAITING_BATCHES)
        self._watch: MismatchMonitor | None = None
        self.trust: Trust = lambda trusted: None
        self.seen: See = lambda samples: None
        self._cases = CaseKeeper(config, history)
        self._flagged = 0, 0, 0  # sample, time_ns, wall_ns of the flag
        self._figure_flagged = ""
        self.model_path: Path | None = None
        self._model_used: Path | None = None
        self._run = 0
        self._before: Any = None
        self._keep_at: int | None = None  # sequence number at which the recording is complete
        self._stuck = False
        self._due = self._lost = self._silent_s = 0
        self.health, self.mismatch, self.figure = 0.0, False, ""

    def add(self, run: int, samples: NDArray[Any], origin: float, zero: float = 0.0) -> None:
        """Queue samples of one run of the loop, and flag them during a mismatch. zero: what
        `dehyst zero` added to their readings, which is not a change of the stage."""
        if self.mismatch:
            samples["flags"] |= int(Flag.MISMATCH)
        if self._config.watch.enabled:
            self._batches.append((run, samples.copy(), origin, zero))

    def run(self, stop: threading.Event) -> None:
        """Judge batches until `stop` is set."""
        while not stop.wait(0.1):
            while self._batches and not stop.is_set():
                self.judge_next()

    def judge_next(self) -> None:
        """Judge the oldest waiting batch."""
        try:
            self._take(*self._batches.popleft())
        except DehystError as error:
            log.warning("mismatch watch: %s", error)

    def _take(self, run: int, samples: NDArray[Any], origin: float, zero: float) -> None:
        if run != self._run or self._watch is None:
            self._begin(run)
        watch = self._watch
        assert watch is not None
        volts = samples["volts"]
        first = self._before if self._before is not None else samples[0]
        seq = np.concatenate([[first["seq"]], samples["seq"]])
        drive = np.concatenate([[first["volts"]], volts[:-1]]) / self._config.actuator.gain
        self._before = samples[-1].copy()
        good = (
            np.isfinite(samples["measured"])
            & (samples["flags"] & int(UNUSABLE) == 0)
            & (samples["state"] != State.FAULT)
            & (np.diff(seq) == 1)
        )
        due = (samples["flags"] & int(Flag.SENSOR_HELD) == 0) & (samples["state"] != State.FAULT)
        invalid = samples["flags"] & int(Flag.SENSOR_INVALID) != 0
        self._due += int(due.sum())
        self._lost += int((due & (invalid | ~np.isfinite(samples["measured"]))).sum())
        judged = watch.update(
            drive,
            samples["predicted"] + origin,
            samples["measured"] + origin - zero,
            good,
            samples["trim"] + samples["learned"],
        )
        self.seen(samples)
        if judged:
            self._judged(watch, int(samples["seq"][-1]))
        if self._model_used is not None:
            self._cases.write_later_recording(int(samples["seq"][-1]), self._model_used)
        if self._keep_at is not None and int(samples["seq"][-1]) >= self._keep_at:
            self._keep_at = None
            self._keep(origin, int(samples["seq"][-1]))

    def _begin(self, run: int) -> None:
        """Start over for a new run of the loop or a new model, and discard what was learned."""
        path = self._model_used = self.model_path
        if path is None:
            raise BadModel("the loop has not yet reported its model")
        self._watch = MismatchMonitor(
            load_model(path), self._config.period_ns * 1e-9, self._config.watch.learn_s
        )
        self._run, self._before, self._keep_at = run, None, None
        self._cases.restart()
        self.trust(True)
        self.health, self.mismatch, self.figure, self._stuck = 0.0, False, "", False
        self._due = self._lost = self._silent_s = 0

    def _judged(self, watch: MismatchMonitor, seq: int) -> None:
        if self.model_path != self._model_used:
            self._watch = None
            return
        stuck_s = watch.stuck_s
        self.health = watch.health
        self._silent_s = self._silent_s + 1 if self._lost > LOST * self._due else 0
        self._due = self._lost = 0
        silent = self._silent_s >= SILENT_S
        wrong = watch.mismatch or stuck_s > 0.0 or silent
        cause = SILENT if silent else STUCK if stuck_s else watch.cause
        self.figure = cause if wrong else ""
        if stuck_s and not self._stuck:
            self._report(
                2,
                "sensor",
                f"the reading has not changed for {stuck_s:.1f} s although the "
                "stage was moved: is the sensor stuck?",
            )
        self._stuck = stuck_s > 0.0
        if wrong and not self.mismatch:
            rate_hz = 1e9 / self._config.period_ns
            self._flagged = seq, clock.monotonic_ns(), clock.wall_ns()
            self._figure_flagged = self.figure
            self._keep_at = seq + round(self._config.watch.after_s * rate_hz)
            self._report(
                2,
                "mismatch",
                f"the stage does not behave like its model: {MEANS[self.figure]} (health "
                f"{self.health:.2f}, where values above 1 mean a mismatch; figure "
                f"{self.figure!r})",
            )
        elif self.mismatch and not wrong:
            self._report(1, "mismatch", "the stage behaves like its model again")
        if wrong != self.mismatch:
            self.trust(not wrong)
            self._cases.note_mismatch(seq, wrong)
        self.mismatch = wrong
        if not wrong:
            self._cases.keep_good_stretch(seq, watch.motion_s)

    def _keep(self, origin: float, end: int) -> None:
        """Write a recording from before to after the mismatch, from the history."""
        from dehyst.daemon.files.recorder import Recorder

        chosen, config = self._config.watch, self._config
        rate_hz = 1e9 / config.period_ns
        count = round((chosen.before_s + chosen.after_s) * rate_hz)
        samples = self._history.get(end + 1 - count, end + 1)
        now = datetime.fromtimestamp(clock.wall_ns() * 1e-9, UTC)
        name, directory = f"mismatch-{now:%Y%m%d-%H%M%S}", config.watch_directory
        path = directory / f"{name}.csv"
        try:
            directory.mkdir(mode=0o700, parents=True, exist_ok=True)
            old = sorted(directory.glob("mismatch-*.csv"))
            for file in old[: max(0, len(old) + 1 - chosen.keep)]:
                drop_case(file)
            assert self._model_used is not None
            model = load_model(self._model_used)
            units = (model.drive_unit, model.displacement_unit)
            notes = {
                "kept by": f"the mismatch watch of {config.name}",
                "figure": self._figure_flagged,
            }
            with Recorder(path, config.actuator.gain, units, origin, notes) as recorder:
                recorder.add(samples)
            seq, *when = self._flagged
            case = describe_case(config, name, self._figure_flagged, (when[0], when[1]))
            self._cases.begin(path, seq, end, origin, case, self._model_used)
        except (OSError, DehystError) as error:
            self._report(3, "mismatch", f"the recording around the mismatch is not kept: {error}")
            return
        words = (path, "--model", config.model.file, "-o", path.with_suffix(""))
        self._report(
            2,
            "mismatch",
            f"recording kept; to learn more: dehyst diagnose {shlex.join(map(str, words))}",
        )
