"""Drift with a temperature that the stage follows late: tau dw/dt + w = T - T0,
y = x [1 + gain w] + expansion w."""

import math

from numba import njit

from dehyst.models.blocks.kind import Kind, Param, pack_in_order, settled_nothing
from dehyst.models.model import Floats

CODE = 18


@njit(cache=True, nogil=True)
def step(p: Floats, s: Floats, x: float, t: float, dt: float, ch: float) -> float:
    """p: [gain, expansion, reference, tau]; s: [input before, w, started]."""
    warm = ch - p[2]
    if s[2] == 0.0 or dt <= 0.0:
        s[1] = warm
        s[2] = 1.0
    else:
        trail = p[3] * (warm - s[0]) / dt
        s[1] = warm - trail + math.exp(-dt / p[3]) * (s[1] - s[0] + trail)
    s[0] = warm
    return x * (1.0 + p[0] * s[1]) + p[1] * s[1]


@njit(cache=True, nogil=True)
def solve(p: Floats, s: Floats, y: float) -> float:
    """Input x that makes the output y, with the stage as warm as s says."""
    return (y - p[1] * s[1]) / max(1.0 + p[0] * s[1], 0.1)


@njit(cache=True, nogil=True)
def run(p: Floats, s: Floats, x: Floats, t: Floats, ch: Floats, y: Floats) -> None:
    """The whole record: y (N,) for x (N,) at times t (N,)."""
    for i in range(x.size):
        dt = t[i] - t[i - 1] if i > 0 else 0.0
        y[i] = step(p, s, x[i], t[i], dt, ch[i] if ch.size > 0 else 0.0)


KIND = Kind(
    name="slow_drift",
    says="drift with temperature, following late",
    places=("stage", "sensor"),
    params=(
        Param("gain_per_k", "gain", "1/K", -2.0, 2.0, "change of gain"),
        Param("expansion_{y}_per_k", "expansion", "/K", -1e6, 1e6, "expansion"),
        Param("reference_c", "reference", "degC", -273.15, 1000.0, "temperature without drift"),
        Param("tau_s", "tau", "s", 1e-9, 1e6, "thermal time constant"),
    ),
    code=CODE,
    step=step,
    run=run,
    pack=pack_in_order("gain", "expansion", "reference", "tau"),
    size=lambda p, dt: 3,
    start=settled_nothing,
    causal=True,
    channel=True,
)
