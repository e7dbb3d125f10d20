"""The play (backlash) operator, the element of a Prandtl-Ishlinskii model.

    H_r(t) = max(u(t) - r, min(u(t) + r, H_r(t - T)))
    H_r(0) = max(u(0) - r, min(u(0) + r, h0))

after Eq. 1 of Qin et al., "Modeling and Identification of the Rate-Dependent Hysteresis of
Piezoelectric Actuator Using a Modified Prandtl-Ishlinskii Model". The printed equation has x(t)
in place of the first u(t), a misprint. h0 = 0 for an actuator that starts de-energised.

The array form calls the one-sample kernel, so that both give bit-identical results.
"""

import numpy as np
from numba import njit

from dehyst.models.arrays import Floats


@njit(cache=True, nogil=True)
def play_step(r: Floats, h: Floats, u: float) -> None:
    """Advance the operators by one sample, in place.

    r: (n,) thresholds, >= 0, in the unit of u. h: (n,) operator outputs, overwritten.
    """
    for i in range(r.size):
        h[i] = max(u - r[i], min(u + r[i], h[i]))


@njit(cache=True, nogil=True)
def play_matrix(r: Floats, u: Floats, h0: Floats) -> Floats:
    """Return the outputs (N, n) of n operators over N samples.

    r: (n,) thresholds; u: (N,) input; h0: (n,) outputs before the first sample, not modified.
    """
    out = np.empty((u.size, r.size))
    h = h0.copy()
    for t in range(u.size):
        play_step(r, h, u[t])
        out[t] = h
    return out
