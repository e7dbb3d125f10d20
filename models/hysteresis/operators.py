"""The parameters of the hysteresis in one tuple, the form that the kernels take."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dehyst.models.model import Floats, Hysteresis

FAST = {"reassoc", "contract", "nsz", "arcp"}  # sums over operators may be reordered

R, B, K, B_STATIC = range(4)  # rows of `weights`


class Operators(NamedTuple):
    """weights: (4, n) rows r, b, k and the weights b of the nearest monotone model; c: (m,)
    saturation in ascending powers; u_offset: (1,)."""

    weights: NDArray[np.float64]
    c: NDArray[np.float64]
    u_offset: NDArray[np.float64]


def operators(h: Hysteresis, b_static: Floats) -> Operators:
    """Return the tuple for a model's hysteresis."""
    weights = np.ascontiguousarray(np.stack([h.r, h.b, h.k, b_static]))
    return Operators(weights, np.ascontiguousarray(h.c), np.array([float(h.u_offset)]))


@njit(cache=True, nogil=True, fastmath=FAST)
def move(weights: Floats, h: Floats, v: float) -> tuple[float, float]:
    """Advance the plays h (n,) in place to the input v. Return sum b H and sum k H."""
    z = 0.0
    kh = 0.0
    for i in range(h.size):
        x = max(v - weights[0, i], min(v + weights[0, i], h[i]))
        h[i] = x
        z += weights[1, i] * x
        kh += weights[2, i] * x
    return z, kh
