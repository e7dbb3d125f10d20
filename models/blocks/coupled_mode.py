"""Coupling from another channel through a mode of the stage.

    y = x + gain q + quadrature q' / w,  q'' + 2 z w q' + w^2 q = w^2 (channel - reference)

The quadrature is what a delay of the channel, or damping that is not proportional, adds to a mode.
Exact for a channel that runs in straight lines between the samples, for any damping z.
"""

import numpy as np
from numba import njit

from dehyst.models.blocks import resonance
from dehyst.models.blocks.kind import Kind, Param, Values
from dehyst.models.model import Floats

CODE = 20


@njit(cache=True, nogil=True)
def step(p: Floats, s: Floats, x: float, t: float, dt: float, ch: float) -> float:
    """p: [frequency, damping, 1, gain, reference, quadrature / w]; s: state of the mode (8),
    started."""
    c = ch - p[4]
    if s[8] == 0.0:
        s[0] = s[2] = c
        s[8] = 1.0
    return x + p[3] * resonance.step(p[:3], s[:8], c, t, dt, 0.0) + p[5] * s[1]


@njit(cache=True, nogil=True)
def run(p: Floats, s: Floats, x: Floats, t: Floats, ch: Floats, y: Floats) -> None:
    """The whole record: y (N,) for x (N,) at times t (N,)."""
    for i in range(x.size):
        dt = t[i] - t[i - 1] if i > 0 else 0.0
        y[i] = step(p, s, x[i], t[i], dt, ch[i] if ch.size > 0 else 0.0)


def _pack(values: Values, dt: float) -> Floats:
    mode = [values["frequency"][0], values["damping"][0], 1.0]
    per_speed = values["quadrature"][0] / (2.0 * np.pi * mode[0])
    return np.array([*mode, values["gain"][0], values["reference"][0], per_speed])


def _start(p: Floats, s: Floats, x: float) -> None:
    s[:] = 0.0


KIND = Kind(
    name="coupled_mode",
    says="coupling from another channel through a mode",
    places=("stage", "sensor"),
    params=(
        Param("frequency_hz", "frequency", "Hz", 1e-3, 1e6, "natural frequency"),
        Param("damping", "damping", "", 1e-6, 10.0, "damping ratio"),
        Param("gain_{y}_per_unit", "gain", "/unit", -1e6, 1e6, "gain per unit of the channel"),
        Param(
            "quadrature_{y}_per_unit",
            "quadrature",
            "/unit",
            -1e6,
            1e6,
            "gain per unit of the channel, of the mode's velocity over w",
            default=(0.0,),
        ),
        Param("reference", "reference", "", -1e9, 1e9, "channel at rest", default=(0.0,)),
    ),
    code=CODE,
    step=step,
    run=run,
    pack=_pack,
    size=lambda p, dt: 9,
    start=_start,
    causal=True,
    channel=True,
)
