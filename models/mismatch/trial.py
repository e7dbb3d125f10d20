"""A model on trial: does the error fall once the loop runs it?

Two figures are measured over a given time of motion: the model's own error (measured minus
predicted, without its mean: a zero that has moved is no error of the model) and the tracking error
(measured minus target).

The model's own error needs no particular motion: it follows from the voltage that was really
written, whatever produced it (set-points, steps, a trajectory, with or without preview). It is
compared with the previous model's error on the same samples, so that a stage that moves less than,
or otherwise than, when the offer was tested is judged by the same standard. It has to fall by half
of what its replay promised, in power above the noise. Where the previous model's error on this
motion is so small that the promised improvement would not be visible, nothing is decided yet.

The tracking error depends on the motion as well as on the model. It counts where the targets move
as they did before the switch: it must not have grown, and must have fallen if the model caused it,
unless the inverse had to run without its preview.

If the first window is evidence against the model, a second one is judged: the initial state is
computed from a bounded past, and older influences (creep, a turning point) appear as an error that
decays. Pure: no clock.
"""

import math
from collections import deque
from typing import Literal, NamedTuple

import numpy as np

from dehyst.models.model import Floats
from dehyst.models.recording import Bools


class TrialTuning(NamedTuple):
    """Judged by tests/benchmarks/daemon/second_act.py and trials.py."""

    settle_s: float = 2.0  # after the switch: the glide, and the trim's readjustment
    promised: float = 0.5  # of the rms that the replay removed
    seen_noises: float = 2.0  # least error of the previous model for a comparison,
    seen_share: float = 0.7  # or this share of its error in the test
    worse_noises: float = 1.0  # in power, by which an error counts as larger than another
    grown: float = 1.1  # times the tracking error before: it has grown
    mostly: float = 0.8  # of the model's error: a tracking error this near was mostly the model's,
    fallen: float = 0.8  # and must fall to this share of it
    alike: float = 2.0  # largest ratio of the targets' rms steps for which tracking is compared
    without: float = 0.5  # of the samples without preview: tracking need not fall
    motion: float = 0.002  # of the reach, between batches: the stage moves
    least_s: float = 1.0  # of motion, from which on evidence counts at the time limit
    limit: float = 30.0  # times the seconds of motion: time limit of a trial,
    limit_s: float = 300.0  # at least: covers one slow scan line, or a break


TRIAL = TrialTuning()

Outcome = Literal["stays", "goes", "open"]
"""open: the evidence does not decide it."""


class Errors(NamedTuple):
    """rms over that many seconds of motion. other: the previous model's error on the same samples;
    steps: of the targets from sample to sample; without: share of the samples whose inverse had to
    run without its preview. NaN: not known."""

    model: float
    tracking: float
    seconds: float
    other: float = math.nan
    steps: float = math.nan
    without: float = 0.0


class Verdict(NamedTuple):
    """Whether the model stays, and the reason in words."""

    outcome: Outcome
    why: str


def longest_trial_s(motion_s: float, limit_s: float | None) -> float:
    """Return the time limit of a trial that needs this much motion; limit_s: as configured."""
    return max(TRIAL.limit_s, TRIAL.limit * motion_s) if limit_s is None else limit_s


class OfferErrors(NamedTuple):
    """rms errors of the previous and of the offered model in the test on later telemetry, and the
    noise."""

    in_use: float
    offered: float
    noise: float


class Samples(NamedTuple):
    """A batch (n,): measured minus predicted; the same for the previous model, NaN where not known;
    measured minus target; the step of the target to each sample, NaN: not known; which samples
    count for the models, and which for tracking; where the inverse ran without its preview; where a
    reading was not due."""

    own: Floats
    other: Floats
    error: Floats
    steps: Floats
    good: Bools
    tracked: Bools
    without: Bools
    held: Bools


class ErrorMeter:
    """Errors over the newest `seconds` of motion."""

    def __init__(self, seconds: float, period_s: float) -> None:
        self._parts: deque[dict[str, float]] = deque()
        self._wanted_s, self._period_s = seconds, period_s
        self._seconds = 0.0

    def clear(self) -> None:
        """Start again."""
        self._parts.clear()
        self._seconds = 0.0

    def add(self, s: Samples) -> None:
        """Add a batch."""
        if not s.good.any():
            return
        own, other = s.own[s.good], s.other[s.good]
        known = np.isfinite(other)
        other, steps = other[known], s.steps[np.isfinite(s.steps)]
        error = s.error[s.tracked]
        seconds = float(np.count_nonzero(s.good | s.held) * self._period_s)
        part: dict[str, float] = {
            "seconds": seconds,
            "n": own.size,
            "own": float(own.sum()),
            "own2": float(own @ own),
            "n_other": other.size,
            "other": float(other.sum()),
            "other2": float(other @ other),
            "n_tracked": error.size,
            "error2": float(error @ error),
            "without": float(np.count_nonzero(s.without & s.tracked)),
            "n_steps": steps.size,
            "steps2": float(steps @ steps),
        }
        self._parts.append(part)
        self._seconds += seconds
        while self._parts and self._seconds - self._parts[0]["seconds"] >= self._wanted_s:
            self._seconds -= self._parts.popleft()["seconds"]

    @property
    def full(self) -> bool:
        """Whether enough motion was seen."""
        return self._seconds >= self._wanted_s * (1.0 - 1e-9)

    @property
    def errors(self) -> Errors:
        """The errors; NaN where nothing was seen."""
        if not self._parts:
            return Errors(math.nan, math.nan, 0.0)
        t = {name: float(sum(part[name] for part in self._parts)) for name in self._parts[0]}
        return Errors(
            _spread(t["n"], t["own"], t["own2"]),
            math.sqrt(t["error2"] / t["n_tracked"]) if t["n_tracked"] else math.nan,
            t["seconds"],
            # known for all samples, or not used: the two must be of the same samples
            _spread(t["n_other"], t["other"], t["other2"]) if t["n_other"] == t["n"] else math.nan,
            math.sqrt(t["steps2"] / t["n_steps"]) if t["n_steps"] else math.nan,
            t["without"] / t["n_tracked"] if t["n_tracked"] else 0.0,
        )


def _spread(n: float, first: float, square: float) -> float:
    """Return the rms without the mean."""
    return math.sqrt(max(0.0, square / n - (first / n) ** 2)) if n else math.nan


def judge_trial(before: Errors, after: Errors, promise: OfferErrors, unit: str) -> Verdict:
    """Decide whether the model on trial stays. before: errors of the previous model, NaN where
    nothing moved before the switch; after: those of the one on trial."""
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
    if why:
        return Verdict("goes", why)
    return Verdict("stays", _describe_confirmed(before, after, had, unit))


def _tracks_worse(before: Errors, after: Errors, noise: float, unit: str) -> str:
    """Return, in words, that the stage tracks worse, or no better; "" otherwise, also where the
    motion differs from that before the switch."""
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
    """Return the factor by which the targets moved faster or slower than before; 1 where it is not
    known."""
    if not (math.isfinite(before.steps) and math.isfinite(after.steps)):
        return 1.0
    less, more = sorted((before.steps, after.steps))
    return more / less if less else math.inf if more else 1.0


def _describe_confirmed(before: Errors, after: Errors, had: str, unit: str) -> str:
    """Return, in words, that the model on trial stays."""
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
    """Decide when the time is up: without evidence against it the model stays. It was better on
    telemetry later than that it was fitted to, a user has accepted it, and monitoring continues;
    going back would reinstate a model that is known not to fit."""
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
