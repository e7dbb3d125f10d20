"""How well a written model predicts what it was not fitted to.

Each recording is left out in turn, with its own places, levels and rates; where there are so few
that each may be the only one of its kind, each of their time blocks is left out instead, unless the
drive is sampled at a few places again and again: then any block repeats the others. The linear
weights follow from the other rows, the model is written from them as it is at the end, and
simulated on the rows that were left out. Nonlinear parameters stay: a handful against thousands of
rows.

A model describes the stage as it is at the end of the last recording. An effect that began within a
recording and is still present at the end is written as one that is present all the time, and the
models are judged on what was recorded while it was present.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from dehyst.models.diagnosis.augment import build_augmented_model
from dehyst.models.diagnosis.base import no_base
from dehyst.models.diagnosis.diagnosed_model import DiagnosedModel, fit_plain_model
from dehyst.models.diagnosis.effects import Effect
from dehyst.models.diagnosis.fit import Problem
from dehyst.models.diagnosis.joint_fit import JointFit, solve_ridged
from dehyst.models.diagnosis.tuning import TUNING
from dehyst.models.model import Model
from dehyst.models.signals.joined import Bools, Data, Floats, select_recording


@dataclass(frozen=True)
class WritableFit:
    """A fit that can be written as a model. shape: whether the base's shape is written with it."""

    problem: Problem
    fit: JointFit
    shape: bool

    @property
    def contains(self) -> tuple[str, ...]:
        """Keys of the effects that are blocks of the model."""
        data, fit = self.problem.data, self.fit
        return tuple(
            e.candidate.key
            for e, a in zip(_as_at_the_end(fit.effects, data), fit.amplitudes, strict=True)
            if e.blocks(a, data)
        )

    def without(self, effect: Effect) -> "WritableFit":
        """Return the same without one of its effects."""
        return replace(self, fit=self.problem.without(self.fit, effect))

    def write(self) -> Model:
        """Return the model fitted to all rows."""
        return _write(self.problem, self.fit)

    def write_without(self, here: Bools) -> Model:
        """Return the model with the linear weights fitted to the rows outside `here` (N,)."""
        return _write(self.problem, _fit_without(self.problem, self.fit, here))


@dataclass(frozen=True)
class Refitted(WritableFit):
    """The effects around a hysteresis of the plain class, which is fitted to the base's output
    given the effects: what the model in use had absorbed of an effect is removed from it."""

    def write(self) -> Model:
        """Return the model fitted to all rows."""
        return self._around(self.fit, np.zeros(self.problem.data.n, dtype=bool))

    def write_without(self, here: Bools) -> Model:
        """Return the model with the weights fitted to the rows outside `here` (N,)."""
        return self._around(_fit_without(self.problem, self.fit, here), here)

    def _around(self, fit: JointFit, here: Bools) -> Model:
        problem, data = self.problem, self.problem.data
        v = problem.drive_at_hysteresis(fit.effects)
        y = problem.diagnosed.reading(data, v) + problem.base.combine(v, data.forgets, fit.weights)
        rows = data.rows & ~here
        plain = fit_plain_model(
            replace(data, u=v, y=y, rows=rows), problem.diagnosed.model.hysteresis.r
        )
        diagnosed = DiagnosedModel(plain, carries=True)
        over = Problem(replace(data, rows=rows), no_base(data), diagnosed)
        return _write(over, over.solve(fit.effects))


class HeldOutErrors(NamedTuple):
    """Errors on rows that were left out. mean_square: of all of them; of_each: rms of each
    recording."""

    mean_square: float
    of_each: tuple[float, ...]

    def worsens(self, other: "HeldOutErrors", margin: float) -> bool:
        """Return whether any recording is predicted worse than by `other`, by more than a
        margin."""
        pairs = zip(self.of_each, other.of_each, strict=True)
        return any(mine > theirs + margin for mine, theirs in pairs)


@dataclass(frozen=True)
class HeldOutGroups:
    """Groups of rows that are left out together."""

    data: Data
    groups: tuple[Bools, ...]  # (N,) each

    def held_out_errors(self, write: Callable[[Bools], Model]) -> HeldOutErrors:
        """Return the errors of the models, each written without its group, offsets removed."""
        each = np.zeros((2, len(self.data.names)))
        for group in self.groups:
            left = self._error(write(group), group)
            each[:, self.data.rec[np.argmax(group)]] += np.array([left @ left, left.size])
        total, count = each.sum(axis=1)
        of_each = np.sqrt(each[0] / np.maximum(each[1], 1.0))
        mean_square = float(total / max(count, 1.0)) if np.isfinite(total) else np.inf
        return HeldOutErrors(mean_square, tuple(of_each.tolist()))

    def _error(self, model: Model, group: Bools) -> Floats:
        """Return the error on the group's counted rows, less its mean over the recording's other
        rows, or, where there are none, over the group's own."""
        whole = self.data
        one = select_recording(whole, int(whole.rec[np.argmax(group)]))
        here = group[whole.rec == whole.rec[np.argmax(group)]]
        error = one.y - DiagnosedModel(model, carries=True).predict(one)
        rest = error[one.rows & ~here]
        left = error[one.rows & here]
        return np.asarray(left - (rest.mean() if rest.size else left.mean()))


def make_held_out_groups(
    problem: Problem,
    drive: Floats,
    of_recordings: bool = False,
    effects: Sequence[Effect] = (),
) -> HeldOutGroups:
    """Return the groups of a problem. drive: (N,) as it was recorded, on which models are
    simulated; of_recordings: each recording is a group, however few there are; effects: only rows
    at which all those effects are present that are present at the end count."""
    data = problem.data
    data = replace(data, rows=data.rows & in_the_last_state(effects, data))
    shown = np.unique(data.rec[data.rows]).size
    many = shown >= TUNING.few
    repeats = shown > 1 and problem.has_few_distinct_places
    of = data.rec if of_recordings or many or repeats else data.block
    groups = tuple(of == g for g in np.unique(of[data.rows]))
    return HeldOutGroups(replace(data, u=drive), groups)


def _write(problem: Problem, fit: JointFit) -> Model:
    """Return a fit as a model of the stage as it is at the end of the last recording."""
    effects = _as_at_the_end(fit.effects, problem.data)
    return build_augmented_model(problem, replace(fit, effects=effects))


def _as_at_the_end(effects: Sequence[Effect], data: Data) -> tuple[Effect, ...]:
    """Return the effects; those that are present at the end of the last recording as if they were
    present all the time."""
    return tuple(
        replace(e, span=None) if e.span is not None and e.span.rows(data)[-1] else e
        for e in effects
    )


def in_the_last_state(effects: Sequence[Effect], data: Data) -> Bools:
    """Return (N,) True at the samples at which every effect is present that is present at the end
    of the last recording."""
    out = np.ones(data.n, dtype=bool)
    for span in (e.span for e in effects):
        if span is not None and span.rows(data)[-1]:
            out &= span.rows(data)
    return out


def _fit_without(problem: Problem, fit: JointFit, here: Bools) -> JointFit:
    """Return a fit with the linear weights fitted to the rows outside `here`."""
    data, k, width = problem.data, len(problem.data.names), problem.base.width
    others = ~problem.counted(here)
    x = fit.design[others]
    gram, moment = x.T @ x, x.T @ problem.counted(data.y - fit.fixed)[others]
    problem.model_prior.add_to(gram, moment, k)
    w, _ = solve_ridged(gram, moment, problem.penalty(x.shape[1]))
    at = np.cumsum([k + width, *(a.size for a in fit.amplitudes)])
    amplitudes = tuple(np.split(w, at)[1:-1]) if fit.amplitudes else ()
    return replace(fit, weights=w[k : k + width], offsets=w[:k], amplitudes=amplitudes)
