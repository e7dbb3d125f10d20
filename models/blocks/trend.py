"""Drift without a channel: y = x + rate t + amount (1 - exp(-t / tau)), t since the first sample.

It describes one recording and foretells nothing: forward only, never compensated.
"""

import math

from numba import njit

from dehyst.models.blocks.kind import Kind, Param, pack_in_order
from dehyst.models.model import Floats

CODE = 8


@njit(cache=True, nogil=True)
def step(p: Floats, s: Floats, x: float, t: float, dt: float, ch: float) -> float:
    """p: [rate, amount, tau]; s: [time since the first sample]."""
    s[0] += dt
    return x + p[0] * s[0] + p[1] * (1.0 - math.exp(-s[0] / p[2]))


@njit(cache=True, nogil=True)
def run(p: Floats, s: Floats, x: Floats, t: Floats, ch: Floats, y: Floats) -> None:
    """The whole record: y (N,) for x (N,) at times t (N,)."""
    for i in range(x.size):
        dt = t[i] - t[i - 1] if i > 0 else 0.0
        y[i] = step(p, s, x[i], t[i], dt, ch[i] if ch.size > 0 else 0.0)


def _start(p: Floats, s: Floats, x: float) -> None:
    s[0] = 0.0


KIND = Kind(
    name="trend",
    says="a slow trend of unknown cause",
    places=("stage", "sensor"),
    params=(
        Param("rate_{y}_per_s", "rate", "/s", -1e9, 1e9, "steady rate", default=(0.0,)),
        Param("amount_{y}", "amount", "", -1e9, 1e9, "size of the settling", default=(0.0,)),
        Param("tau_s", "tau", "s", 1e-6, 1e9, "time constant of the settling", default=(1.0,)),
    ),
    code=CODE,
    step=step,
    run=run,
    pack=pack_in_order("rate", "amount", "tau"),
    size=lambda p, dt: 1,
    start=_start,
    causal=False,
    invertible=False,
)
