"""Friction in the guide: y = x - (a + b exp(-(v / v_s)^2)) z, v = dx/dt, dz/dx = (sign v - z) / l.

The presliding state z of Dahl (1976) with the speed dependence of Stribeck, as in the LuGre
model (Canudas de Wit, Olsson, Astrom, Lischinsky, IEEE Trans. Autom. Control 40, 1995, 419).
"""

import math

from numba import njit

from dehyst.models.blocks.kind import Kind, Param, pack_in_order
from dehyst.models.model import Floats

CODE = 15
SETTLED = 1e-6  # part of the friction


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
def _output(p: Floats, s: Floats, x: float, dt: float) -> float:
    """What `step` gives, s left as it is."""
    dx, z = x - s[0], s[1]
    if dx != 0.0:
        sign = 1.0 if dx > 0.0 else -1.0
        z = sign + (z - sign) * math.exp(-abs(dx) / p[0])
    speed = dx / dt / p[1] if dt > 0.0 else 0.0
    return x - (p[2] + p[3] * math.exp(-speed * speed)) * z


@njit(cache=True, nogil=True)
def solve(p: Floats, s: Floats, y: float, dt: float) -> float:
    """Input x that makes the next output y, from the state before; s is left as it is. There
    always is one within the largest friction of y; regula falsi (Illinois)."""
    most = abs(p[2]) + abs(p[3])
    low, high = y - most, y + most
    at_low, at_high = _output(p, s, low, dt) - y, _output(p, s, high, dt) - y
    side, x = 0, y
    for _ in range(60):
        if not at_low < at_high:
            break
        x = (low * at_high - high * at_low) / (at_high - at_low)
        e = _output(p, s, x, dt) - y
        if abs(e) <= SETTLED * most:
            break
        if e > 0.0:
            high, at_high = x, e
            at_low *= 0.5 if side > 0 else 1.0
            side = 1
        else:
            low, at_low = x, e
            at_high *= 0.5 if side < 0 else 1.0
            side = -1
    return x


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
)
