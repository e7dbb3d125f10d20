"""Creep: after a step, y(t) = y0 [1 + g log10(t / 0.1 s)] from tau_min to tau_max.

As an operator, a sum of relaxations with time constants spread evenly over the logarithm, three
a decade, with one common gain (log-type creep; H. Jung, D.-G. Gweon, Rev. Sci. Instrum. 71, 2000):

    y = x + (g / 3) sum_j [q_j - m_j x],   tau_j dq_j/dt + q_j = x,   m_j = 1 - exp(-0.1 s / tau_j)

The m_j make 0.1 s after a step the time that the law calls y0. Exact for an input that runs in
straight lines between the samples.
"""

import math

import numpy as np
from numba import njit

from dehyst.models.blocks.kind import SAME, Kind, Param, Values
from dehyst.models.model import Floats

CODE = 6
PER_DECADE = 3
REFERENCE_S = 0.1


@njit(cache=True, nogil=True)
def step(p: Floats, s: Floats, x: float, t: float, dt: float, ch: float) -> float:
    """p: [g / 3, sum of m_j, tau_1 ... tau_n]; s: [x before, dt of the decays, q_1 ... q_n,
    decay_1 ... decay_n]."""
    n = p.size - 2
    if dt > 0.0 and abs(dt - s[1]) > SAME * dt:
        s[1] = dt
        for j in range(n):
            s[2 + n + j] = math.exp(-dt / p[2 + j])
    total = 0.0
    for j in range(n):
        if dt > 0.0:
            trail = p[2 + j] * (x - s[0]) / dt
            s[2 + j] = x - trail + s[2 + n + j] * (s[2 + j] - s[0] + trail)
        total += s[2 + j]
    s[0] = x
    return x + p[0] * (total - p[1] * x)


@njit(cache=True, nogil=True)
def solve(p: Floats, s: Floats, y: float, dt: float) -> float:
    """Input x that makes the next output y, from the state before; s is left as it is."""
    n = p.size - 2
    if dt <= 0.0:
        total = 0.0
        for j in range(n):
            total += s[2 + j]
        return (y - p[0] * total) / (1.0 - p[0] * p[1])
    through, free = 1.0 - p[0] * p[1], 0.0
    for j in range(n):
        decay = s[2 + n + j] if abs(dt - s[1]) <= SAME * dt else math.exp(-dt / p[2 + j])
        share = p[2 + j] / dt * (1.0 - decay)
        through += p[0] * (1.0 - share)
        free += p[0] * ((share - decay) * s[0] + decay * s[2 + j])
    return (y - free) / through


@njit(cache=True, nogil=True)
def run(p: Floats, s: Floats, x: Floats, t: Floats, ch: Floats, y: Floats) -> None:
    """The whole record: y (N,) for x (N,) at times t (N,)."""
    for i in range(x.size):
        dt = t[i] - t[i - 1] if i > 0 else 0.0
        y[i] = step(p, s, x[i], t[i], dt, ch[i] if ch.size > 0 else 0.0)


def _pack(values: Values, dt: float) -> Floats:
    low, high = values["tau_min"][0], values["tau_max"][0]
    n = max(1, round(PER_DECADE * math.log10(high / low)) + 1)
    tau = np.geomspace(low, high, n)
    mean = float(np.sum(1.0 - np.exp(-REFERENCE_S / tau)))
    return np.concatenate([[values["gain"][0] / PER_DECADE, mean], tau])


def _start(p: Floats, s: Floats, x: float) -> None:
    s[0], s[1] = x, 0.0
    s[2 : p.size] = x


def _check(values: Values) -> str:
    low, high = values["tau_min"][0], values["tau_max"][0]
    return "" if low <= high else "tau_min_s must not be above tau_max_s"


KIND = Kind(
    name="creep",
    says="creep",
    places=("stage", "sensor"),
    params=(
        Param("gain_per_decade", "gain", "1/decade", -0.2, 0.5, "growth per decade of time"),
        Param("tau_min_s", "tau_min", "s", 1e-6, 1e7, "shortest time constant"),
        Param("tau_max_s", "tau_max", "s", 1e-6, 1e7, "longest time constant"),
    ),
    code=CODE,
    step=step,
    run=run,
    pack=_pack,
    size=lambda p, dt: 2 + 2 * (p.size - 2),
    start=_start,
    causal=True,
    check=_check,
)
