"""Further hysteresis for the proof's stages, one of them of the library's own class.

- Duhem: dw/du = a (f(u) - w) |du| + ..., the semilinear form of Su, Stepanenko, Svoboda and Leung
  (IEEE Trans. Automat. Contr. 45, 2000): dw = alpha |du| (c u - w) + b du, with a bend on c u.
- Generalised dead zones: a play whose two envelopes are tanh curves of the drive (Al Janaideh,
  Rakheja, Su, Mechatronics 19, 2009).
- In the class: a sum of plays followed by a polynomial, which is the modified
  Prandtl-Ishlinskii model, implemented independently.

Input in volts (0 to 10), output in micrometres, from a de-energised start. Shares no code with the
library.
"""

from collections.abc import Callable

import numpy as np
from numba import njit
from tests.rigs.plants.hysteresis import Floats


@njit(cache=True, nogil=True)
def _duhem(u: Floats, alpha: float, slope: float, bend: float, b: float) -> Floats:
    out = np.empty(u.size)
    w = 0.0
    last = 0.0
    for t in range(u.size):
        pieces = 1 + int(abs(u[t] - last) / 0.005)
        step = (u[t] - last) / pieces
        for k in range(pieces):  # exact for a target whose slope is constant over the piece
            v = last + (k + 0.5) * step
            drift = b - slope - 2.0 * bend * v  # of w - target, by du
            sign = 1.0 if step > 0 else -1.0
            rest = sign * drift / alpha  # where w - target settles
            keep = np.exp(-alpha * abs(step))
            start = w - (slope * (v - 0.5 * step) + bend * (v - 0.5 * step) ** 2)
            end = v + 0.5 * step
            w = slope * end + bend * end * end + rest + (start - rest) * keep
        last = u[t]
        out[t] = w
    return out


def duhem(rng: np.random.Generator) -> Callable[[Floats], Floats]:
    """One internal variable that follows a bent line with a lag in the drive; loop 8 to 15 %."""
    alpha, slope = rng.uniform(0.35, 1.0), rng.uniform(0.9, 1.15)
    bend = rng.uniform(-0.012, 0.008)
    half = rng.uniform(0.08, 0.15) * 9.5 * slope / 2.0  # of the loop, once it is open
    b = slope - min(half * alpha, 0.8 * slope)

    def run(u: Floats) -> Floats:
        return _duhem(u, alpha, slope, bend, b)

    return run


@njit(cache=True, nogil=True)
def _envelope_plays(
    u: Floats, halves: Floats, weights: Floats, knee: float, shift: float
) -> Floats:
    out = np.empty(u.size)
    p = np.zeros(halves.size)
    for t in range(u.size):
        left = knee * np.tanh(u[t] / knee)
        right = knee * np.tanh((u[t] + shift) / knee) - knee * np.tanh(shift / knee)
        total = 0.0
        for i in range(halves.size):
            p[i] = max(left - halves[i], min(right + halves[i], p[i]))
            total += weights[i] * p[i]
        out[t] = total
    return out


def dead_zones(rng: np.random.Generator) -> Callable[[Floats], Floats]:
    """25 plays between two tanh curves, the rising one bent differently from the falling one."""
    halves = np.r_[0.0, np.exp(np.linspace(np.log(0.03), np.log(2.5), 24))]
    weights = rng.gamma(2.0, 1.0, 25) * np.exp(-halves / rng.uniform(0.7, 1.5))
    weights[0] = rng.uniform(3.0, 5.0) * np.sum(weights[1:]) / 3.0
    weights *= rng.uniform(0.9, 1.15) / np.sum(weights)
    knee, shift = rng.uniform(9.0, 16.0), rng.uniform(0.1, 0.5)

    def run(u: Floats) -> Floats:
        return 1.2 * _envelope_plays(u, halves, weights, knee, shift)

    return run


@njit(cache=True, nogil=True)
def _plays(u: Floats, halves: Floats, weights: Floats) -> Floats:
    out = np.zeros(u.size)
    p = np.zeros(halves.size)
    for t in range(u.size):
        for i in range(halves.size):
            p[i] = max(u[t] - halves[i], min(u[t] + halves[i], p[i]))
            out[t] += weights[i] * p[i]
    return out


def in_class(rng: np.random.Generator) -> Callable[[Floats], Floats]:
    """Eight plays followed by a cubic that rises everywhere."""
    halves = np.r_[0.0, np.cumsum(rng.uniform(0.15, 0.6, 7))]
    weights = np.r_[rng.uniform(0.5, 0.7), rng.uniform(0.02, 0.1, 7) * np.exp(-halves[1:] / 3.0)]
    weights *= rng.uniform(0.9, 1.1) / np.sum(weights)
    second, third = rng.uniform(-0.012, 0.012), rng.uniform(-6e-4, 6e-4)

    def run(u: Floats) -> Floats:
        z = _plays(u, halves, weights)
        return z + second * z**2 + third * z**3

    return run
