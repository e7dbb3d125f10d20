"""Further rate-independent hysteresis whose loops bend over instead of breaking loose.

    y = p_4 v^4 + p_5 v^5 + sum_j Z_j (e1_j + e2_j v + e3_j v^2 + e4_j Z_j + e5_j Z_j^2)
    dZ_j/dv = (sign(dv) - Z_j) / l_j,    v = (u - center) / scale

Dahl operators (P. Dahl, "Solid friction damping of mechanical vibrations", 1976, exponent 1),
exact for a drive that moves straight between samples: loops of Duhem and Bouc-Wen kind, which
sums of plays do not make. It reads the drive as it reaches the hysteresis, and adds to the
hysteresis' displacement, as a shape block does. Z starts at 0 with the first sample.
"""

import math

import numpy as np
from numba import njit

from dehyst.models.blocks.kind import Kind, Param, Values
from dehyst.models.model import Floats

CODE = 13
TERMS = ("of Z", "of Z v", "of Z v^2", "of Z^2", "of Z^3")


@njit(cache=True, nogil=True)
def step(p: Floats, s: Floats, x: float, t: float, dt: float, ch: float) -> float:
    """p: [center, scale, p_4, p_5, then l / scale, e1 ... e5 of n operators]; s: [v before, (n,)
    operators]; x: drive."""
    n = s.size - 1
    v = (x - p[0]) / p[1]
    dv = v - s[0]
    s[0] = v
    square = v * v
    y = square * square * (p[2] + p[3] * v)
    for j in range(n):
        z = s[1 + j]
        if dv != 0.0:
            sign = 1.0 if dv > 0.0 else -1.0
            z = sign + (z - sign) * math.exp(-abs(dv) / p[4 + j])
            s[1 + j] = z
        even = p[4 + n + j] + v * (p[4 + 2 * n + j] + v * p[4 + 3 * n + j])
        y += z * (even + z * (p[4 + 4 * n + j] + z * p[4 + 5 * n + j]))
    return y


@njit(cache=True, nogil=True)
def run(p: Floats, s: Floats, x: Floats, t: Floats, ch: Floats, y: Floats) -> None:
    """The whole record: y (N,) for x (N,) at times t (N,)."""
    for i in range(x.size):
        dt = t[i] - t[i - 1] if i > 0 else 0.0
        y[i] = step(p, s, x[i], t[i], dt, ch[i] if ch.size > 0 else 0.0)


def _pack(values: Values, dt: float) -> Floats:
    lengths = values["lengths"]
    scale = values["scale"][0]
    head = [values["center"][0], scale, values["power_4"][0], values["power_5"][0]]
    parts = [np.broadcast_to(values[f"weights_{k}"], lengths.shape) for k in range(1, 6)]
    return np.concatenate([head, lengths / scale, *parts])


def _start(p: Floats, s: Floats, x: float) -> None:
    s[:] = 0.0
    s[0] = (x - p[0]) / p[1]


def _check(values: Values) -> str:
    for k in range(1, 6):
        if values[f"weights_{k}"].size not in (1, values["lengths"].size):
            return f"weights_{k}: as many as lengths are needed"
    return ""


KIND = Kind(
    name="memory",
    says="hysteresis of another shape than the base, with bent loops",
    places=("stage",),
    params=(
        Param("lengths_{u}", "lengths", "", 1e-9, 1e9, "drive in which Z follows", many=True),
        *(
            Param(f"weights_{k + 1}", f"weights_{k + 1}", "", -1e9, 1e9, what, many=True)
            for k, what in enumerate(TERMS)
        ),
        Param("power_4", "power_4", "", -1e9, 1e9, "of v^4", default=(0.0,)),
        Param("power_5", "power_5", "", -1e9, 1e9, "of v^5", default=(0.0,)),
        Param("scale_{u}", "scale", "", 1e-9, 1e9, "drive that counts as 1"),
        Param("center_{u}", "center", "", -1e9, 1e9, "drive that counts as 0", default=(0.0,)),
    ),
    code=CODE,
    step=step,
    run=run,
    pack=_pack,
    size=lambda p, dt: 1 + (p.size - 4) // 6,
    start=_start,
    causal=True,
    invertible=False,
    check=_check,
)
