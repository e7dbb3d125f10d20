"""A pure delay: y(t) = x(t - delay).

Between the samples of the past the input is taken as the cubic through the four nearest samples,
at the newest end as the parabola through the last three. Before the first sample the input is
the first one.
"""

import math

import numpy as np
from numba import njit

from dehyst.models.blocks.kind import Kind, Param, Values
from dehyst.models.model import Floats

CODE = 3


@njit(cache=True, nogil=True)
def _interpolate(s: Floats, newest: int, back: int, n: int, size: int, t: float) -> float:
    """Lagrange's polynomial at t through n samples of the ring, the newest `back` behind."""
    total = 0.0
    for i in range(n):
        a = (newest - back - i) % size
        part = s[2 + 2 * a + 1]
        for j in range(n):
            if j != i:
                b = (newest - back - j) % size
                part *= (t - s[2 + 2 * b]) / (s[2 + 2 * a] - s[2 + 2 * b])
        total += part
    return total


@njit(cache=True, nogil=True)
def step(p: Floats, s: Floats, x: float, t: float, dt: float, ch: float) -> float:
    """p: [delay]; s: [place of the newest, number stored, then pairs (time, x) in a ring]."""
    size = (s.size - 2) // 2
    newest = (int(s[0]) + 1) % size
    s[0] = newest
    stored = min(int(s[1]) + 1, size)
    s[1] = stored
    s[2 + 2 * newest] = t
    s[2 + 2 * newest + 1] = x
    at = t - p[0]
    if p[0] == 0.0 or stored == 1:
        return x
    oldest = (newest - stored + 1) % size
    if at <= s[2 + 2 * oldest]:
        return s[2 + 2 * oldest + 1]
    low, high = 0, stored - 1  # the first sample back that is not later than `at`
    while low < high:
        middle = (low + high) // 2
        if s[2 + 2 * ((newest - middle) % size)] <= at:
            high = middle
        else:
            low = middle + 1
    first = max(low - 2, 0)
    n = min(low + 1, stored - 1) - first + 1
    return _interpolate(s, newest, first, n, size, at)


@njit(cache=True, nogil=True)
def run(p: Floats, s: Floats, x: Floats, t: Floats, ch: Floats, y: Floats) -> None:
    """The whole record: y (N,) for x (N,) at times t (N,)."""
    for i in range(x.size):
        dt = t[i] - t[i - 1] if i > 0 else 0.0
        y[i] = step(p, s, x[i], t[i], dt, ch[i] if ch.size > 0 else 0.0)


MOST_SAMPLES = 1_000_000


def _size(p: Floats, dt: float) -> int:
    return 2 + 2 * min(math.ceil(p[0] / dt) + 4, MOST_SAMPLES)


def _pack(values: Values, dt: float) -> Floats:
    return np.array([values["delay"][0]])


def _start(p: Floats, s: Floats, x: float) -> None:
    s[:] = 0.0
    s[0] = -1.0


KIND = Kind(
    name="delay",
    says="a pure delay",
    places=("drive", "stage", "sensor"),
    params=(Param("delay_s", "delay", "s", 0.0, 10.0, "delay"),),
    code=CODE,
    step=step,
    run=run,
    pack=_pack,
    size=_size,
    start=_start,
    causal=False,
)
