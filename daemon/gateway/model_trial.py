"""Puts an accepted model to work and takes it back where its error does not fall.

The loop loads the model by its own reload: led along the past drive, glided in, within range and
slew. What counts as fallen: dehyst.models.mismatch.trial. A trial has a bound on its time, after
which it is settled on what was seen. A gateway that begins in the midst of a trial goes on with it
from what the run folder says, with the same bound.
"""

import math
import os
import signal
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dehyst.daemon import clock
from dehyst.daemon.bus.messages import DoctorState
from dehyst.daemon.config import Config
from dehyst.daemon.files import cases
from dehyst.daemon.files.cases import OfferTest
from dehyst.daemon.files.chosen import (
    Accepted,
    forget_accepted,
    read_accepted,
    write_accepted,
)
from dehyst.daemon.files.models import load_model
from dehyst.daemon.rings.records import Flag, State, model_digest
from dehyst.models.errors import DehystError, NotNow
from dehyst.models.mismatch.trial import (
    TRIAL,
    ErrorMeter,
    Errors,
    longest_trial_s,
    say_proven,
    say_unproven,
    why_back,
    why_worse,
)
from dehyst.models.modelfile import dumps, loads

TAKEN_S = 20.0
"""A loop that does not run the model by then has refused it."""
MOVED_S = 1.0
NOT_JUDGED = Flag.SENSOR_INVALID | Flag.SENSOR_HELD | Flag.APPROACH | Flag.WRITE_FAILED
"""Nothing is known of the model's error: no new reading, or a state that is on its way."""
NOT_FOLLOWED = Flag.UNREACHABLE | Flag.SLEW | Flag.RANGE | Flag.FALLBACK
"""The model's error counts; a target that is not met is not the model's fault."""
Over = tuple[str, DoctorState, str]
"""(case, what became of it, in words)."""


class ModelTrial:
    """core: (process of the loop, file of the model that it runs); (0, None): it does not run."""

    def __init__(self, config: Config, core: Callable[[], tuple[int, Path | None]]) -> None:
        self._config, self._core = config, core
        period_s = config.period_ns * 1e-9
        self._meter = ErrorMeter(config.doctor.trial_s, period_s)
        self._period_s, self._lock = period_s, threading.Lock()
        self._place, self._still_s = math.nan, MOVED_S
        self._skip_s = 0.0
        self._on_trial: Accepted | None = None
        self._tested: OfferTest | None = None
        self._digest, self._begun_ns, self._taken, self._unit = "", 0, False, ""
        self._end_ns, self._doubt = 0, ""
        self.limit_s = longest_trial_s(config.doctor.trial_s, config.doctor.trial_limit_s)

    @property
    def on_trial(self) -> str:
        """The case whose model is on trial; "": none is."""
        return "" if self._on_trial is None else self._on_trial.case

    def why_not(self, made_for: Path) -> str:
        """Why no model can be put to work now; "": it can. made_for: file of the model that the
        offer is about."""
        _, running = self._core()
        if running is None:
            return "the loop does not run"
        if self._digest_of(made_for) != running.stem.removeprefix("model-"):
            return "the loop runs another model by now; this offer was about the one before"
        return ""

    def begin(self, name: str, offer: int, folder: Path, tested: OfferTest) -> None:
        """Lay the offered model before the loop. Raises OSError, DehystError."""
        config = self._config
        text = dumps(load_model(folder / cases.OFFERED))
        before, errors = read_accepted(config.directory), self._errors_now()
        accepted = Accepted(
            offer=offer,
            case=name,
            instead_of=model_digest(dumps(load_model(config.model.file))),
            model=text,
            before=before.model if before is not None else "",
            model_error=errors.model if math.isfinite(errors.model) else None,
            tracking_error=errors.tracking if math.isfinite(errors.tracking) else None,
            begun_wall_ns=clock.wall_ns(),
            tested=tested,
        )
        write_accepted(config.directory, accepted)
        self._follow(accepted, tested, self.limit_s)
        self._reload()

    def _errors_now(self) -> Errors:
        with self._lock:
            return self._meter.errors

    def resume(self) -> None:
        """Go on with the trial that a gateway before this one has begun."""
        accepted = read_accepted(self._config.directory)
        if accepted is None or not accepted.trial or accepted.tested is None:
            return
        left_s = self.limit_s
        if accepted.begun_wall_ns:  # a wall clock set back gives it no more than a new one
            left_s -= max(0.0, (clock.wall_ns() - accepted.begun_wall_ns) / clock.NS)
        self._follow(accepted, accepted.tested, left_s)

    def _follow(self, accepted: Accepted, tested: OfferTest, left_s: float) -> None:
        self._digest, self._begun_ns = model_digest(accepted.model), clock.monotonic_ns()
        self._end_ns, self._doubt = self._begun_ns + round(left_s * clock.NS), ""
        self._unit = loads(accepted.model).displacement_unit
        self._taken, self._tested, self._on_trial = False, tested, accepted

    def look(self, now_ns: int) -> Over | None:
        """Whether the trial is over; what became of it."""
        trial, tested = self._on_trial, self._tested
        if trial is None or tested is None:
            return None
        _, running = self._core()
        late = now_ns >= self._end_ns
        if not self._taken:
            if running is not None and running.stem == f"model-{self._digest}":
                self._begin_meter()
                self._taken = True
            elif late or (running is not None and now_ns - self._begun_ns > TAKEN_S * clock.NS):
                why = "the loop did not take it" if running is not None else "no loop has run it"
                return trial.case, "returned", self.go_back(trial.case, why)
            return None
        with self._lock:
            full, after = self._meter.full, self._meter.errors
        if not full and not late:
            return None
        before = Errors(_number(trial.model_error), _number(trial.tracking_error), 0.0)
        judged = before, after, (tested.in_use, tested.offered), tested.noise, self._unit
        wanted_s = self._config.doctor.trial_s
        proven = full or after.seconds >= TRIAL.enough * wanted_s
        why = why_back(*judged) if proven else self._doubt or why_worse(*judged)
        if why and not late and not self._doubt:
            self._doubt = why  # once more: what the state did not know of the past passes
            self._begin_meter()
            return None
        if why:
            return trial.case, "returned", self.go_back(trial.case, why)
        self._on_trial = None
        write_accepted(self._config.directory, _proven(trial))
        if proven:
            return trial.case, "accepted", say_proven(before, after, self._unit)
        return trial.case, "accepted", say_unproven(after, wanted_s, self.limit_s, self._unit)

    def _begin_meter(self) -> None:
        """Count anew, once the glide to another model is over."""
        with self._lock:
            self._meter.clear()
            self._skip_s = TRIAL.settle_s

    def go_back(self, name: str, why: str) -> str:
        """The model before comes back; in words."""
        accepted = read_accepted(self._config.directory)
        self._on_trial = None
        self._begin_meter()
        if accepted is None or accepted.case != name:
            return f"the model is not at work any more: {why}"
        try:
            if accepted.before:
                write_accepted(self._config.directory, _before(accepted))
            else:
                forget_accepted(self._config.directory)
            self._reload()
        except (OSError, DehystError) as error:
            return f"the model before could not be put back ({error}), although {why}"
        return f"the model before comes back: {why}"

    def see(self, samples: NDArray[Any]) -> None:
        """Samples (n,) of the loop, in their order."""
        good = (samples["flags"] & int(NOT_JUDGED)) == 0
        good &= np.isfinite(samples["measured"]) & np.isfinite(samples["target"])
        good &= (samples["state"] == State.RUNNING) & np.isfinite(samples["predicted"])
        if not good.any():
            return
        seconds = samples.size * self._period_s
        place = float(samples["target"][good][-1])
        least = TRIAL.motion * max(float(np.ptp(samples["target"][good])), abs(place), 1e-9)
        self._still_s = 0.0 if abs(place - self._place) > least else self._still_s + seconds
        if self._still_s == 0.0 or not math.isfinite(self._place):
            self._place = place
        if self._still_s > MOVED_S:
            return
        with self._lock:
            if self._skip_s > 0.0:
                self._skip_s -= seconds
                return
            measured = samples["measured"]
            follows = (samples["flags"] & int(NOT_FOLLOWED)) == 0
            model, tracking = measured - samples["predicted"], measured - samples["target"]
            self._meter.add(model, tracking, good, follows)

    def _reload(self) -> None:
        """Ask the loop. Raises NotNow."""
        pid, _ = self._core()
        try:
            if not pid:
                raise ProcessLookupError
            os.kill(pid, signal.SIGHUP)
        except (ProcessLookupError, PermissionError):
            raise NotNow(
                "the loop cannot be asked to reload; it takes the model at its start"
            ) from None

    @staticmethod
    def _digest_of(path: Path) -> str:
        try:
            return model_digest(dumps(load_model(path)))
        except DehystError:
            return ""


def _number(value: float | None) -> float:
    return math.nan if value is None else value


def _proven(accepted: Accepted) -> Accepted:
    return Accepted(
        offer=accepted.offer,
        case=accepted.case,
        instead_of=accepted.instead_of,
        model=accepted.model,
        before=accepted.before,
        trial=False,
    )


def _before(accepted: Accepted) -> Accepted:
    """The model that was accepted before this one."""
    return Accepted(
        offer=0, case="an earlier case", instead_of=accepted.instead_of, model=accepted.before,
        trial=False,
    )  # fmt: skip
