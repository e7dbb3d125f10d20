"""Solve least squares with bounds on both sides, from the normal equations.

    minimise  p' G p / 2 - g' p   with   low <= p <= high   (infinite: free)

Block principal pivoting (J. Kim, H. Park, "Fast nonnegative matrix factorization: an
active-set-like method and comparisons", SIAM J. Sci. Comput. 33, 2011): whole groups of unknowns
change sides, or one at a time if groups would cycle. Dense matrices of up to a few hundred
unknowns; compiled, because hundreds of such problems are solved for one recording.
"""

import numpy as np
from numba import njit

from dehyst.models.recording import Bools, Floats

RIDGE = 1e-12  # of the unit diagonal; resolves exactly collinear columns, far below any data
OUT, DUAL = 1e-12, 1e-9  # tolerances: distance beyond a bound, error of a multiplier
SINGULAR = 1e-15  # of the unit diagonal: a smaller pivot counts as zero


def bounded_solve(
    gram: Floats, right: Floats, low: Floats, high: Floats | None = None, free: Bools | None = None
) -> tuple[Floats, Bools]:
    """Return the solution (p,) and which unknowns are off their bounds (p,).

    gram: (p, p) symmetric positive semi-definite; right: (p,); low, high: (p,), infinite for no
    bound, high None: no upper bounds; free: initial guess of the unknowns off their bounds.
    """
    high = np.full(low.size, np.inf) if high is None else high
    side = np.zeros(low.size)  # -1: at low, 0: free, 1: at high
    if free is not None:
        side[~free & np.isfinite(low)] = -1.0
    gram = np.ascontiguousarray(gram)
    p = _pivot(gram, np.ascontiguousarray(right), low.copy(), high.copy(), side)
    return p, side == 0.0


@njit(cache=True, nogil=True)
def _pivot(gram: Floats, right: Floats, low: Floats, high: Floats, side: Floats) -> Floats:
    """Return the solution; on return, side describes it."""
    n = right.size
    scale = np.empty(n)
    for i in range(n):
        scale[i] = np.sqrt(gram[i, i]) if gram[i, i] > 0.0 else 1.0
        low[i] *= scale[i]
        high[i] *= scale[i]
    g, h = np.empty((n, n)), right / scale
    for i in range(n):
        for j in range(n):
            g[i, j] = gram[i, j] / (scale[i] * scale[j])
        g[i, i] += RIDGE
    p, over, wrong = h.copy(), np.zeros(n), np.zeros(n, dtype=np.bool_)
    fewest, patience = n + 1, 3
    for _ in range(20 * n + 20):
        _solve(g, h, side, low, high, p)
        count, last = 0, -1
        for i in range(n):
            over[i] = -1.0 if p[i] < low[i] - OUT else 1.0 if p[i] > high[i] + OUT else 0.0
            if side[i] == 0.0:
                wrong[i] = over[i] != 0.0
            else:
                dual = -h[i]
                for j in range(n):
                    dual += g[i, j] * p[j]
                wrong[i] = side[i] * dual > DUAL
            if wrong[i]:
                count += 1
                last = i
        if count == 0:
            break
        if count < fewest:
            fewest, patience = count, 3
        elif patience > 0:
            patience -= 1
        else:  # Murty's rule always terminates
            wrong[:] = False
            wrong[last] = True
        for i in range(n):
            if wrong[i]:
                side[i] = over[i] if side[i] == 0.0 else 0.0
    return np.minimum(np.maximum(p, low), high) / scale


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def _factor(a: Floats) -> bool:
    """Write Cholesky's factor into the lower half of a; return False if a is singular."""
    n = a.shape[0]
    for i in range(n):
        for j in range(i):
            total = a[i, j]
            for k in range(j):
                total -= a[i, k] * a[j, k]
            a[i, j] = total / a[j, j]
        total = a[i, i]
        for k in range(i):
            total -= a[i, k] * a[i, k]
        if not total > SINGULAR:
            return False
        a[i, i] = np.sqrt(total)
    return True


@njit(cache=True, nogil=True)
def _solve(g: Floats, h: Floats, side: Floats, low: Floats, high: Floats, p: Floats) -> None:
    """Write into p the solution with the unknowns of nonzero side on their bounds."""
    n = h.size
    at = np.flatnonzero(side == 0.0)
    for i in range(n):
        if side[i] != 0.0:
            p[i] = low[i] if side[i] < 0.0 else high[i]
    m = at.size
    part, rest = np.empty((m, m)), np.empty(m)
    for i in range(m):
        rest[i] = h[at[i]]
        for j in range(n):
            if side[j] != 0.0:
                rest[i] -= g[at[i], j] * p[j]
        for j in range(m):
            part[i, j] = g[at[i], at[j]]
    lower = part.copy()
    if _factor(lower):
        for i in range(m):
            for k in range(i):
                rest[i] -= lower[i, k] * rest[k]
            rest[i] /= lower[i, i]
        for i in range(m - 1, -1, -1):
            for k in range(i + 1, m):
                rest[i] -= lower[k, i] * rest[k]
            rest[i] /= lower[i, i]
    elif m:
        rest[:] = np.linalg.lstsq(part, rest, 1e-12)[0]
    for i in range(m):
        p[at[i]] = rest[i]
