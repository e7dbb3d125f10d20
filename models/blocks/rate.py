"""Loops that change with the rate: plays weighted by a power of the drive's rate.

    y = sum_i g_i q(t) (v - H_i) + k_i dv/dt H_i,    q = |dv/dt|^p behind a low-pass,

v = (u - center) / scale, H_i its plays of width r_i / scale. The first sum is what thresholds
that dilate with the rate do to first order, the second the linear rate dependence of Qin et al.
(Eq. 5). It reads the drive as it reaches the hysteresis and adds to its displacement.
"""

import math

import numpy as np
from numba import njit

from dehyst.models.blocks.kind import Kind, Param, Values
from dehyst.models.model import Floats

CODE = 16


@njit(cache=True, nogil=True)
def step(p: Floats, s: Floats, x: float, t: float, dt: float, ch: float) -> float:
    """p: [center, scale, power, tau, then r / scale, g, k of n operators]; s: [v before, smooth
    rate, (n,) plays]."""
    n = s.size - 2
    v = (x - p[0]) / p[1]
    rate = (v - s[0]) / dt if dt > 0.0 else 0.0
    s[0] = v
    if dt > 0.0:
        keep = math.exp(-dt / p[3])
        s[1] = keep * s[1] + (1.0 - keep) * rate
    strength = abs(s[1]) ** p[2]
    y = 0.0
    for i in range(n):
        r = p[4 + i]
        h = max(v - r, min(v + r, s[2 + i]))
        s[2 + i] = h
        y += p[4 + n + i] * strength * (v - h) + p[4 + 2 * n + i] * s[1] * h
    return y


@njit(cache=True, nogil=True)
def run(p: Floats, s: Floats, x: Floats, t: Floats, ch: Floats, y: Floats) -> None:
    """The whole record: y (N,) for x (N,) at times t (N,)."""
    for i in range(x.size):
        dt = t[i] - t[i - 1] if i > 0 else 0.0
        y[i] = step(p, s, x[i], t[i], dt, ch[i] if ch.size > 0 else 0.0)


def _pack(values: Values, dt: float) -> Floats:
    r, scale = values["thresholds"], values["scale"][0]
    head = [values["center"][0], scale, values["power"][0], values["smoothing"][0]]
    parts = [np.broadcast_to(values[k], r.shape) for k in ("widening", "slopes")]
    return np.concatenate([head, r / scale, *parts])


def _start(p: Floats, s: Floats, x: float) -> None:
    s[:] = 0.0
    s[0] = (x - p[0]) / p[1]


def _check(values: Values) -> str:
    for k in ("widening", "slopes"):
        if values[k].size not in (1, values["thresholds"].size):
            return f"{k}: as many as thresholds are needed"
    return ""


KIND = Kind(
    name="rate",
    says="loops that change with the rate",
    places=("stage",),
    params=(
        Param("thresholds_{u}", "thresholds", "", 0.0, 1e9, "thresholds", many=True),
        Param("widening", "widening", "", -1e9, 1e9, "of q (v - H)", many=True),
        Param("slopes", "slopes", "", -1e9, 1e9, "of dv/dt H", many=True),
        Param("power", "power", "", 0.0, 3.0, "of the rate"),
        Param("smoothing_s", "smoothing", "s", 1e-9, 100.0, "time constant of the rate"),
        Param("scale_{u}", "scale", "", 1e-9, 1e9, "drive that counts as 1"),
        Param("center_{u}", "center", "", -1e9, 1e9, "drive that counts as 0", default=(0.0,)),
    ),
    code=CODE,
    step=step,
    run=run,
    pack=_pack,
    size=lambda p, dt: 2 + (p.size - 4) // 3,
    start=_start,
    causal=True,
    invertible=False,
    check=_check,
)
