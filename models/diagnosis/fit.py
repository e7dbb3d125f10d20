"""Joint refits: the base and every effect at once, nonlinear parameters by variable projection.

A given model stands fixed, and the base's columns correct its hysteresis. The drive passes the
effects' drive parts and the model's, the base makes columns of it, the model's further parts and
the effects' output parts filter them, additive columns and one offset per recording join, and the
linear weights follow from ridge-regularised normal equations. Nonlinear parameters follow by
Gauss-Newton on the projected residual (Golub and Pereyra 1973, in Kaufman's 1975 approximation: the
derivative at fixed weights, projected off the columns).
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from dehyst.models.diagnosis.base import NO_LEANING, Base, Leaning
from dehyst.models.diagnosis.columns import Columns
from dehyst.models.diagnosis.effects import (
    Effect,
    behind_output,
    drive_behind,
    in_order,
    internal,
    moved,
)
from dehyst.models.diagnosis.subject import NO_MODEL, Subject
from dehyst.models.diagnosis.tuning import TUNING
from dehyst.models.physics.candidate import Context
from dehyst.models.signals.joined import Data, Floats


@dataclass(frozen=True)
class JointFit:
    """A joint fit. Arrays over all samples (N,); sums over the counted rows."""

    effects: tuple[Effect, ...]
    weights: Floats  # (width,) of the base's columns
    offsets: Floats  # (recordings,)
    amplitudes: tuple[Floats, ...]  # per effect, of its additive columns
    prediction: Floats
    sse: float
    cov: Floats  # inverse of the normal matrix, times noise variance: covariance of all weights
    design: Floats = field(repr=False)  # (N, columns): offsets, base, additive
    fixed: Floats = field(repr=False)  # (N,): the model in use, behind the effects

    def residual(self, data: Data) -> Floats:
        """Measured minus predicted (N,)."""
        return data.y - self.prediction

    @property
    def effect_names(self) -> tuple[str, ...]:
        """Keys of the effects."""
        return tuple(e.candidate.key for e in self.effects)


@dataclass
class Problem:
    """Data, base and model in use of one diagnosis, with what the fits share.

    several: how independent fits are run: `map`, or an executor's for some at once.
    """

    data: Data
    base: Base
    subject: Subject = NO_MODEL
    several: Callable[..., Iterable[Any]] = map
    leaning: Leaning = NO_LEANING  # rows beside the recorded ones

    def __post_init__(self) -> None:
        self._solutions: list[int] = []  # width of each; appending is safe where fits run at once
        self._columns = Columns(self.base, self.subject)
        count = len(self.data.names)
        self.offset_columns = (self.data.rec[:, None] == np.arange(count)[None, :]).astype(float)
        self.row_index = np.flatnonzero(self.data.rows)
        self.all_rows = bool(self.data.rows.all())

    @property
    def solved(self) -> int:
        """Full solutions so far."""
        return len(self._solutions)

    def light(self, most: int) -> "Problem":
        """The same problem with at most about `most` rows counted, evenly taken; every operator
        still runs through all samples."""
        every = max(1, int(self.row_index.size // most))
        rows = np.zeros(self.data.n, dtype=bool)
        rows[self.row_index[::every]] = True
        return self if every == 1 else self._alike(replace(self.data, rows=rows))

    def with_reading(self, y: Floats) -> "Problem":
        """The same problem with another reading (N,)."""
        return self._alike(replace(self.data, y=y))

    def _alike(self, data: Data) -> "Problem":
        """The same with data of the same drive."""
        out = replace(self, data=data)
        out._columns = self._columns
        return out

    def penalty(self, size: int) -> Floats:
        """Ridge of each of a design's columns, as a part of its mean square."""
        out = np.full(size, TUNING.ridge)
        k = len(self.data.names)
        out[:k] = 1e-13
        out[k : k + self.base.width] = self.base.priors
        return out

    def counted(self, x: Floats) -> Floats:
        """The rows that count."""
        return x if self.all_rows else x[self.row_index]

    def solve(self, effects: Sequence[Effect], output: Floats | None = None) -> JointFit:
        """Linear weights at fixed nonlinear parameters.

        output: hysteresis' output (N,) of an earlier fit, for columns that depend on it; None:
        the reading stands in.
        """
        data = self.data
        effects = in_order(effects)
        v = self.drive_at_hysteresis(effects)
        same = all(e.candidate.mode != "drive" for e in effects)
        columns = behind_output(data, effects, self._columns.of_base(data, v, same))
        fixed = behind_output(data, effects, self._columns.of_model(data, v, same)[:, None])[:, 0]
        context = Context(v, data.y if output is None else output)
        extra = [
            e.candidate.columns(data, context, e.theta)
            if e.candidate.mode == "columns"
            else np.zeros((data.n, 0))
            for e in effects
        ]
        x = np.concatenate([self.offset_columns, columns, *extra], axis=1)
        self._solutions.append(x.shape[1])
        xr, yr = self.counted(x), self.counted(data.y - fixed)
        gram, moment = xr.T @ xr, xr.T @ yr
        self.leaning.add_to(gram, moment, len(data.names))
        scale = np.sqrt(np.maximum(np.diag(gram), 1e-30))
        normed = gram / np.outer(scale, scale) + np.diag(self.penalty(scale.size))
        try:
            factor = cho_factor(normed, lower=True)
            w = cho_solve(factor, moment / scale) / scale
            cov = cho_solve(factor, np.eye(scale.size)) / np.outer(scale, scale)
        except LinAlgError:
            pinv = np.linalg.pinv(normed, rcond=1e-12, hermitian=True)
            w = pinv @ (moment / scale) / scale
            cov = pinv / np.outer(scale, scale)
        prediction = fixed + x @ w
        sse = float(np.sum(self.counted(data.y - prediction) ** 2))
        k = len(data.names)
        weights = w[k : k + self.base.width]
        amplitudes, at = [], k + self.base.width
        for block in extra:
            amplitudes.append(w[at : at + block.shape[1]])
            at += block.shape[1]
        return JointFit(effects, weights, w[:k], tuple(amplitudes), prediction, sse, cov, x, fixed)

    def simulate(
        self,
        fitted: JointFit,
        effects: Sequence[Effect],
        output: Floats,
        known: dict[Any, Floats] | None = None,
    ) -> Floats:
        """Prediction (N,) at other nonlinear parameters and the same weights.

        known: parts that calls with the same weights and output may share; filled here.
        """
        data = self.data
        known = {} if known is None else known
        while len(known) > TUNING.shared_parts:
            known.pop(next(iter(known)))
        way = tuple(e for e in effects if e.candidate.mode == "drive")
        if way not in known:
            known[way] = self.drive_at_hysteresis(way)
        v = known[way]
        if (way, "base") not in known:
            added = self.base.combine(v, data.forgets, fitted.weights)
            added = self.subject.passed(data, added[:, None])[:, 0]
            known[way, "base"] = self._columns.of_model(data, v, not way) + added
        h = known[way, "base"]
        y = behind_output(data, effects, h[:, None])[:, 0] + self.offset_columns @ fitted.offsets
        context = Context(v, output)
        for e, a in zip(effects, fitted.amplitudes, strict=True):
            if e.candidate.mode != "columns":
                continue
            if (way, e) not in known:
                known[way, e] = e.candidate.columns(data, context, e.theta) @ a
            y = y + known[way, e]
        return y

    def output_of(self, fitted: JointFit) -> Floats:
        """The stage's displacement (N,) without additive parts, with the mean offset."""
        k = len(self.data.names)
        inner = fitted.design[:, k : k + self.base.width] @ fitted.weights
        return fitted.fixed + inner + float(fitted.offsets.mean())

    def drive_at_hysteresis(self, effects: Sequence[Effect]) -> Floats:
        """(N,) drive behind the effects' drive parts and the model's."""
        return self.subject.drive(self.data, drive_behind(self.data, effects))

    def projector(self, fitted: JointFit) -> Callable[[Floats], Floats]:
        """Maps x (N, k) to its counted rows, less what the columns of a fit can make."""
        design = self.counted(fitted.design)

        def project(x: Floats) -> Floats:
            x = self.counted(x)
            return x - design @ (fitted.cov @ (design.T @ x))

        return project

    def refit(
        self,
        effects: Sequence[Effect],
        rounds: int = 5,
        start: JointFit | None = None,
        settle: float | None = None,
    ) -> JointFit:
        """Joint fit of everything, nonlinear parameters by damped Gauss-Newton in bounds.

        Between two full solutions a few steps are taken with the design of the last one: the
        base's columns change little with the effects, so their span still projects the base out.
        start: a fit without some of the effects, whose sum of squares is the one to beat.
        settle: fall of the sum of squares at which it stops; None: early, to rank candidates.
        """
        effects = in_order(effects)
        best = self.solve(effects, None if start is None else self.output_of(start))
        if not any(e.theta for e in effects):
            return self.solve(effects, self.output_of(best))
        reference = best.sse if start is None else max(start.sse, best.sse)
        reach = 1.5
        for _ in range(rounds):
            moved_to = self._inner(best, reach)
            if moved_to is None:
                break
            trial = self.solve(moved_to, self.output_of(best))
            if trial.sse >= best.sse:
                reach *= 0.25
                if reach < 0.05:
                    break
                continue
            gain, best = best.sse - trial.sse, trial
            early = max(2e-3 * (reference - best.sse), 3e-5 * best.sse)
            if gain < (early if settle is None else settle):
                break
        return best

    def _inner(self, fitted: JointFit, reach: float, steps: int = 4) -> tuple[Effect, ...] | None:
        """Damped Gauss-Newton steps against the projected residual with a fixed design; None
        where no step helps. reach: largest step of an internal parameter."""
        out = self.output_of(fitted)
        project = self.projector(fitted)
        here, effects = fitted, fitted.effects
        residual = self.counted(self.data.y - fitted.prediction)
        sse = float(residual @ residual)
        first, damping, improved = sse, 1e-3, False
        known: dict[Any, Floats] = {}
        for _ in range(steps):
            p, jac = self.jacobian(replace(here, effects=effects), out, known)
            projected = project(jac)
            a, g = projected.T @ projected, projected.T @ residual
            diag = np.diag(np.maximum(np.diag(a), 1e-9 * max(float(np.diag(a).max()), 1e-30)))
            better = False
            for _ in range(4):
                move = np.clip(np.linalg.solve(a + damping * diag, g), -reach, reach)
                trial = moved(effects, p, move)
                error = self.data.y - self.simulate(here, trial, out, known)
                error = project(error[:, None])[:, 0]
                trial_sse = float(error @ error)
                if trial_sse < sse:
                    gain, better, improved = sse - trial_sse, True, True
                    effects, residual, sse = trial, error, trial_sse
                    damping = max(damping * 0.2, 1e-9)
                    break
                damping = max(damping * 10, 1e-3)
            if not better or gain < 0.01 * (first - sse):
                break
        return effects if improved else None

    def jacobian(
        self, fitted: JointFit, output: Floats, known: dict[Any, Floats] | None = None
    ) -> tuple[Floats, Floats]:
        """Internal parameters (p,) and derivative (N, p) of the prediction at fixed weights."""
        p = internal(fitted.effects)
        known = {} if known is None else known
        here = self.simulate(fitted, fitted.effects, output, known)
        jac = np.empty((self.data.n, p.size))
        for i in range(p.size):
            step = np.zeros(p.size)
            step[i] = 1e-3
            there = moved(fitted.effects, p, step)
            actual = internal(there)[i] - p[i]
            if abs(actual) < 1e-6:  # on the upper bound: step back
                there = moved(fitted.effects, p, -step)
                actual = internal(there)[i] - p[i]
            if abs(actual) < 1e-9:
                jac[:, i] = 0.0
                continue
            jac[:, i] = (self.simulate(fitted, there, output, known) - here) / actual
        return p, jac
