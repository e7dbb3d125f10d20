"""Three hysteresis classes for the proof's stages, none of them a sum of plays with a polynomial.

- Maxwell slip: 60 elements whose force does not break loose sharply but bends over (the Dahl
  form dF/dx = k (1 - (F/S) sgn dx)^p), on a spring that stiffens; strengths spread at random.
- Preisach: two densities p(alpha) q(beta), neither symmetric nor a function of alpha - beta, so
  minor loops of equal swing differ with the mean; summed exactly over the turning points.
- Bouc-Wen: dh = A du - beta |du| |h|^(n-1) h - gamma du |h|^n; its minor loops do not close.

Input in volts (0 to 10), output in micrometres, from a de-energised start. The input is any sampled
curve, linear between samples. Shares no code with the library.
"""

from collections.abc import Callable

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.special import erf

Floats = NDArray[np.float64]


@njit(cache=True, nogil=True)
def _slip_bank(x: Floats, yields: Floats, strength: Floats, power: float) -> Floats:
    """Return the sum of the forces. yields: S / k of each element; the Dahl form, exact between
    reversals."""
    out = np.empty(x.size)
    force = np.zeros(yields.size)
    last = 0.0
    for t in range(x.size):
        dx = x[t] - last
        last = x[t]
        sign = 1.0 if dx > 0 else -1.0
        total = 0.0
        for i in range(yields.size):
            room = 1.0 - sign * force[i] / strength[i]
            if room > 1e-12:
                left = room ** (1.0 - power) + (power - 1.0) * abs(dx) / yields[i]
                force[i] = sign * strength[i] * (1.0 - left ** (1.0 / (1.0 - power)))
            total += force[i]
        out[t] = total
    return out


def maxwell_slip(rng: np.random.Generator) -> Callable[[Floats], Floats]:
    """60 elements; y = stiffening spring - loss forces, 0.9 to 1.15 um/V, loop 8 to 16 %."""
    count = 60
    yields = np.exp(rng.uniform(np.log(0.02), np.log(3.5), count))
    strength = rng.gamma(2.0, 1.0, count) * yields
    power = rng.uniform(1.2, 1.8)
    slope, bend = rng.uniform(0.9, 1.15), rng.uniform(-0.012, 0.006)
    wanted = rng.uniform(0.08, 0.16) * 9.5 * slope
    scale = wanted / (2.0 * np.sum(strength))

    def run(u: Floats) -> Floats:
        loss = _slip_bank(u, yields, strength * scale, power)
        return slope * u + bend * u**2 + 0.4 * np.tanh(u / 4.0) - loss

    return run


@njit(cache=True, nogil=True)
def _preisach(u: Floats, p: Floats, r: Floats, q: Floats, grid: float) -> Floats:
    """Sum over the staircase: E(a, b) = R(a) - R(b) - Q(b) (P(a) - P(b)), tables over 0..10 V."""
    out = np.empty(u.size)
    high = np.zeros(u.size // 2 + 8)
    low = np.zeros(u.size // 2 + 8)
    n = 0  # remembered pairs: a maximum and the minimum after it, each inside the one before
    top, bottom = 0.0, 0.0
    rising = True
    for t in range(u.size):
        v = u[t]
        if rising and v < top:
            rising = False
            high[n] = top
        elif not rising and v > bottom:
            rising = True
            low[n] = bottom
            n += 1
        if rising:
            top = v
            while n > 0 and top >= high[n - 1]:  # wiped out
                n -= 1
            out[t] = _staircase(high, low, n, top, p, r, q, grid)
        else:
            bottom = v
            while n > 0 and bottom <= low[n - 1]:
                n -= 1
            switched_off = _everett(high[n], bottom, p, r, q, grid)
            out[t] = _staircase(high, low, n, high[n], p, r, q, grid) - switched_off
    return out


@njit(cache=True, nogil=True)
def _staircase(
    high: Floats, low: Floats, n: int, top: float, p: Floats, r: Floats, q: Floats, grid: float
) -> float:
    """Return the relays that are on: switched on by every remembered rise, minus those switched off
    by the fall."""
    total, floor = 0.0, 0.0
    for i in range(n):
        total += _everett(high[i], floor, p, r, q, grid) - _everett(high[i], low[i], p, r, q, grid)
        floor = low[i]
    return total + _everett(top, floor, p, r, q, grid)


@njit(cache=True, nogil=True)
def _look(table: Floats, x: float, grid: float) -> float:
    place = min(max(x / grid, 0.0), table.size - 1.001)
    i = int(place)
    return table[i] + (place - i) * (table[i + 1] - table[i])


@njit(cache=True, nogil=True)
def _everett(a: float, b: float, p: Floats, r: Floats, q: Floats, grid: float) -> float:
    if a <= b:
        return 0.0
    pa, pb = _look(p, a, grid), _look(p, b, grid)
    ra, rb = _look(r, a, grid), _look(r, b, grid)
    return ra - rb - _look(q, b, grid) * (pa - pb)


def preisach(rng: np.random.Generator) -> Callable[[Floats], Floats]:
    """Two product densities and a reversible part; about 1 um/V."""
    grid = 12.0 / 6000
    x = np.arange(6001) * grid
    tables = []
    for _ in range(2):
        up, down = rng.uniform(3.0, 6.5), rng.uniform(2.5, 5.5)
        width_up, width_down = rng.uniform(2.0, 4.0, 2)
        big_p = erf((x - up) / width_up) - erf(-up / width_up)
        big_q = erf((x - down) / width_down) - erf(-down / width_down)
        small_p = np.gradient(big_p, grid)
        big_r = np.r_[0.0, np.cumsum(0.5 * (big_q[1:] * small_p[1:] + big_q[:-1] * small_p[:-1]))]
        tables.append((big_p, big_r * grid, big_q, rng.uniform(0.5, 1.0)))
    slope, bend = rng.uniform(0.55, 0.85), rng.uniform(-0.006, 0.006)
    ramp = np.r_[np.linspace(0, 9.5, 400), np.linspace(9.5, 0, 400)]
    raw = sum(w * _preisach(ramp, p, r, q, grid) for p, r, q, w in tables)
    half = np.interp(4.75, ramp[:400], raw[:400])
    back = np.interp(4.75, ramp[:399:-1], raw[:399:-1])
    scale = rng.uniform(0.09, 0.17) * 9.5 / abs(back - half)

    def run(u: Floats) -> Floats:
        v = np.maximum(u, 0.0)
        loops = sum(w * _preisach(v, p, r, q, grid) for p, r, q, w in tables)
        return slope * u + bend * u**2 + scale * loops

    return run


@njit(cache=True, nogil=True)
def _bouc_wen(u: Floats, beta: float, gamma: float, power: float) -> Floats:
    out = np.empty(u.size)
    h = 0.0
    last = 0.0
    for t in range(u.size):
        du = u[t] - last
        last = u[t]
        pieces = 1 + int(abs(du) / 0.005)
        step = du / pieces
        for _ in range(pieces):  # midpoint rule
            half = h + 0.5 * (
                step - beta * abs(step) * h * abs(h) ** (power - 1) - gamma * step * abs(h) ** power
            )
            h += (
                step
                - beta * abs(step) * half * abs(half) ** (power - 1)
                - gamma * step * abs(half) ** power
            )
        out[t] = h
    return out


def bouc_wen(rng: np.random.Generator) -> Callable[[Floats], Floats]:
    """One internal variable, exponent 1 to 1.6, on a bent spring."""
    beta, gamma = rng.uniform(0.35, 0.8), rng.uniform(-0.15, 0.2)
    power = rng.uniform(1.0, 1.6)
    slope, bend = rng.uniform(0.95, 1.15), rng.uniform(-0.012, 0.004)
    limit = (1.0 / (beta + gamma)) ** (1.0 / power)
    share = rng.uniform(0.07, 0.14) * 9.5 * slope / (2.0 * limit)

    def run(u: Floats) -> Floats:
        return slope * u + bend * u**2 - share * _bouc_wen(u, beta, gamma, power)

    return run


CLASSES = {"maxwell-slip": maxwell_slip, "preisach": preisach, "bouc-wen": bouc_wen}
