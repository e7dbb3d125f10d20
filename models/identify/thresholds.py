"""Which thresholds a model needs: start with many, drop those that the data cannot tell apart.

Dropping threshold j ties slope j to slope j - 1: their columns in the normal equations add up.
So every smaller model's fit and its error on held-out rows follow from the two Gram matrices of
the finest grid, without touching the data again. The tie that costs least goes first; two
thresholds closer than a sample's step cost nothing and merge at once.
"""

from dataclasses import dataclass

import numpy as np

from dehyst.models.identify.bounded import bounded_solve
from dehyst.models.identify.equations import Ints, Normal
from dehyst.models.recording import Floats

FINE = 48


def space_thresholds(n: int, drive_span: float) -> Floats:
    """(n,) thresholds from 0 to below half the span, fine where small (after Eq. 10).

    Of many the first lies no lower than that of FINE: data cannot tell thresholds much closer.
    """
    power = 3.0 * min(1.0, np.log(FINE) / np.log(max(n, 2)))
    return (np.arange(n) / n) ** power * drive_span / 2.0


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


def eliminate(train: Normal, held: Normal, low: Floats, finest: int, rate: bool) -> list[Grid]:
    """Grids of all sizes from `finest` down to 1.

    train, held: normal equations on the finest grid about the same parameters; low: (p,) bounds.
    """
    rest = low.size - finest * (2 if rate else 1)
    kept = tuple(range(finest))
    grids = []
    free = None
    while True:
        starts = find_starts(kept, finest, rate, rest)
        gram = np.add.reduceat(np.add.reduceat(train.gram, starts, axis=0), starts, axis=1)
        p, free = bounded_solve(gram, np.add.reduceat(train.right, starts), low[starts], free)
        full = np.repeat(p, np.diff(starts, append=low.size))
        grids.append(Grid(kept, p, train.misfit_at(full), held.misfit_at(full)))
        if len(kept) == 1:
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


def choose(grids: list[Grid], order: int | None, tolerance: float) -> Grid:
    """The grid of the given order, or the smallest whose held-out misfit is within the tolerance
    (relative) of the best."""
    if order is not None:
        return next((g for g in grids if len(g.kept) == order), grids[0])
    best = min(g.held for g in grids)
    return [g for g in grids if g.held <= best * (1.0 + tolerance)][-1]
