"""Least squares with lower bounds, from the normal equations.

    minimise  p' G p / 2 - g' p   with   p >= low   (low = -inf: free)

Block principal pivoting (J. Kim, H. Park, "Fast nonnegative matrix factorization: an
active-set-like method and comparisons", SIAM J. Sci. Comput. 33, 2011): whole groups of
unknowns change sides, one at a time where groups would cycle. Small and dense: up to a
few hundred unknowns.
"""

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from dehyst.models.recording import Bools, Floats

RIDGE = 1e-12  # of the unit diagonal; settles exactly collinear columns, far below any data


def bounded_solve(
    gram: Floats, right: Floats, low: Floats, free: Bools | None = None
) -> tuple[Floats, Bools]:
    """Solution (p,) and which unknowns are off their bound (p,).

    gram: (p, p) symmetric positive semi-definite; right: (p,); low: (p,), -inf for no bound;
    free: a first guess of the unknowns off their bound.
    """
    scale = np.sqrt(np.maximum(np.diag(gram), 0.0))
    scale[scale == 0.0] = 1.0
    g = gram / np.outer(scale, scale)
    g[np.diag_indices_from(g)] += RIDGE
    base = np.where(np.isfinite(low), low, 0.0) * scale
    h = right / scale - g @ base  # the problem in what is above the bound
    can_stop = np.isfinite(low)
    inside = np.ones(h.size, dtype=bool) if free is None else free | ~can_stop
    fewest, patience = h.size + 1, 3
    for _ in range(20 * h.size + 20):
        p = _solve(g, h, inside)
        dual = g @ p - h
        wrong = (inside & can_stop & (p < -1e-12)) | (~inside & (dual < -1e-9))
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
        inside = inside ^ wrong
    p = np.where(can_stop, np.maximum(p, 0.0), p)
    return (p + base) / scale, inside


def _solve(g: Floats, h: Floats, inside: Bools) -> Floats:
    out = np.zeros(h.size)
    at = np.flatnonzero(inside)
    if at.size:
        part = g[np.ix_(at, at)]
        try:
            out[at] = cho_solve(cho_factor(part, check_finite=False), h[at], check_finite=False)
        except LinAlgError:
            out[at] = np.linalg.lstsq(part, h[at], rcond=1e-12)[0]
    return out
