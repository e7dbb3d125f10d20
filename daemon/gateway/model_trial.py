"""Puts an accepted model into use, and restores the previous one if the error does not fall.

The loop loads the model with its own reload: the model is advanced along the past drive, and the
output moves to it gradually, within range and slew limits. dehyst.models.mismatch.trial decides
whether the error has fallen. A trial has a time limit, after which it is decided on what was seen.
A gateway that starts during a trial continues it from the run folder, with the same time limit.
"""

import math
import os
import signal
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dehyst.daemon import clock
from dehyst.daemon.bus.messages import DoctorState
from dehyst.daemon.config import Config
from dehyst.daemon.config.drives import drive_range
from dehyst.daemon.files import cases
from dehyst.daemon.files.cases import OfferTest
from dehyst.daemon.files.chosen import Accepted, forget_accepted, read_accepted, write_accepted
from dehyst.daemon.files.models import load_model
from dehyst.daemon.gateway.previous_model import Past, PreviousModel
from dehyst.daemon.rings.records import Flag, State, model_digest
from dehyst.models.cascade.reach import displacement_range
from dehyst.models.errors import DehystError, NotNow
from dehyst.models.mismatch.trial import (
    TRIAL,
    ErrorMeter,
    Errors,
    OfferErrors,
    Samples,
    Verdict,
    judge_trial,
    longest_trial_s,
    settle_trial,
)
from dehyst.models.modelfile import dumps, loads

TAKEN_S = 20.0
"""A loop that does not run the model after this time [s] has refused it."""
MOVED_S = 1.0  # after this long without motion the stage rests, and the trial waits
USELESS = Flag.SENSOR_INVALID | Flag.SENSOR_HELD | Flag.WRITE_FAILED
"""Flags of samples without a reading to compare a model with."""
NOT_FOLLOWED = Flag.UNREACHABLE | Flag.SLEW | Flag.RANGE | Flag.APPROACH
"""Flags of samples whose model error counts but whose tracking error does not, as the target was
not followed for another reason."""
Over = tuple[str, DoctorState, str]
"""(case, new state, reason in words)."""


class ModelTrial:
    """Runs the trial of an accepted model. core: returns (process of the loop, file of its model);
    (0, None): the loop does not run. past: returns samples that are kept."""

    def __init__(
        self, config: Config, core: Callable[[], tuple[int, Path | None]], past: Past
    ) -> None:
        self._config, self._core, self._past = config, core, past
        period_s = config.period_ns * 1e-9
        self._meter = ErrorMeter(config.doctor.trial_s, period_s)
        self._period_s, self._lock = period_s, threading.Lock()
        self._place, self._still_s = math.nan, MOVED_S
        self._target = math.nan  # of the newest sample
        self._least = 0.0  # distance that counts as motion; 0: not known yet
        self._skip_s = 0.0
        self._before: PreviousModel | None = None
        self._on_trial: Accepted | None = None
        self._tested: OfferTest | None = None
        self._digest, self._unit = "", ""
        self._taken = self._was_taken = False  # the loop runs the model now; has ever run it
        self._other_ns = 0  # since when the loop has run another model; 0: it does not
        self._end_ns, self._doubt = 0, ""
        self.limit_s = longest_trial_s(config.doctor.trial_s, config.doctor.trial_limit_s)

    @property
    def case_on_trial(self) -> str:
        """Return the case whose model is on trial; "": none."""
        return "" if self._on_trial is None else self._on_trial.case

    def why_not(self, made_for: Path) -> str:
        """Return why no model can be put into use now; "": it can. made_for: file of the model that
        the offer would replace."""
        _, running = self._core()
        if running is None:
            return "the loop does not run"
        if self._digest_of(made_for) != running.stem.removeprefix("model-"):
            return "the loop now runs another model; this offer was for the previous one"
        return ""

    def begin(self, name: str, offer: int, folder: Path, tested: OfferTest) -> None:
        """Write the offered model and ask the loop to reload. Raises OSError, DehystError."""
        config = self._config
        text = dumps(load_model(folder / cases.OFFERED))
        before, errors = read_accepted(config.directory), self._errors_now()
        accepted = Accepted(
            offer=offer,
            case=name,
            instead_of=model_digest(dumps(load_model(config.model.file))),
            model=text,
            before=before.model if before is not None else "",
            model_error=_kept(errors.model),
            tracking_error=_kept(errors.tracking),
            target_steps=_kept(errors.steps),
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
        """Resume a trial that an earlier gateway has begun."""
        accepted = read_accepted(self._config.directory)
        if accepted is None or not accepted.trial or accepted.tested is None:
            return
        left_s = self.limit_s
        if accepted.begun_wall_ns:  # if the wall clock was set back, no longer than a new trial
            left_s -= max(0.0, (clock.wall_ns() - accepted.begun_wall_ns) / clock.NS)
        self._follow(accepted, accepted.tested, left_s)

    def _follow(self, accepted: Accepted, tested: OfferTest, left_s: float) -> None:
        with suppress(DehystError):
            model = loads(accepted.before) if accepted.before else None
            before = model or load_model(self._config.model.file)
            self._before = PreviousModel(self._config, before, self._past)
        self._digest, self._other_ns = model_digest(accepted.model), clock.monotonic_ns()
        self._end_ns, self._doubt = clock.monotonic_ns() + round(left_s * clock.NS), ""
        self._unit = loads(accepted.model).displacement_unit
        self._taken = self._was_taken = False
        self._tested, self._on_trial = tested, accepted

    def check_outcome(self, now_ns: int) -> Over | None:
        """Return the outcome if the trial is over, else None."""
        trial, tested = self._on_trial, self._tested
        if trial is None or tested is None:
            return None
        late = now_ns >= self._end_ns
        if why := self._not_running(now_ns, late):
            return trial.case, "returned", self.restore_previous_model(trial.case, why)
        if not self._taken:
            return None
        with self._lock:
            full, after = self._meter.full, self._meter.errors
        promise = OfferErrors(tested.in_use, tested.offered, tested.noise)
        judged = _errors_before(trial), after, promise, self._unit
        verdict = judge_trial(*judged) if full else Verdict("open", "")
        if verdict.outcome == "goes" and not late and not self._doubt:
            self._doubt = verdict.why  # measure again: errors of the initial state decay
            self._begin_meter()
            return None
        if verdict.outcome == "open" and late:
            verdict = settle_trial(*judged, self.limit_s)
            if self._doubt and after.seconds < TRIAL.least_s:
                verdict = Verdict("goes", self._doubt)
        if verdict.outcome == "open":
            return None
        if verdict.outcome == "goes":
            return trial.case, "returned", self.restore_previous_model(trial.case, verdict.why)
        self._on_trial = self._before = None
        why = verdict.why
        try:
            write_accepted(self._config.directory, _confirmed(trial))
        except OSError as error:
            why += f" (not kept: {error.strerror}; another gateway tries it again)"
        return trial.case, "accepted", why

    def _not_running(self, now_ns: int, late: bool) -> str:
        """Return why the loop does not run the model on trial although it has had the time, else
        ""."""
        _, running = self._core()
        if running is not None and running.stem == f"model-{self._digest}":
            self._other_ns = 0
            if not self._taken:
                self._begin_meter()
                self._taken = self._was_taken = True
            return ""
        self._taken = False  # what it runs now is not judged
        if running is None:
            self._other_ns = 0
            return "no loop runs it" if late else ""  # the loop loads it when it starts
        self._other_ns = self._other_ns or now_ns
        if not late and now_ns - self._other_ns <= TAKEN_S * clock.NS:
            return ""
        return "the loop runs another model" if self._was_taken else "the loop did not accept it"

    def progress(self, now_ns: int) -> str:
        """Describe the progress of the trial in words; "": no trial is running."""
        trial = self._on_trial
        if trial is None:
            return ""
        with self._lock:
            seconds, full, still_s = self._meter.errors.seconds, self._meter.full, self._still_s
        wanted_s, left_s = self._config.doctor.trial_s, max(0.0, (self._end_ns - now_ns) / clock.NS)
        if not self._taken:
            seen = "the loop does not run it now"
        elif full:
            seen = "the motion so far does not distinguish it from the model before"
        else:
            seen = f"{seconds:.1f} of {wanted_s:g} s of motion seen"
            seen += ", in a second window, as the first was against it" if self._doubt else ""
            seen += ", waiting for the stage to move" if still_s > MOVED_S else ""
        return (
            f"the model offered for {trial.case} is on trial: {seen}; it ends in {left_s:.0f} s at "
            "the latest"
        )

    def _begin_meter(self) -> None:
        """Restart the error measurement, after the transition to the other model."""
        with self._lock:
            self._meter.clear()
            self._skip_s = TRIAL.settle_s

    def restore_previous_model(self, name: str, why: str) -> str:
        """Restore the previous model; return what was done, in words."""
        accepted = read_accepted(self._config.directory)
        self._on_trial = self._before = None
        self._begin_meter()
        if accepted is None or accepted.case != name:
            return f"the model is no longer in use: {why}"
        try:
            if accepted.before:
                write_accepted(self._config.directory, _before(accepted))
            else:
                forget_accepted(self._config.directory)
            self._reload()
        except (OSError, DehystError) as error:
            return f"the previous model could not be restored ({error}), although {why}"
        return f"the previous model is restored: {why}"

    def take_samples(self, samples: NDArray[Any]) -> None:
        """Evaluate samples (n,) of the loop, in order."""
        before = self._before
        other = before.expect(samples) if before is not None else np.full(samples.size, np.nan)
        target = np.where(samples["state"] == State.RUNNING, samples["target"], np.nan)
        steps = np.diff(target, prepend=self._target)
        self._target = float(target[-1])
        good = (samples["flags"] & int(USELESS)) == 0
        good &= np.isfinite(samples["measured"]) & np.isfinite(samples["predicted"])
        good &= (samples["state"] == State.RUNNING) & np.isfinite(samples["target"])
        if not good.any():
            return
        seconds = samples.size * self._period_s
        if not self._moves(samples["predicted"][good], seconds):
            return
        measured, flags = samples["measured"], samples["flags"]
        batch = Samples(
            own=measured - samples["predicted"],
            other=measured - other,
            error=measured - samples["target"],
            steps=steps,
            good=good,
            tracked=good & ((flags & int(NOT_FOLLOWED)) == 0),
            without=(flags & int(Flag.FALLBACK)) != 0,
            held=(flags & int(Flag.SENSOR_HELD)) != 0,
        )
        with self._lock:
            if self._skip_s > 0.0:
                self._skip_s -= seconds
                return
            self._meter.add(batch)

    def _moves(self, predicted: NDArray[np.float64], seconds: float) -> bool:
        """Return whether the stage has moved within MOVED_S, according to the model."""
        place, way = float(predicted[-1]), float(np.ptp(predicted))
        least = self._least_motion()
        if way > least or not abs(place - self._place) <= least:
            self._still_s, self._place = 0.0, place
        else:
            self._still_s += seconds
        return self._still_s <= MOVED_S

    def _least_motion(self) -> float:
        """Return the displacement that counts as motion, from the reach of the configured model,
        which is accurate enough."""
        if not self._least:
            with suppress(DehystError):
                model = load_model(self._config.model.file)
                low, high = displacement_range(model, *drive_range(self._config, model))
                self._least = TRIAL.motion * (high - low)
        return self._least

    def _reload(self) -> None:
        """Ask the loop to reload. Raises NotNow."""
        pid, _ = self._core()
        try:
            if not pid:
                raise ProcessLookupError
            os.kill(pid, signal.SIGHUP)
        except (ProcessLookupError, PermissionError):
            raise NotNow(
                "the loop cannot be asked to reload; it loads the model at its start"
            ) from None

    @staticmethod
    def _digest_of(path: Path) -> str:
        try:
            return model_digest(dumps(load_model(path)))
        except DehystError:
            return ""


def _number(value: float | None) -> float:
    return math.nan if value is None else value


def _kept(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _errors_before(trial: Accepted) -> Errors:
    """Return the errors of the previous model when the one on trial was put into use."""
    return Errors(
        _number(trial.model_error),
        _number(trial.tracking_error),
        0.0,
        steps=_number(trial.target_steps),
    )


def _confirmed(accepted: Accepted) -> Accepted:
    return Accepted(
        offer=accepted.offer,
        case=accepted.case,
        instead_of=accepted.instead_of,
        model=accepted.model,
        before=accepted.before,
        trial=False,
    )


def _before(accepted: Accepted) -> Accepted:
    """Return the entry of the model that was accepted before this one."""
    return Accepted(
        offer=0,
        case="an earlier case",
        instead_of=accepted.instead_of,
        model=accepted.before,
        trial=False,
    )
