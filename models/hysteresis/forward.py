"""Evaluate the modified Prandtl-Ishlinskii model, for one sample with explicit state or an array.

    z = sum_i (b_i + k_i du/dt) H_ri(u - u_offset),   y = c_0 + c_1 z + c_2 z^2 + ...

(Qin et al., Eq. 3, 5 and 6; Eq. 4 where k = 0.) du/dt is the backward difference over the
sampling period, 0 at the first sample. The array form calls the one-sample kernel.
"""

import numpy as np
from numba import njit

from dehyst.models.hysteresis.play import play_step
from dehyst.models.model import Floats, Hysteresis


@njit(cache=True, nogil=True)
def polynomial(c: Floats, z: float) -> float:
    """Evaluate c_0 + c_1 z + ... by Horner's rule; c in ascending powers."""
    y = 0.0
    for j in range(c.size - 1, -1, -1):
        y = y * z + c[j]
    return y


@njit(cache=True, nogil=True)
def forward_step(
    r: Floats, b: Floats, k: Floats, c: Floats, u_offset: float, h: Floats, u: float, rate: float
) -> float:
    """Return the displacement at one sample and advance h (n,) in place.

    rate: du/dt [drive unit / s].
    """
    play_step(r, h, u - u_offset)
    z = 0.0
    for i in range(r.size):
        z += (b[i] + k[i] * rate) * h[i]
    return polynomial(c, z)


@njit(cache=True, nogil=True)
def _forward_array(
    r: Floats, b: Floats, k: Floats, c: Floats, u_offset: float, h: Floats, u: Floats, dt: float
) -> Floats:
    y = np.empty(u.size)
    before = u[0] if u.size else 0.0
    for t in range(u.size):
        y[t] = forward_step(r, b, k, c, u_offset, h, u[t], (u[t] - before) / dt)
        before = u[t]
    return y


def initial_plays(model: Hysteresis, u: float = 0.0) -> Floats:
    """Return the (n,) operator outputs of a de-energised actuator at its first drive u (Eq. 1)."""
    h = np.zeros(model.n)
    play_step(model.r, h, u - model.u_offset)
    return h


def simulate_hysteresis(
    model: Hysteresis, u: Floats, dt: float, h0: Floats | None = None
) -> Floats:
    """Return the displacement (N,) for a drive u (N,) sampled every dt seconds.

    h0: (n,) operator outputs before the first sample, not modified; None: de-energised (zero).
    """
    h = np.zeros(model.n) if h0 is None else np.array(h0, dtype=np.float64)
    u = np.ascontiguousarray(u, dtype=np.float64)
    return _forward_array(model.r, model.b, model.k, model.c, model.u_offset, h, u, dt)
