"""Thresholds of the play operators, what is taken for granted about the slopes between them, and
how to do with fewer.

Dropping threshold j ties slope j to slope j - 1: their columns in the normal equations add up.
So every smaller model's fit and its error on held-out rows follow from the two Gram matrices of
the finest grid, without touching the data again. The tie that costs least goes first; two
thresholds closer than a sample's step cost nothing and merge at once.
"""

from dataclasses import dataclass

import numpy as np

from dehyst.models.identify.bounded import bounded_solve
from dehyst.models.identify.equations import Ints, Normal, Params, Shape
from dehyst.models.identify.tuning import TUNING
from dehyst.models.recording import Floats


def space_thresholds(n: int, drive_span: float, whole: bool = False, power: float = 3.0) -> Floats:
    """(n,) thresholds from 0 to below half the span, fine where small (Eq. 10 with its power).

    Of many the first lies no lower than that of TUNING.fine: data cannot tell closer ones.
    whole: some of them up to the span; on the virgin curve operators as wide as that still move.
    """
    wide = max(1, int(TUNING.minor * n)) if whole and n > 4 else 0
    n -= wide
    power *= min(1.0, np.log(TUNING.fine) / np.log(max(n, 2)))
    inner = (np.arange(n) / n) ** power * drive_span / 2.0
    return np.concatenate([inner, (1.0 + np.arange(wide) / max(wide, 1)) * drive_span / 2.0])


def regrid(
    params: Params, coarse: Floats, fine: Floats, shape: Shape, shares: Floats | float = 1.0
) -> Params:
    """The same slopes on other thresholds: each takes those of the next wider-set one below.

    shares: of the rates at which the slopes are given, those at which they are wanted.
    """
    at = np.searchsorted(coarse, fine, side="right") - 1
    if not shape.rate:
        return params._replace(slopes=params.slopes[at])
    slopes = np.concatenate([part[at] for part in np.split(params.slopes, 2)])
    return params._replace(slopes=change_rates(slopes, shares))


def change_rates(slopes: Floats, shares: Floats | float) -> Floats:
    """(2n,) the same slopes, alpha then beta, at these shares of the rates: they are linear in the
    rate."""
    alpha, beta = np.split(slopes, 2)
    p, q = 0.5 * (alpha + beta), 0.5 * (alpha - beta) * shares
    return np.concatenate([p + q, p - q])


def at_one_rate(eq: Normal, shares: Floats) -> Normal:
    """Normal equations whose slopes are given at these shares of one rate, for slopes at that rate
    itself: there neighbours that are alike have one slope, whatever the rate."""
    turn = np.eye(eq.right.size)
    size = 2 * shares.size
    columns = [change_rates(one, shares) for one in np.eye(size)]
    turn[:size, :size] = np.transpose(columns)
    return Normal(turn.T @ eq.gram @ turn, turn.T @ eq.right, eq.total, eq.count, eq.misfit)


@dataclass(frozen=True)
class Prior:
    """Neighbouring slopes differ by chance, by about the mean slope over all thresholds on a scale
    of their cube root; and less so in what the rate adds, which is itself small by chance.

    The strength is chosen by what predicts held-out rows; operators wider than half the range,
    which move once at most, are given little freedom in any case. r: (n,) thresholds; slope: mean
    slope; half: half the drive's range; rate_share: strength of the prior on what the rate does,
    against that on the slopes.
    """

    r: Floats
    slope: float
    half: float
    rate_share: float = TUNING.strengths[0]

    def gram(self, rate: bool, strength: float, loose: bool) -> Floats:
        """(s, s) what the prior adds to the Gram matrix of the slopes, per power of the noise.

        loose: narrow operators are left alone, as what happens right after a turn may be abrupt.
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
        """The normal equations with the prior's own. noise: power of the noise, or 0: the
        misfit's."""
        if eq.count == 0 or strength == 0.0:
            return eq
        part = self.gram(rate, strength, loose) * (noise or eq.misfit / eq.count)
        gram = eq.gram.copy()
        gram[: part.shape[0], : part.shape[0]] += part
        return Normal(gram, eq.right, eq.total, eq.count, eq.misfit)


@dataclass(frozen=True)
class Grid:
    """One stage of the elimination: kept: (n,) indices into the finest grid; p: the unknowns;
    train, held: misfits (sums of squares) on the fitted and on the held-out rows."""

    kept: tuple[int, ...]
    p: Floats
    train: float
    held: float


def find_starts(kept: tuple[int, ...], finest: int, rate: bool, rest: int) -> Ints:
    """(reduced,) first of the finest grid's unknowns that each unknown of a reduced model ties."""
    first = np.array(kept, dtype=np.int64)
    slopes = np.concatenate([first, first + finest]) if rate else first
    return np.concatenate([slopes, finest * (2 if rate else 1) + np.arange(rest)])


def eliminate(
    train: Normal, held: Normal, low: Floats, finest: int, rate: bool, least: int = 1
) -> list[Grid]:
    """Grids of all sizes from `finest` down to `least`.

    train, held: normal equations on the finest grid about the same parameters; low: (p,) bounds.
    """
    rest = low.size - finest * (2 if rate else 1)
    kept = tuple(range(finest))
    grids = []
    free = None
    while True:
        starts = find_starts(kept, finest, rate, rest)
        gram = np.add.reduceat(np.add.reduceat(train.gram, starts, axis=0), starts, axis=1)
        right = np.add.reduceat(train.right, starts)
        p, free = bounded_solve(gram, right, low[starts], free=free)
        full = np.repeat(p, np.diff(starts, append=low.size))
        grids.append(Grid(kept, p, train.misfit_at(full), held.misfit_at(full)))
        if len(kept) <= least:
            return grids
        drop = _find_cheapest(gram, p, len(kept), rate)
        kept = kept[:drop] + kept[drop + 1 :]
        free = np.delete(free, [drop, drop + len(kept) + 1] if rate else [drop])


def _find_cheapest(gram: Floats, p: Floats, n: int, rate: bool) -> int:
    """The threshold (never the first) whose tie to its lower neighbour costs the least misfit.

    Bounds are left aside here: only the order of removal depends on it, not the fit.
    """
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    g = gram / np.outer(scale, scale)
    g[np.diag_indices_from(g)] += 1e-10
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
