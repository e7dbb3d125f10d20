"""A model on trial: does the error fall once the loop runs it?

Samples count while the stage follows moving targets with a valid reading. Two figures over so many
seconds of motion, before and after: the model's own error (measured minus predicted, without its
mean: a zero that has moved is no error of the model) and the tracking error (measured minus
target). The model stays where its own error has come down by half of what its replay promised, and
the tracking error has not grown, and has fallen where it was the model's. Pure: no clock.
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
    motion: float = 0.002  # of the reach, between batches: the stage is moved


TRIAL = TrialTuning()


class Errors(NamedTuple):
    """rms over so many seconds of motion."""

    model: float
    tracking: float
    seconds: float


class ErrorMeter:
    """The figures of the newest `seconds` of motion."""

    def __init__(self, seconds: float, period_s: float) -> None:
        self._parts: deque[tuple[int, float, float, float]] = deque()
        self._wanted, self._period_s = round(seconds / period_s), period_s
        self._count = 0

    def clear(self) -> None:
        """Begin anew."""
        self._parts.clear()
        self._count = 0

    def add(self, residual: Floats, error: Floats, good: Bools) -> None:
        """A batch (n,): measured minus predicted, measured minus target, which samples count."""
        r, e = residual[good], error[good]
        if not r.size:
            return
        self._parts.append((r.size, float(r.sum()), float(r @ r), float(e @ e)))
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
        first, square, tracking = np.sum([p[1:] for p in self._parts], axis=0) / self._count
        model = math.sqrt(max(0.0, float(square - first**2)))
        return Errors(model, math.sqrt(float(tracking)), self._count * self._period_s)


def why_back(
    before: Errors, after: Errors, promised: tuple[float, float], noise: float, unit: str
) -> str:
    """Why the model on trial has to go, in words; "": it stays. promised: what its replay left of
    the model before and of itself; before: NaN where nothing moved before the switch."""
    in_use, offered = promised
    known = before.model if math.isfinite(before.model) else in_use
    enough = offered + (1.0 - TRIAL.promised) * max(0.0, min(known, in_use) - offered)
    if not after.model <= enough:
        return (
            f"the offered one's error has not come down to {enough:.3g} {unit} within "
            f"{after.seconds:.0f} s of motion: it is {after.model:.3g} {unit}, the model before "
            f"had {known:.3g}, and the test promised {offered:.3g}"
        )
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


def say_proven(before: Errors, after: Errors, unit: str) -> str:
    """In words, that the model on trial stays. before: as above."""
    says = f"the offered model is proven over {after.seconds:.0f} s of motion"
    if not math.isfinite(before.model):
        return f"{says}: its error is {after.model:.3g} {unit}, tracking {after.tracking:.3g}"
    return (
        f"{says}: its error is {after.model:.3g} {unit}, the model before had {before.model:.3g}; "
        f"tracking error {after.tracking:.3g}, before {before.tracking:.3g}"
    )
