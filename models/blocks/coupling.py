"""Coupling from another channel (axis drive, force): y = x + gain (channel - reference)."""

from numba import njit

from dehyst.models.blocks.kind import Kind, Param, no_state, pack_in_order, settled_nothing
from dehyst.models.model import Floats

CODE = 9


@njit(cache=True, nogil=True)
def step(p: Floats, s: Floats, x: float, t: float, dt: float, ch: float) -> float:
    """p: [gain, reference]; no state."""
    return x + p[0] * (ch - p[1])


@njit(cache=True, nogil=True)
def run(p: Floats, s: Floats, x: Floats, t: Floats, ch: Floats, y: Floats) -> None:
    """The whole record: y (N,) for x (N,) at times t (N,)."""
    for i in range(x.size):
        dt = t[i] - t[i - 1] if i > 0 else 0.0
        y[i] = step(p, s, x[i], t[i], dt, ch[i] if ch.size > 0 else 0.0)


KIND = Kind(
    name="coupling",
    says="coupling from another channel",
    places=("stage", "sensor"),
    params=(
        Param("gain_{y}_per_unit", "gain", "/unit", -1e6, 1e6, "gain per unit of the channel"),
        Param("reference", "reference", "", -1e9, 1e9, "channel at rest", default=(0.0,)),
    ),
    code=CODE,
    step=step,
    run=run,
    pack=pack_in_order("gain", "reference"),
    size=no_state,
    start=settled_nothing,
    causal=True,
    channel=True,
)
