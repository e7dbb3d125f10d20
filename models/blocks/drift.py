"""Drift with temperature: y = x [1 + gain (T - T0)] + expansion (T - T0), T from a channel."""

from numba import njit

from dehyst.models.blocks.kind import Kind, Param, no_state, pack_in_order, settled_nothing
from dehyst.models.model import Floats

CODE = 7


@njit(cache=True, nogil=True)
def step(p: Floats, s: Floats, x: float, t: float, dt: float, ch: float) -> float:
    """p: [gain, expansion, reference]; no state."""
    warm = ch - p[2]
    return x * (1.0 + p[0] * warm) + p[1] * warm


@njit(cache=True, nogil=True)
def solve(p: Floats, y: float, ch: float) -> float:
    """Input x that makes the output y."""
    warm = ch - p[2]
    return (y - p[1] * warm) / max(1.0 + p[0] * warm, 0.1)


@njit(cache=True, nogil=True)
def run(p: Floats, s: Floats, x: Floats, t: Floats, ch: Floats, y: Floats) -> None:
    """The whole record: y (N,) for x (N,) at times t (N,)."""
    for i in range(x.size):
        dt = t[i] - t[i - 1] if i > 0 else 0.0
        y[i] = step(p, s, x[i], t[i], dt, ch[i] if ch.size > 0 else 0.0)


KIND = Kind(
    name="drift",
    says="drift with temperature",
    places=("stage", "sensor"),
    params=(
        Param("gain_per_k", "gain", "1/K", -0.2, 0.2, "change of gain"),
        Param("expansion_{y}_per_k", "expansion", "/K", -1e6, 1e6, "expansion"),
        Param("reference_c", "reference", "degC", -273.15, 1000.0, "temperature without drift"),
    ),
    code=CODE,
    step=step,
    run=run,
    pack=pack_in_order("gain", "expansion", "reference"),
    size=no_state,
    start=settled_nothing,
    causal=True,
    channel=True,
)
