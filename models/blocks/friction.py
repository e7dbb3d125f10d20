"""Friction in the guide: y = x - (a + b exp(-(v / v_s)^2)) z, v = dx/dt, dz/dx = (sign v - z) / l.

The presliding state z of Dahl (1976) with the speed dependence of Stribeck, as in the LuGre
model (Canudas de Wit, Olsson, Astrom, Lischinsky, IEEE Trans. Autom. Control 40, 1995, 419).
"""

import math

from numba import njit

from dehyst.models.blocks.kind import Kind, Param, pack_in_order
from dehyst.models.model import Floats

CODE = 15


@njit(cache=True, nogil=True)
def step(p: Floats, s: Floats, x: float, t: float, dt: float, ch: float) -> float:
    """p: [length, stribeck speed, a, b]; s: [x before, z]."""
    dx = x - s[0]
    s[0] = x
    if dx != 0.0:
        sign = 1.0 if dx > 0.0 else -1.0
        s[1] = sign + (s[1] - sign) * math.exp(-abs(dx) / p[0])
    speed = dx / dt / p[1] if dt > 0.0 else 0.0
    return x - (p[2] + p[3] * math.exp(-speed * speed)) * s[1]


@njit(cache=True, nogil=True)
def run(p: Floats, s: Floats, x: Floats, t: Floats, ch: Floats, y: Floats) -> None:
    """The whole record: y (N,) for x (N,) at times t (N,)."""
    for i in range(x.size):
        dt = t[i] - t[i - 1] if i > 0 else 0.0
        y[i] = step(p, s, x[i], t[i], dt, ch[i] if ch.size > 0 else 0.0)


def _start(p: Floats, s: Floats, x: float) -> None:
    s[0], s[1] = x, 0.0


KIND = Kind(
    name="friction",
    says="friction in the guide",
    places=("stage",),
    params=(
        Param("length_{y}", "length", "", 1e-9, 1e9, "displacement before it slides"),
        Param("stribeck_{y}_per_s", "stribeck", "/s", 1e-9, 1e12, "speed at which it fades"),
        Param("sliding_{y}", "sliding", "", -1e9, 1e9, "at high speed"),
        Param("extra_{y}", "extra", "", -1e9, 1e9, "more at low speed"),
    ),
    code=CODE,
    step=step,
    run=run,
    pack=pack_in_order("length", "stribeck", "sliding", "extra"),
    size=lambda p, dt: 2,
    start=_start,
    causal=True,
    invertible=False,
)
