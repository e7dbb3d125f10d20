"""A reading that errs periodically: y = x + a sin(2 pi x / p) + b cos(2 pi x / p) - b.

The interpolation error of encoders and interferometers, or any nonlinearity of a sensor that
repeats along its range. It belongs to the reading, and is never compensated by the drive.
"""

import math

from numba import njit

from dehyst.models.blocks.kind import Kind, Param, no_state, pack_in_order, settled_nothing
from dehyst.models.model import Floats

CODE = 14


@njit(cache=True, nogil=True)
def step(p: Floats, s: Floats, x: float, t: float, dt: float, ch: float) -> float:
    """p: [period, a, b]; no state."""
    angle = 2.0 * math.pi * x / p[0]
    return x + p[1] * math.sin(angle) + p[2] * (math.cos(angle) - 1.0)


@njit(cache=True, nogil=True)
def run(p: Floats, s: Floats, x: Floats, t: Floats, ch: Floats, y: Floats) -> None:
    """The whole record: y (N,) for x (N,) at times t (N,)."""
    for i in range(x.size):
        dt = t[i] - t[i - 1] if i > 0 else 0.0
        y[i] = step(p, s, x[i], t[i], dt, ch[i] if ch.size > 0 else 0.0)


KIND = Kind(
    name="ripple",
    says="a reading that errs periodically along the range",
    places=("sensor",),
    params=(
        Param("period_{y}", "period", "", 1e-9, 1e9, "displacement from one error to the next"),
        Param("sine_{y}", "sine", "", -1e9, 1e9, "amplitude of the sine"),
        Param("cosine_{y}", "cosine", "", -1e9, 1e9, "amplitude of the cosine"),
    ),
    code=CODE,
    step=step,
    run=run,
    pack=pack_in_order("period", "sine", "cosine"),
    size=no_state,
    start=settled_nothing,
    causal=True,
    invertible=False,
)
