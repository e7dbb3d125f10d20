"""A model on trial: does the error fall once the loop runs it?

Samples count while the stage follows moving targets with a valid reading. Two figures over so many
seconds of motion, before and after: the model's own error (measured minus predicted, without its
mean: a zero that has moved is no error of the model) and the tracking error (measured minus
target). The model is led by the voltage that was written, whoever made it; its own error counts
even where a limit or an inverse without preview kept the stage from its target, and the tracking
error does not. The model stays where its own error has come down by half of what its replay
promised, and the tracking error has not grown, and has fallen where it was the model's. A first
window that speaks against it is judged once more: the state in which the model begins is led along
a bounded past, and what is older (creep, a turning point) shows as an error that passes. Pure: no
clock.
"""

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from dehyst.models.model import Floats
from dehyst.models.recording import Bools


class TrialTuning(NamedTuple):
    """Judged by tests/benchmarks/daemon/second_act.py."""

    settle_s: float = 2.0  # after the switch: the glide, and what the trim finds anew
    promised: float = 0.5  # of what the replay has removed, in rms
    grown: float = 1.1  # times the tracking error before
    mostly: float = 0.8  # of the model's error: a tracking error that large was mostly its own,
    fallen: float = 0.8  # and must be at most so much of what it was
    enough: float = 0.5  # of the seconds of motion wanted: with as much, judged by the same rule
    limit: float = 30.0  # times the seconds of motion: the bound on the time of a trial,
    limit_s: float = 300.0  # at the least: one slow line of a scan, or a coffee
    motion: float = 0.002  # of the reach, between batches: the stage is moved


TRIAL = TrialTuning()


class Errors(NamedTuple):
    """rms over so many seconds of motion."""

    model: float
    tracking: float
    seconds: float


def longest_trial_s(motion_s: float, limit_s: float | None) -> float:
    """Bound on the time of a trial that wants this much motion; limit_s: as configured."""
    return max(TRIAL.limit_s, TRIAL.limit * motion_s) if limit_s is None else limit_s


class ErrorMeter:
    """The figures of the newest `seconds` of motion."""

    def __init__(self, seconds: float, period_s: float) -> None:
        self._parts: deque[tuple[int, float, float, int, float]] = deque()
        self._wanted, self._period_s = round(seconds / period_s), period_s
        self._count = 0

    def clear(self) -> None:
        """Begin anew."""
        self._parts.clear()
        self._count = 0

    def add(self, residual: Floats, error: Floats, good: Bools, tracked: Bools) -> None:
        """A batch (n,): measured minus predicted, measured minus target, which samples count for
        the model's error, and which of them for the tracking error."""
        r, e = residual[good], error[good & tracked]
        if not r.size:
            return
        self._parts.append((r.size, float(r.sum()), float(r @ r), e.size, float(e @ e)))
        self._count += r.size
        while self._parts and self._count - self._parts[0][0] >= self._wanted:
            self._count -= self._parts.popleft()[0]

    @property
    def full(self) -> bool:
        """Enough was seen."""
        return self._count >= self._wanted

    @property
    def errors(self) -> Errors:
        """NaN where nothing was seen."""
        if not self._count:
            return Errors(math.nan, math.nan, 0.0)
        first, square, tracked, tracking = np.sum([p[1:] for p in self._parts], axis=0)
        first, square = first / self._count, square / self._count
        model = math.sqrt(max(0.0, float(square - first**2)))
        follows = math.sqrt(float(tracking / tracked)) if tracked else math.nan
        return Errors(model, follows, self._count * self._period_s)


def why_back(
    before: Errors, after: Errors, promised: tuple[float, float], noise: float, unit: str
) -> str:
    """Why the model on trial has to go, in words; "": it stays. promised: what its replay left of
    the model before and of itself; NaN: nothing that counts was seen."""
    in_use, offered = promised
    known = before.model if math.isfinite(before.model) else in_use
    enough = offered + (1.0 - TRIAL.promised) * max(0.0, min(known, in_use) - offered)
    if not after.model <= enough:
        return (
            f"the offered one's error has not come down to {enough:.3g} {unit} within "
            f"{after.seconds:.0f} s of motion: it is {after.model:.3g} {unit}, the model before "
            f"had {known:.3g}, and the test promised {offered:.3g}"
        )
    if math.isnan(after.tracking):
        return ""
    most = TRIAL.grown * before.tracking + noise
    if math.isfinite(before.tracking) and not after.tracking <= most:
        return (
            f"the tracking error has grown from {before.tracking:.3g} to {after.tracking:.3g} "
            f"{unit} within {after.seconds:.0f} s of motion"
        )
    own = before.tracking >= TRIAL.mostly * known  # False where nothing moved before
    if own and not after.tracking <= TRIAL.fallen * before.tracking:
        return (
            f"the tracking error has not fallen within {after.seconds:.0f} s of motion: "
            f"{after.tracking:.3g} {unit}, before {before.tracking:.3g}"
        )
    return ""


def why_worse(
    before: Errors, after: Errors, promised: tuple[float, float], noise: float, unit: str
) -> str:
    """Why the model on trial has to go although little was seen of it, in words; "": what was seen
    does not speak against it. As above."""
    known = before.model if math.isfinite(before.model) else promised[0]
    for name, was, now in (
        ("error of the offered model", known, after.model),
        ("tracking error", before.tracking, after.tracking),
    ):
        if now > TRIAL.grown * was + noise:
            return (
                f"the {name} was seen to be larger, {now:.3g} {unit} within {after.seconds:.1f} s "
                f"of motion, before {was:.3g}"
            )
    return ""


def say_unproven(after: Errors, wanted_s: float, limit_s: float, unit: str) -> str:
    """In words, that the model stays although its time is over before enough was seen of it."""
    says = f"the trial is over after its limit of {limit_s:.0f} s: the offered model stays, "
    if not after.seconds:
        return f"{says}unproven: the stage did not move with a reading that counts"
    return (
        f"{says}unproven: only {after.seconds:.1f} s of {wanted_s:g} s of motion were seen; its "
        f"error there is {after.model:.3g} {unit}, and nothing speaks against it"
    )


def say_proven(before: Errors, after: Errors, unit: str) -> str:
    """In words, that the model on trial stays. before: as above."""
    says = f"the offered model is proven over {after.seconds:.0f} s of motion"
    says += f": its error is {after.model:.3g} {unit}"
    if math.isfinite(before.model):
        says += f", the model before had {before.model:.3g}"
    if math.isnan(after.tracking):
        return f"{says}; the tracking error was not judged: a limit or a missing preview made it"
    says += f"; tracking error {after.tracking:.3g}"
    return f"{says}, before {before.tracking:.3g}" if math.isfinite(before.tracking) else says
