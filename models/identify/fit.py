"""Fit the equations of a fixed structure by Gauss-Newton, each step a bounded least-squares solve.

The slopes are linear except for the gradient of the saturation, so a few steps are enough. A step
that does not lower the misfit is shortened.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dehyst.models.identify.bounded import bounded_solve
from dehyst.models.identify.equations import Equations, Normal, Params, Shape, assemble
from dehyst.models.identify.thresholds import Prior
from dehyst.models.recording import Bools, Floats

Bounds = tuple[Floats, Floats]


@dataclass(frozen=True)
class Solution:
    """params: the end of the fit; normal: the equations linearised about it; free: (p,) unknowns
    that are off their bounds."""

    params: Params
    normal: Normal
    free: Bools


def make_start(count: int, shape: Shape, slope: float, groups: int) -> Params:
    """Return parameters with equal slopes and no saturation. count: operators; slope: displacement
    per drive."""
    return Params(
        np.full(count * (2 if shape.rate else 1), slope),
        np.zeros(len(shape.powers)),
        np.zeros(max(0, groups - 1)),
        np.zeros(1 if shape.free_offset else 0),
    )


def make_bounds(
    params: Params, limits: tuple[float, float] | None, r: Floats | None = None, above: float = 0.0
) -> Bounds:
    """Return lower and upper bounds (p,): `limits` for the slopes, infinite for the rest; limits
    None: no bounds.

    r: (n,) thresholds; operators narrower than `above` are not bounded.
    """
    low = np.full(params.packed().size, -np.inf)
    high = np.full(low.size, np.inf)
    if limits is not None:
        bounded = np.ones(params.slopes.size, dtype=bool)
        if r is not None:
            bounded = np.tile(r >= above, params.slopes.size // r.size)
        low[: bounded.size][bounded] = limits[0]
        high[: bounded.size][bounded] = limits[1]
    return low, high


def fit_shape(
    equations: Sequence[Equations],
    shape: Shape,
    start: Params,
    bounds: Bounds,
    prior: Prior | None = None,
    strength: float = 0.0,
    loose: bool = False,
    effort: tuple[int, float] = (12, 1e-6),  # a limit on time; far less than any gain that counts
) -> Solution:
    """Fit from `start`. loose: the prior is weakest on narrow operators; effort: maximum number of
    steps, and the relative decrease of the misfit at which to stop."""
    steps, tolerance = effort
    low, high = bounds
    cost = np.zeros((start.slopes.size,) * 2)
    if prior is not None:
        cost = prior.gram(shape.rate, strength, loose)
    params = Params.unpacked(np.clip(start.packed(), low, high), start)
    free = None
    eq = assemble(equations, shape, params)
    for _ in range(steps):
        goal_eq = prior.add_to(eq, shape.rate, strength, loose=loose) if prior else eq
        goal, free = bounded_solve(goal_eq.gram, goal_eq.right, low, high, free)
        before = params.packed()
        promised = goal_eq.misfit_at(before) - goal_eq.misfit_at(goal)
        if promised <= tolerance * eq.misfit:
            break
        part = 1.0
        for _ in range(6):  # down to a hundredth of the step, by 0.4 each time
            trial = Params.unpacked(before + part * (goal - before), params)
            trial_eq = assemble(equations, shape, trial)
            noise = eq.misfit / max(1, eq.count)
            worth, now = (
                one.misfit + noise * float(at.slopes @ cost @ at.slopes)
                for one, at in ((trial_eq, trial), (eq, params))
            )
            if np.isfinite(worth) and worth < now * (1 + 1e-7):  # rounding
                break
            part *= 0.4
        else:
            break
        params, eq = trial, trial_eq
    if free is None:
        free = np.ones(low.size, dtype=bool)
    return Solution(params, eq, free)
