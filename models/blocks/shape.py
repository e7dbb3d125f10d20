"""Further rate-independent hysteresis beside the base: play operators with curved envelopes.

    y = sum_i e1_i H_i + e2_i H_i^2 + ... + e5_i H_i^5

with H_i the play of width r_i / scale on (u - center) / scale.
It reads the drive as it reaches the hysteresis, and adds to the hysteresis' displacement.
The plays start de-energised, as the base's do.
"""

import numpy as np
from numba import njit

from dehyst.models.blocks.kind import Kind, Param, Values
from dehyst.models.model import Floats

CODE = 12


@njit(cache=True, nogil=True)
def step(p: Floats, s: Floats, x: float, t: float, dt: float, ch: float) -> float:
    """p: [center, scale, then r / scale, e1 ... e5 of n operators]; s: (n,) plays; x: drive."""
    n = s.size
    v = (x - p[0]) / p[1]
    y = 0.0
    for i in range(n):
        r = p[2 + i]
        h = max(v - r, min(v + r, s[i]))
        s[i] = h
        high = p[2 + 3 * n + i] + h * (p[2 + 4 * n + i] + h * p[2 + 5 * n + i])
        y += h * (p[2 + n + i] + h * (p[2 + 2 * n + i] + h * high))
    return y


@njit(cache=True, nogil=True)
def run(p: Floats, s: Floats, x: Floats, t: Floats, ch: Floats, y: Floats) -> None:
    """The whole record: y (N,) for x (N,) at times t (N,)."""
    for i in range(x.size):
        dt = t[i] - t[i - 1] if i > 0 else 0.0
        y[i] = step(p, s, x[i], t[i], dt, ch[i] if ch.size > 0 else 0.0)


def _pack(values: Values, dt: float) -> Floats:
    r = values["thresholds"]
    parts = [np.broadcast_to(values[f"weights_{k}"], r.shape) for k in range(1, 6)]
    center, scale = values["center"][0], values["scale"][0]
    return np.concatenate([[center, scale], r / scale, *parts])


def _start(p: Floats, s: Floats, x: float) -> None:
    s[:] = 0.0


def _check(values: Values) -> str:
    for k in range(1, 6):
        if values[f"weights_{k}"].size not in (1, values["thresholds"].size):
            return f"weights_{k}: as many as thresholds are needed"
    return ""


KIND = Kind(
    name="shape",
    says="hysteresis of another shape than the base",
    places=("stage",),
    params=(
        Param("thresholds_{u}", "thresholds", "", 0.0, 1e9, "thresholds", many=True),
        Param("weights_1", "weights_1", "", -1e9, 1e9, "of H", many=True, default=(0.0,)),
        Param("weights_2", "weights_2", "", -1e9, 1e9, "of H^2", many=True),
        Param("weights_3", "weights_3", "", -1e9, 1e9, "of H^3", many=True),
        Param("weights_4", "weights_4", "", -1e9, 1e9, "of H^4", many=True, default=(0.0,)),
        Param("weights_5", "weights_5", "", -1e9, 1e9, "of H^5", many=True, default=(0.0,)),
        Param("scale_{u}", "scale", "", 1e-9, 1e9, "drive that counts as 1"),
        Param("center_{u}", "center", "", -1e9, 1e9, "drive that counts as 0", default=(0.0,)),
    ),
    code=CODE,
    step=step,
    run=run,
    pack=_pack,
    size=lambda p, dt: (p.size - 2) // 6,
    start=_start,
    causal=True,
    check=_check,
)
