"""Joint refits: the base and every effect at once, nonlinear parameters by variable projection.

A given model stays fixed, and the base's columns correct its hysteresis. The drive passes the drive
parts of the effects and of the model; the base makes columns of it; the model's further parts and
the effects' output parts filter them; additive columns and one offset per recording are appended;
and the linear weights follow from ridge-regularised normal equations. Nonlinear parameters follow
by Gauss-Newton on the projected residual (Golub and Pereyra 1973, in Kaufman's 1975 approximation:
the derivative at fixed weights, projected off the columns).
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from dehyst.models.diagnosis.base import NO_MODEL_PRIOR, Base, ModelPrior, rich_base
from dehyst.models.diagnosis.columns import Columns
from dehyst.models.diagnosis.data.drive_path import (
    count_distinct_moments,
    count_distinct_places,
    is_single_loop,
)
from dehyst.models.diagnosis.diagnosed_model import NO_MODEL, DiagnosedModel
from dehyst.models.diagnosis.effects import (
    Effect,
    apply_drive_effects,
    apply_output_effects,
    in_cascade_order,
    internal_parameters,
    move_parameters,
)
from dehyst.models.diagnosis.joint_fit import JointFit, solve_ridged
from dehyst.models.diagnosis.tuning import TUNING
from dehyst.models.physics.candidate import Context
from dehyst.models.signals.joined import Bools, Data, Floats, Ints

Array = TypeVar("Array", Floats, Ints, Bools)

STEPS = 4  # of the fit with a fixed design, after which the design is rebuilt
SETTLED = 0.3  # fall of chi-square in one round that ends a close fit: half a standard deviation
# a fit that ranks candidates ends at a fall of this share of its gain, or of its sum of squares:
EARLY, UNSEEN = 2e-3, 3e-4  # a fifth of what counts as a tie; a fiftieth of TUNING.trace squared


@dataclass
class Problem:
    """Data, base and model in use of one diagnosis, with what the fits share.

    several: how independent fits are run: `map`, or an executor's map to run them in parallel.
    around: a fit with the same drive, about which the base is linearised: the base's columns are
    those of that fit's effects, and new effects act on the output of its weights only. For effects
    as small as the noise the error is of second order, and a fit need not rebuild the base's
    columns.
    """

    data: Data
    base: Base
    diagnosed: DiagnosedModel = NO_MODEL
    several: Callable[..., Iterable[Any]] = map
    model_prior: ModelPrior = NO_MODEL_PRIOR  # rows in addition to the recorded ones
    stiffness: float = 1.0  # factor on the base's prior
    around: JointFit | None = None

    def __post_init__(self) -> None:
        self._solutions: list[int] = []  # width of each; appending is thread-safe
        self._columns = Columns(self.base, self.diagnosed)
        self._kept_base: tuple[Floats, Floats] | None = None
        self.row_index = np.flatnonzero(self.data.rows)
        self.all_rows = bool(self.data.rows.all())

    @cached_property
    def is_single_loop(self) -> bool:
        """Whether the drive only repeats a single loop."""
        return is_single_loop(self.data)

    @cached_property
    def has_few_distinct_places(self) -> bool:
        """Whether the drive is sampled at no more distinct places of its path than a rich base has
        columns."""
        return count_distinct_places(self.data) <= rich_base(self.data).width

    @cached_property
    def has_few_distinct_moments(self) -> bool:
        """Whether the drive is sampled at no more distinct moments of its path than a rich base has
        columns: such a base then gives each sample of a period a value of its own."""
        return count_distinct_moments(self.data) <= rich_base(self.data).width

    @property
    def solution_count(self) -> int:
        """Number of full solutions so far."""
        return len(self._solutions)

    def with_fewer_rows(self, most: int) -> "Problem":
        """Return the same problem with at most about `most` rows counted, evenly spaced; every
        operator still runs through all samples."""
        every = max(1, int(self.row_index.size // most))
        rows = np.zeros(self.data.n, dtype=bool)
        rows[self.row_index[::every]] = True
        return self if every == 1 else self._alike(False, data=replace(self.data, rows=rows))

    def with_reading(self, y: Floats) -> "Problem":
        """Return the same problem with another reading (N,)."""
        return self._alike(True, data=replace(self.data, y=y))

    def with_zero_order_hold(self, stepped: bool = True) -> "Problem":
        """Return the same problem with lags and modes fed by steps, or by straight lines between
        samples."""
        return self._alike(True, data=replace(self.data, stepped=stepped))

    def with_sequential_fits(self) -> "Problem":
        """Return the same problem with its fits run one after the other, for use where whole
        searches run in parallel."""
        return self._alike(True, several=map)

    def linearised_about(self, fitted: JointFit) -> "Problem":
        """Return the same problem linearised about a fit."""
        return self._alike(False, around=fitted)

    def _alike(self, same_base: bool, **changes: Any) -> "Problem":
        """Return the same problem with changes that leave the drive as it is."""
        out = replace(self, **changes)
        out._columns = self._columns
        out._kept_base = self._kept_base if same_base else None
        return out

    def penalty(self, size: int) -> Floats:
        """Return the ridge of each column of a design, relative to its mean square."""
        out = np.full(size, TUNING.ridge)
        k = len(self.data.names)
        out[:k] = 1e-13
        out[k : k + self.base.width] = self.stiffness * self.base.priors
        return out

    def counted(self, x: Array) -> Array:
        """Return the rows that count."""
        return x if self.all_rows else x[self.row_index]

    def solve(self, effects: Sequence[Effect], output: Floats | None = None) -> JointFit:
        """Solve for the linear weights at fixed nonlinear parameters.

        output: hysteresis' output (N,) of an earlier fit, for columns that depend on it; None: the
        reading is used instead.
        """
        data = self.data
        effects = in_cascade_order(effects)
        v = self.drive_at_hysteresis(effects)
        same = all(e.candidate.mode != "drive" for e in effects)
        model = self._columns.of_model(data.path, v, same)[:, None]
        fixed = data.sampled(apply_output_effects(data.path, effects, model)[:, 0])
        around = self.around
        if around is not None:
            fixed = fixed + self._added(effects, v, around.weights) - around.added
            way, v_there = around.effects, self.drive_at_hysteresis(around.effects)
        else:
            way, v_there = effects, v
        context = Context(data.sampled(v), data.y if output is None else output)
        extra = [
            e.columns(data, context) if e.candidate.mode == "columns" else np.zeros((data.n, 0))
            for e in effects
        ]
        base, gram_of_base = self._base_of(way, v_there)
        counted_extra = [self.counted(block) for block in extra if block.size]
        x = np.concatenate([base, *counted_extra], axis=1) if counted_extra else base
        self._solutions.append(x.shape[1])
        k, width = len(data.names), base.shape[1]
        gram = np.empty((x.shape[1], x.shape[1]))
        gram[:width, :width] = gram_of_base
        gram[width:] = x[:, width:].T @ x
        gram[:width, width:] = gram[width:, :width].T
        moment = x.T @ self.counted(data.y - fixed)
        self.model_prior.add_to(gram, moment, k)
        w, cov = solve_ridged(gram, moment, self.penalty(moment.size))
        weights = w[k:width]
        added = self._added(way, v_there, weights)
        prediction = fixed + added + w[:k][data.rec]
        amplitudes, at = [], width
        for block in extra:
            amplitudes.append(w[at : at + block.shape[1]])
            at += block.shape[1]
            prediction += block @ amplitudes[-1]
        sse = float(np.sum(self.counted(data.y - prediction) ** 2))
        return JointFit(
            effects, weights, w[:k], tuple(amplitudes), prediction, sse, cov, x, fixed, added
        )

    def without(self, fitted: JointFit, effect: Effect) -> JointFit:
        """Return a fit without one of its effects; the others keep their nonlinear parameters."""
        rest = [e for e in fitted.effects if e is not effect]
        return self.solve(rest, self.output_of(fitted))

    def _base_of(self, effects: Sequence[Effect], v: Floats) -> tuple[Floats, Floats]:
        """Return the columns of the offsets and the base on the counted rows, filtered by the
        effects, for a drive v (M,) that has passed their drive parts, and the columns' Gram matrix.
        Read-only."""
        modes = {e.candidate.mode for e in effects}
        keep = self.around is not None or not modes & {"drive", "output"}
        if keep and self._kept_base is not None:
            return self._kept_base
        columns = self._columns.of_base(self.data, v, self.row_index, effects)
        groups = np.arange(len(self.data.names))
        offsets = (self.data.rec[self.row_index][:, None] == groups[None, :]).astype(float)
        x = np.concatenate([offsets, columns], axis=1)
        out = x, x.T @ x
        if keep:
            self._kept_base = out
        return out

    def _added(self, effects: Sequence[Effect], v: Floats, weights: Floats) -> Floats:
        """Return (N,) what the base adds, filtered by the model's further blocks and the
        effects."""
        if not self.base.width:
            return np.zeros(self.data.n)
        path = self.data.path
        inner = self.base.combine(v, path.forgets, weights)
        inner = self.diagnosed.apply_linear_blocks(path, inner[:, None])
        return self.data.sampled(apply_output_effects(path, effects, inner)[:, 0])

    def simulate(
        self,
        fitted: JointFit,
        effects: Sequence[Effect],
        output: Floats,
        known: dict[Any, Floats] | None = None,
    ) -> Floats:
        """Return the prediction (N,) at other nonlinear parameters and the same weights.

        known: cache shared by calls with the same weights and output; filled here.
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
            weights = fitted.weights if self.around is None else self.around.weights
            added = self.base.combine(v, data.path.forgets, weights)
            added = self.diagnosed.apply_linear_blocks(data.path, added[:, None])[:, 0]
            known[way, "base"] = self._columns.of_model(data.path, v, not way) + added
        h = known[way, "base"]
        y = data.sampled(apply_output_effects(data.path, effects, h[:, None])[:, 0])
        y = y + fitted.offsets[data.rec]
        if self.around is not None:
            y = y + (fitted.added - self.around.added)
        context = Context(data.sampled(v), output)
        for e, a in zip(effects, fitted.amplitudes, strict=True):
            if e.candidate.mode != "columns":
                continue
            if (way, e) not in known:
                known[way, e] = e.columns(data, context) @ a
            y = y + known[way, e]
        return y

    def output_of(self, fitted: JointFit) -> Floats:
        """Return the stage's displacement (N,) without additive parts, with the mean offset."""
        return fitted.fixed + fitted.added + float(fitted.offsets.mean())

    def drive_at_hysteresis(self, effects: Sequence[Effect]) -> Floats:
        """Return the (M,) drive on its path, after the drive parts of the effects and of the
        model."""
        return self.diagnosed.drive(self.data.path, apply_drive_effects(self.data.path, effects))

    def projector(self, fitted: JointFit) -> Callable[[Floats], Floats]:
        """Return a function that maps x (N, k) to its counted rows, projected off the columns of a
        fit."""
        design = fitted.design

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
        """Fit everything jointly, nonlinear parameters by damped Gauss-Newton within bounds.

        Between two full solutions a few steps reuse the design of the last one: the base's columns
        change little with the effects, so their span still projects the base out. start: a fit
        without some of the effects, whose sum of squares is the reference for the gain. settle:
        fall of the sum of squares at which it stops; None: it stops early, which is enough to rank
        candidates.
        """
        effects = in_cascade_order(effects)
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
            early = max(EARLY * (reference - best.sse), UNSEEN * best.sse)
            if gain < (early if settle is None else settle):
                break
        return best

    def refit_closely(self, effects: Sequence[Effect], sigma: float) -> JointFit:
        """Fit everything jointly until the parameters are known as well as the noise allows.
        sigma: rms of the noise."""
        return self.refit(effects, rounds=8, settle=SETTLED * sigma**2)

    def _inner(self, fitted: JointFit, reach: float) -> tuple[Effect, ...] | None:
        """Take damped Gauss-Newton steps against the projected residual with a fixed design; return
        None where no step helps. reach: largest step of an internal parameter."""
        out = self.output_of(fitted)
        project = self.projector(fitted)
        here, effects = fitted, fitted.effects
        residual = self.counted(self.data.y - fitted.prediction)
        sse = float(residual @ residual)
        first, damping, improved = sse, 1e-3, False
        known: dict[Any, Floats] = {}
        for _ in range(STEPS):
            p, jac = self.jacobian(replace(here, effects=effects), out, known)
            projected = project(jac)
            a, g = projected.T @ projected, projected.T @ residual
            diag = np.diag(np.maximum(np.diag(a), 1e-9 * max(float(np.diag(a).max()), 1e-30)))
            better = False
            for _ in range(4):
                move = np.clip(np.linalg.solve(a + damping * diag, g), -reach, reach)
                trial = move_parameters(effects, p, move)
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
        """Return internal parameters (p,) and the derivative (N, p) of the prediction at fixed
        weights."""
        p = internal_parameters(fitted.effects)
        known = {} if known is None else known
        here = self.simulate(fitted, fitted.effects, output, known)
        jac = np.empty((self.data.n, p.size))
        for i in range(p.size):
            step = np.zeros(p.size)
            step[i] = 1e-3
            there = move_parameters(fitted.effects, p, step)
            actual = internal_parameters(there)[i] - p[i]
            if abs(actual) < 1e-6:  # on the upper bound: step back
                there = move_parameters(fitted.effects, p, -step)
                actual = internal_parameters(there)[i] - p[i]
            if abs(actual) < 1e-9:
                jac[:, i] = 0.0
                continue
            jac[:, i] = (self.simulate(fitted, there, output, known) - here) / actual
        return p, jac
