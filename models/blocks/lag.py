"""First-order lag: tau dy/dt + y = x (amplifier into the stack's capacitance, sensor filter).

Exact for an input that runs in straight lines between the samples.
"""

import math

from numba import njit

from dehyst.models.blocks.kind import SAME, Kind, Param, pack_in_order
from dehyst.models.model import Floats

CODE = 1


@njit(cache=True, nogil=True)
def step(p: Floats, s: Floats, x: float, t: float, dt: float, ch: float) -> float:
    """p: [tau]; s: [y, x before, dt of the stored decay, decay]."""
    if dt > 0.0:
        tau = p[0]
        if abs(dt - s[2]) > SAME * dt:
            s[2] = dt
            s[3] = math.exp(-dt / tau)
        ramp = (x - s[1]) / dt
        s[0] = x - tau * ramp + s[3] * (s[0] - s[1] + tau * ramp)
    s[1] = x
    return s[0]


@njit(cache=True, nogil=True)
def run(p: Floats, s: Floats, x: Floats, t: Floats, ch: Floats, y: Floats) -> None:
    """The whole record: y (N,) for x (N,) at times t (N,)."""
    for i in range(x.size):
        dt = t[i] - t[i - 1] if i > 0 else 0.0
        y[i] = step(p, s, x[i], t[i], dt, ch[i] if ch.size > 0 else 0.0)


def _start(p: Floats, s: Floats, x: float) -> None:
    s[0] = s[1] = x


KIND = Kind(
    name="lag",
    says="a first-order lag",
    places=("drive", "stage", "sensor"),
    params=(Param("tau_s", "tau", "s", 1e-9, 100.0, "time constant"),),
    code=CODE,
    step=step,
    run=run,
    pack=pack_in_order("tau"),
    size=lambda p, dt: 4,
    start=_start,
    causal=True,
)
