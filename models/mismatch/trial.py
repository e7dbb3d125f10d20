"""A model on trial: does the error fall once the loop runs it?

Two figures over so many seconds of motion: the model's own error (measured minus predicted,
without its mean: a zero that has moved is no error of the model) and the tracking error (measured
minus target).

The model's own error needs no particular motion: it follows the voltage that was really written,
whatever made it (set-points, steps, a trajectory, with or without preview). What it is compared
with is what the model before leaves of the same samples, so that a stage that is moved by less, or
in another way, than when the offer was tested is judged alike. It has to come down by half of what
its replay promised, in power above the noise. Where the model before leaves so little of this
motion that the promise would not be seen, nothing is decided yet.

The tracking error depends on the motion as well as on the model. It counts where the targets move
as they did before the switch: it must not have grown, and must have fallen where it was the
model's, unless the inverse had to do without its preview.

A first window that speaks against the model is judged once more: the state in which it begins is
led along a bounded past, and what is older (creep, a turning point) shows as an error that passes.
Pure: no clock.
"""

import math
from collections import deque
from typing import Literal, NamedTuple

import numpy as np

from dehyst.models.model import Floats
from dehyst.models.recording import Bools


class TrialTuning(NamedTuple):
    """Judged by tests/benchmarks/daemon/second_act.py and trials.py."""

    settle_s: float = 2.0  # after the switch: the glide, and what the trim finds anew
    promised: float = 0.5  # of what the replay has removed, in rms
    seen_noises: float = 2.0  # what the model before leaves, at the least, to be compared with;
    seen_share: float = 0.7  # or so much of what it left in the test
    worse_noises: float = 1.0  # by which an error is larger than another, in power
    grown: float = 1.1  # times the tracking error before
    mostly: float = 0.8  # of the model's error: a tracking error so near to it was mostly its own,
    fallen: float = 0.8  # and must be at most so much of what it was
    alike: float = 2.0  # factor of the targets' steps in rms up to which tracking is compared
    without: float = 0.5  # of the samples without preview: tracking need not have fallen
    motion: float = 0.002  # of the reach, between batches: the stage is moved
    least_s: float = 1.0  # of motion, from which evidence counts when time is up
    limit: float = 30.0  # times the seconds of motion: the bound on the time of a trial,
    limit_s: float = 300.0  # at the least: one slow line of a scan, or a coffee


TRIAL = TrialTuning()

Outcome = Literal["stays", "goes", "open"]
"""open: what was seen does not decide it."""


class Errors(NamedTuple):
    """rms over so many seconds of motion. other: what the model before leaves of the same samples;
    steps: of the targets from sample to sample; without: share of the samples whose inverse had
    to do without its preview. NaN: not known."""

    model: float
    tracking: float
    seconds: float
    other: float = math.nan
    steps: float = math.nan
    without: float = 0.0


class Verdict(NamedTuple):
    """What becomes of the model, and why, in words."""

    outcome: Outcome
    why: str


def longest_trial_s(motion_s: float, limit_s: float | None) -> float:
    """Bound on the time of a trial that wants this much motion; limit_s: as configured."""
    return max(TRIAL.limit_s, TRIAL.limit * motion_s) if limit_s is None else limit_s


class OfferErrors(NamedTuple):
    """What its test on later telemetry left of the model before and of the offered one, and the
    noise: rms."""

    in_use: float
    offered: float
    noise: float


class Samples(NamedTuple):
    """A batch (n,): measured minus predicted; the same of the model before, NaN where that is not
    known; measured minus target; the step of the target to each sample, NaN: not known; which
    samples count for the models, and which for
    tracking; where the inverse did without its preview; where a reading was not due."""

    own: Floats
    other: Floats
    error: Floats
    steps: Floats
    good: Bools
    tracked: Bools
    without: Bools
    held: Bools


_SUMS = np.dtype(
    [
        (name, "<f8")
        for name in (
            "n",
            "seconds",
            "own",
            "own2",
            "n_other",
            "other",
            "other2",
            "n_tracked",
            "error2",
            "without",
            "n_steps",
            "steps2",
        )
    ]
)


class ErrorMeter:
    """The figures of the newest `seconds` of motion."""

    def __init__(self, seconds: float, period_s: float) -> None:
        self._parts: deque[np.ndarray] = deque()
        self._wanted_s, self._period_s = seconds, period_s
        self._seconds = 0.0

    def clear(self) -> None:
        """Begin anew."""
        self._parts.clear()
        self._seconds = 0.0

    def add(self, s: Samples) -> None:
        """A batch."""
        if not s.good.any():
            return
        part = np.zeros((), _SUMS)
        own, other = s.own[s.good], s.other[s.good]
        known = np.isfinite(other)
        other, steps = other[known], s.steps[np.isfinite(s.steps)]
        error = s.error[s.tracked]
        part["n"], part["own"], part["own2"] = own.size, own.sum(), own @ own
        part["n_other"], part["other"], part["other2"] = other.size, other.sum(), other @ other
        part["n_tracked"], part["error2"] = error.size, error @ error
        part["without"] = np.count_nonzero(s.without & s.tracked)
        part["n_steps"], part["steps2"] = steps.size, steps @ steps
        part["seconds"] = np.count_nonzero(s.good | s.held) * self._period_s
        self._parts.append(part)
        self._seconds += float(part["seconds"])
        while self._parts and self._seconds - float(self._parts[0]["seconds"]) >= self._wanted_s:
            self._seconds -= float(self._parts.popleft()["seconds"])

    @property
    def full(self) -> bool:
        """Enough was seen."""
        return self._seconds >= self._wanted_s * (1.0 - 1e-9)

    @property
    def errors(self) -> Errors:
        """NaN where nothing was seen."""
        if not self._parts:
            return Errors(math.nan, math.nan, 0.0)
        t = {name: float(sum(float(p[name]) for p in self._parts)) for name in _SUMS.names or ()}
        return Errors(
            _spread(t["n"], t["own"], t["own2"]),
            math.sqrt(t["error2"] / t["n_tracked"]) if t["n_tracked"] else math.nan,
            t["seconds"],
            # of all the samples, or of none: otherwise the two are not of the same
            _spread(t["n_other"], t["other"], t["other2"]) if t["n_other"] == t["n"] else math.nan,
            math.sqrt(t["steps2"] / t["n_steps"]) if t["n_steps"] else math.nan,
            t["without"] / t["n_tracked"] if t["n_tracked"] else 0.0,
        )


def _spread(n: float, first: float, square: float) -> float:
    """rms without the mean."""
    return math.sqrt(max(0.0, square / n - (first / n) ** 2)) if n else math.nan


def judge_trial(before: Errors, after: Errors, promise: OfferErrors, unit: str) -> Verdict:
    """Whether the model on trial stays. before: of the model before, NaN where nothing moved before
    the switch; after: of the one on trial."""
    if not math.isfinite(after.model):
        return Verdict("open", "the stage has not moved with a valid reading")
    noise2, seconds = promise.noise**2, after.seconds
    paired = math.isfinite(after.other)
    known = after.other if paired else before.model if math.isfinite(before.model) else math.inf
    known = known if paired else min(known, promise.in_use)
    leaves = "leaves" if paired else "had"
    had = f"the previous model {leaves} {known:.3g}"
    enough = promise.offered + (1.0 - TRIAL.promised) * max(0.0, promise.in_use - promise.offered)
    part2 = min(1.0, (enough / max(promise.in_use, 1e-300)) ** 2)
    least = min(TRIAL.seen_noises * promise.noise, TRIAL.seen_share * promise.in_use)
    most = math.sqrt(noise2 + part2 * max(0.0, known**2 - noise2))
    if known < least:
        if after.model**2 > known**2 + TRIAL.worse_noises * noise2:
            return Verdict(
                "goes",
                f"the offered one's error is {after.model:.3g} {unit} within {seconds:.0f} s of "
                f"motion, and {had}",
            )
        return Verdict(
            "open",
            f"the motion so far does not distinguish the two models: within {seconds:.0f} s the "
            f"offered one's error is {after.model:.3g} {unit}, and {had}",
        )
    if not after.model <= most:
        return Verdict(
            "goes",
            f"the offered one's error has not fallen to {most:.3g} {unit} within {seconds:.0f} s "
            f"of motion: it is {after.model:.3g} {unit}, {had}, and the test promised "
            f"{promise.offered:.3g}",
        )
    why = _tracks_worse(before, after, promise.noise, unit)
    return (
        Verdict("goes", why)
        if why
        else Verdict("stays", _describe_confirmed(before, after, had, unit))
    )


def _tracks_worse(before: Errors, after: Errors, noise: float, unit: str) -> str:
    """In words, where the stage follows worse, or no better; "" also where the motion is another
    one than before the switch."""
    other = _compare_motion(before, after)
    if not math.isfinite(before.tracking) or other > TRIAL.alike:
        return ""
    words = f"{unit} within {after.seconds:.0f} s of motion"
    if (
        math.isfinite(after.tracking)
        and after.tracking > TRIAL.grown * other * before.tracking + noise
    ):
        return (
            f"the tracking error has grown from {before.tracking:.3g} to {after.tracking:.3g} "
            f"{words}"
        )
    own = TRIAL.mostly * before.model <= before.tracking <= before.model / TRIAL.mostly
    if (
        own
        and after.without < TRIAL.without
        and after.tracking > TRIAL.fallen * other * before.tracking
    ):
        return (
            f"the tracking error has not fallen within {after.seconds:.0f} s of motion: "
            f"{after.tracking:.3g} {unit}, before {before.tracking:.3g}"
        )
    return ""


def _compare_motion(before: Errors, after: Errors) -> float:
    """By which factor the targets moved faster or slower than before; 1 where that is not known."""
    if not (math.isfinite(before.steps) and math.isfinite(after.steps)):
        return 1.0
    less, more = sorted((before.steps, after.steps))
    return more / less if less else math.inf if more else 1.0


def _describe_confirmed(before: Errors, after: Errors, had: str, unit: str) -> str:
    """In words, that the model on trial stays."""
    says = (
        f"the offered model is confirmed over {after.seconds:.0f} s of motion: its error is "
        f"{after.model:.3g} {unit}"
    )
    if math.isfinite(after.other) or math.isfinite(before.model):
        says += f", {had}"
    if not math.isfinite(after.tracking):
        return says
    was = f", before {before.tracking:.3g}" if math.isfinite(before.tracking) else ""
    return f"{says}; tracking error {after.tracking:.3g}{was}"


def settle_trial(
    before: Errors, after: Errors, promise: OfferErrors, unit: str, limit_s: float
) -> Verdict:
    """The same when the time is up: without evidence against it the model stays. It was better on
    later telemetry than it was fitted to, somebody has accepted it, and the watch goes on; going
    back would put a model to work that is known not to fit."""
    seen = f"the trial ends after its limit of {limit_s:.0f} s"
    if after.seconds >= TRIAL.least_s:
        verdict = judge_trial(before, after, promise, unit)
        if verdict.outcome != "open":
            return Verdict(verdict.outcome, f"{seen}: {verdict.why}")
        why = verdict.why
    elif after.seconds > 0.0:
        why = f"the stage has moved for {after.seconds:.1f} s only"
    else:
        why = "the stage has not moved with a valid reading"
    return Verdict(
        "stays", f"{seen}: the offered model stays, unconfirmed: {why}; no evidence contradicts it"
    )
