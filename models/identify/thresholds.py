"""Thresholds of the play operators, the prior on the slopes between them, and their reduction.

Dropping threshold j ties slope j to slope j - 1: their columns in the normal equations add up. So
the fit of every smaller model, and its misfit, follow from the Gram matrix of the finest grid
without using the data again. The tie that costs least is made first; two thresholds closer than the
step of a sample cost nothing and merge immediately.
"""

from dataclasses import dataclass

import numpy as np

from dehyst.models.identify.bounded import bounded_solve
from dehyst.models.identify.equations import Ints, Normal, Params, Shape
from dehyst.models.identify.tuning import TUNING
from dehyst.models.recording import Floats


def space_thresholds(n: int, drive_span: float, whole: bool = False, power: float = 3.0) -> Floats:
    """Return thresholds (n,) from 0 to below half the span, closest together where small (Eq. 10
    with its power).

    If n is large, the first above zero is no lower than that of TUNING.fine, because data cannot
    distinguish closer ones. whole: place some of them up to the span; on the virgin curve operators
    that wide still move.
    """
    wide = max(1, int(TUNING.minor * n)) if whole and n > 4 else 0  # fewer have none to spare
    n -= wide
    power *= min(1.0, np.log(TUNING.fine) / np.log(max(n, 2)))
    inner = (np.arange(n) / n) ** power * drive_span / 2.0
    return np.concatenate([inner, (1.0 + np.arange(wide) / max(wide, 1)) * drive_span / 2.0])


def regrid(
    params: Params, coarse: Floats, fine: Floats, shape: Shape, shares: Floats | float = 1.0
) -> Params:
    """Return the same slopes on other thresholds: each takes those of the next lower coarse one.

    shares: the rates at which the slopes are wanted, over those at which they are given.
    """
    at = np.searchsorted(coarse, fine, side="right") - 1
    if not shape.rate:
        return params._replace(slopes=params.slopes[at])
    slopes = np.concatenate([part[at] for part in np.split(params.slopes, 2)])
    return params._replace(slopes=change_rates(slopes, shares))


def change_rates(slopes: Floats, shares: Floats | float) -> Floats:
    """Return the same slopes (2n,), alpha then beta, at these fractions of the rates; slopes are
    linear in the rate."""
    alpha, beta = np.split(slopes, 2)
    p, q = 0.5 * (alpha + beta), 0.5 * (alpha - beta) * shares
    return np.concatenate([p + q, p - q])


def at_one_rate(eq: Normal, shares: Floats) -> Normal:
    """Transform normal equations whose slopes are given at these fractions of one rate into those
    for slopes at that rate itself, at which similar neighbours have one slope whatever their rates.
    """
    turn = np.eye(eq.right.size)
    size = 2 * shares.size
    columns = [change_rates(one, shares) for one in np.eye(size)]
    turn[:size, :size] = np.transpose(columns)
    return Normal(turn.T @ eq.gram @ turn, turn.T @ eq.right, eq.total, eq.count, eq.misfit)


@dataclass(frozen=True)
class Prior:
    """Prior on the slopes: neighbours differ at random, by about the mean slope over all thresholds
    on a scale of their cube root. Their rate-dependence differs less, and is itself small.

    The strength is chosen by the prediction of held-out rows; operators wider than half the range,
    which move once at most, get little freedom at any strength. r: (n,) thresholds; slope: mean
    slope; half: half the drive range; rate_share: strength of the prior on the rate-dependence over
    that on the slopes.
    """

    r: Floats
    slope: float
    half: float
    rate_share: float = TUNING.strengths[0]

    def gram(self, rate: bool, strength: float, loose: bool) -> Floats:
        """Return the addition (s, s) of the prior to the Gram matrix of the slopes, per unit of
        noise power.

        loose: narrow operators are left nearly free, because the response right after a turn may be
        abrupt.
        """
        n = self.r.size
        if n < 2:
            return np.zeros((2 * n if rate else n,) * 2)
        distance = np.maximum(np.diff(np.cbrt(self.r / self.r[-1])), 1e-9)
        step = np.diff(np.eye(n), axis=0)
        wide = self.r[1:] >= self.half
        strengths = np.where(wide, max(strength, TUNING.strengths[-2]), strength)
        if loose:
            narrow = self.r[:-1] < 2.0 * self.half * TUNING.crumb
            strengths = np.where(narrow, min(strength, TUNING.strengths[0]), strengths)
        smooth = (step.T * (strengths / distance)) @ step / self.slope**2
        if not rate:
            return smooth
        tied = np.where(wide, TUNING.strengths[-2], self.rate_share * strengths)
        small = (step.T * (tied / distance)) @ step / self.slope**2
        small += self.rate_share * strength / self.slope**2 / n * np.eye(n)
        even, odd = 0.25 * (smooth + small), 0.25 * (smooth - small)
        return np.block([[even, odd], [odd, even]])

    def add_to(
        self, eq: Normal, rate: bool, strength: float, noise: float = 0.0, loose: bool = False
    ) -> Normal:
        """Return the normal equations with those of the prior. noise: noise power, or 0: use the
        misfit."""
        if eq.count == 0 or strength == 0.0:
            return eq
        part = self.gram(rate, strength, loose) * (noise or eq.misfit / eq.count)
        gram = eq.gram.copy()
        gram[: part.shape[0], : part.shape[0]] += part
        return Normal(gram, eq.right, eq.total, eq.count, eq.misfit)


@dataclass(frozen=True)
class Grid:
    """One stage of the elimination: kept: (n,) indices into the finest grid; p: the unknowns;
    misfit: sum of squares over the fitted rows."""

    kept: tuple[int, ...]
    p: Floats
    misfit: float


def _find_starts(kept: tuple[int, ...], finest: int, rate: bool, rest: int) -> Ints:
    """Return the first (reduced,) of the finest grid's unknowns that each unknown of a reduced
    model ties."""
    first = np.array(kept, dtype=np.int64)
    slopes = np.concatenate([first, first + finest]) if rate else first
    return np.concatenate([slopes, finest * (2 if rate else 1) + np.arange(rest)])


def eliminate(eq: Normal, low: Floats, finest: int, rate: bool, least: int = 1) -> list[Grid]:
    """Return grids of all sizes from `finest` down to `least`.

    eq: normal equations on the finest grid; low: (p,) bounds.
    """
    rest = low.size - finest * (2 if rate else 1)
    kept = tuple(range(finest))
    grids = []
    free = None
    while True:
        starts = _find_starts(kept, finest, rate, rest)
        gram = np.add.reduceat(np.add.reduceat(eq.gram, starts, axis=0), starts, axis=1)
        right = np.add.reduceat(eq.right, starts)
        p, free = bounded_solve(gram, right, low[starts], free=free)
        full = np.repeat(p, np.diff(starts, append=low.size))
        grids.append(Grid(kept, p, eq.misfit_at(full)))
        if len(kept) <= least:
            return grids
        drop = _find_cheapest(gram, p, len(kept), rate)
        kept = kept[:drop] + kept[drop + 1 :]
        free = np.delete(free, [drop, drop + len(kept) + 1] if rate else [drop])


def _find_cheapest(gram: Floats, p: Floats, n: int, rate: bool) -> int:
    """Return the threshold (never the first) whose tie to its lower neighbour costs the least
    misfit.

    Bounds are ignored here: only the order of removal depends on this, not the fit.
    """
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    g = gram / np.outer(scale, scale)
    g[np.diag_indices_from(g)] += 1e-10  # of the unit diagonal: against exact collinearity
    inverse = np.linalg.inv(g) / np.outer(scale, scale)
    best, cost = 1, np.inf
    for j in range(1, n):
        pairs = [(j - 1, j), (n + j - 1, n + j)] if rate else [(j - 1, j)]
        difference = np.array([p[a] - p[b] for a, b in pairs])
        spread = np.zeros((len(pairs), p.size))
        for i, (a, b) in enumerate(pairs):
            spread[i, a], spread[i, b] = 1.0, -1.0
        small = spread @ inverse @ spread.T
        price = float(difference @ np.linalg.solve(small, difference))
        if price < cost:
            best, cost = j, price
    return best
