"""Gauss-Newton on the equations of a fixed structure, every step a bounded least-squares solve.

The slopes are linear but for the saturation's gradient, so a handful of steps is enough. A step
that does not lower the misfit is shortened.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from dehyst.models.identify.bounded import bounded_solve
from dehyst.models.identify.equations import Equations, Normal, Params, Shape, assemble
from dehyst.models.recording import Bools, Floats

Source = Callable[[], Iterable[Equations]]


@dataclass(frozen=True)
class Solution:
    """params: where the fit ended; normal: the equations about it; free: (p,) unknowns that are
    off their bound; steps: Gauss-Newton steps taken."""

    params: Params
    normal: Normal
    free: Bools
    steps: int

    @property
    def rms(self) -> float:
        """Root mean square error over the fitted equations."""
        return float(np.sqrt(self.normal.misfit / max(1, self.normal.count)))


def make_start(count: int, shape: Shape, slope: float, groups: int, rate: bool) -> Params:
    """All slopes equal, no saturation. count: operators; slope: displacement per drive."""
    return Params(
        np.full(count * (2 if rate else 1), slope),
        np.zeros(len(shape.powers)),
        np.zeros(max(0, groups - 1)),
    )


@dataclass(frozen=True)
class Prior:
    """Neighbouring slopes differ by chance by `spread` per `step` of the cube root of r / r_top.

    Weighs nothing against what the data say; decides what they leave open: slopes of wide
    operators at rates that the drive never has there. Narrow operators (r < r_from) are left
    alone: what happens right after a reversal may be abrupt.
    r: (n,) thresholds; r_top: half the drive span.
    """

    r: Floats
    r_from: float
    r_top: float
    spread: float
    step: float

    def add_to(self, eq: Normal, shape: Shape) -> Normal:
        """The normal equations with the prior's own."""
        n = self.r.size
        if n < 2 or eq.count == 0:
            return eq
        distance = np.diff(np.cbrt(self.r / self.r_top)) / self.step
        weight = (self.r[:-1] >= self.r_from) / (self.spread**2 * np.maximum(distance, 1e-9))
        difference = np.diff(np.eye(n), axis=0)
        noise = eq.misfit / max(1.0, eq.count)
        part = noise * (difference.T * weight) @ difference
        gram = eq.gram.copy()
        for start in (0, n) if shape.rate else (0,):
            gram[start : start + n, start : start + n] += part
        return Normal(gram, eq.right, eq.total, eq.count, eq.misfit)


def make_bounds(
    params: Params, least: float | None, r: Floats | None = None, r_from: float = 0.0
) -> Floats:
    """(p,) lower bounds: `least` for the slopes, none for the rest. None: none at all.

    r: (n,) thresholds, with r_from: operators narrower than that are not bounded.
    """
    low = np.full(params.packed().size, -np.inf)
    if least is not None:
        low[: params.slopes.size] = least
        if r is not None:
            narrow = np.tile(r < r_from, params.slopes.size // r.size)
            low[: params.slopes.size][narrow] = -np.inf
    return low


def solve(
    equations: Source,
    shape: Shape,
    start: Params,
    low: Floats,
    prior: Prior | None = None,
    steps: int = 12,
    tolerance: float = 1e-6,
) -> Solution:
    """Fit from `start`. low: (p,) lower bounds; tolerance: relative fall of the misfit at which to
    stop."""
    params = Params.unpacked(np.maximum(start.packed(), low), start)
    free = None
    eq = assemble(equations(), shape, params)
    taken = 0
    for _ in range(steps):
        goal_eq = prior.add_to(eq, shape) if prior else eq
        goal, free = bounded_solve(goal_eq.gram, goal_eq.right, low, free)
        before = params.packed()
        promised = goal_eq.misfit_at(before) - goal_eq.misfit_at(goal)
        if promised <= tolerance * eq.misfit:
            break
        part = 1.0
        for _ in range(6):
            trial = Params.unpacked(before + part * (goal - before), params)
            trial_eq = assemble(equations(), shape, trial)
            if np.isfinite(trial_eq.misfit) and trial_eq.misfit < eq.misfit * (1 + 1e-7):
                break
            part *= 0.4
        else:
            break
        params, eq = trial, trial_eq
        taken += 1
    if free is None:
        free = np.ones(low.size, dtype=bool)
    return Solution(params, eq, free, taken)
