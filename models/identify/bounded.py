"""Least squares with bounds on both sides, from the normal equations.

    minimise  p' G p / 2 - g' p   with   low <= p <= high   (infinite: free)

Block principal pivoting (J. Kim, H. Park, "Fast nonnegative matrix factorization: an
active-set-like method and comparisons", SIAM J. Sci. Comput. 33, 2011): whole groups of
unknowns change sides, one at a time where groups would cycle. Small and dense: up to a
few hundred unknowns.
"""

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from dehyst.models.recording import Bools, Floats

RIDGE = 1e-12  # of the unit diagonal; settles exactly collinear columns, far below any data
OUT, DUAL = 1e-12, 1e-9  # how far beyond a bound, and how wrong a multiplier, is none


def bounded_solve(
    gram: Floats, right: Floats, low: Floats, high: Floats | None = None, free: Bools | None = None
) -> tuple[Floats, Bools]:
    """Solution (p,) and which unknowns are off their bounds (p,).

    gram: (p, p) symmetric positive semi-definite; right: (p,); low, high: (p,), infinite for no
    bound, high None: nowhere; free: a first guess of the unknowns off their bounds.
    """
    scale = np.sqrt(np.maximum(np.diag(gram), 0.0))
    scale[scale == 0.0] = 1.0
    g = gram / np.outer(scale, scale)
    g[np.diag_indices_from(g)] += RIDGE
    h = right / scale
    low = low * scale
    high = np.full(low.size, np.inf) if high is None else high * scale
    side = np.zeros(low.size)  # -1: at low, 0: free, 1: at high
    if free is not None:
        side[~free & np.isfinite(low)] = -1.0
    fewest, patience = low.size + 1, 3
    p = h
    for _ in range(20 * h.size + 20):
        p = _solve(g, h, side, low, high)
        dual = g @ p - h
        over = np.where(p < low - OUT, -1.0, np.where(p > high + OUT, 1.0, 0.0))
        wrong = ((side == 0.0) & (over != 0.0)) | (side * dual > DUAL)
        count = int(np.count_nonzero(wrong))
        if count == 0:
            break
        if count < fewest:
            fewest, patience = count, 3
        elif patience > 0:
            patience -= 1
        else:  # Murty's rule ends surely
            last = int(np.flatnonzero(wrong)[-1])
            wrong = np.zeros_like(wrong)
            wrong[last] = True
        side = np.where(wrong, np.where(side == 0.0, over, 0.0), side)
    return np.clip(p, low, high) / scale, side == 0.0


def _solve(g: Floats, h: Floats, side: Floats, low: Floats, high: Floats) -> Floats:
    out = np.where(side < 0.0, low, np.where(side > 0.0, high, 0.0))
    free = side == 0.0
    at, held = np.flatnonzero(free), np.flatnonzero(~free)
    if at.size == 0:
        return out
    part = g[np.ix_(at, at)]
    rest = h[at] - g[np.ix_(at, held)] @ out[held]
    try:
        out[at] = cho_solve(cho_factor(part, check_finite=False), rest, check_finite=False)
    except LinAlgError:
        out[at] = np.linalg.lstsq(part, rest, rcond=1e-12)[0]
    return out
