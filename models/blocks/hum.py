"""Fixed lines: y = x + sum_i A_i sin(2 pi f_i t + phase_i), t the recording's own time.

The phase belongs to one recording: forward only, never compensated.
"""

import math

import numpy as np
from numba import njit

from dehyst.models.blocks.kind import Kind, Param, Values, no_state, settled_nothing
from dehyst.models.model import Floats

CODE = 10


@njit(cache=True, nogil=True)
def step(p: Floats, s: Floats, x: float, t: float, dt: float, ch: float) -> float:
    """p: triples (frequency, amplitude, phase); no state."""
    y = x
    for i in range(0, p.size, 3):
        y += p[i + 1] * math.sin(2.0 * math.pi * p[i] * t + p[i + 2])
    return y


@njit(cache=True, nogil=True)
def run(p: Floats, s: Floats, x: Floats, t: Floats, ch: Floats, y: Floats) -> None:
    """The whole record: y (N,) for x (N,) at times t (N,)."""
    for i in range(x.size):
        dt = t[i] - t[i - 1] if i > 0 else 0.0
        y[i] = step(p, s, x[i], t[i], dt, ch[i] if ch.size > 0 else 0.0)


def _pack(values: Values, dt: float) -> Floats:
    return np.stack([values[n] for n in ("frequency", "amplitude", "phase")], axis=1).ravel()


def _check(values: Values) -> str:
    sizes = {values[n].size for n in ("frequency", "amplitude", "phase")}
    return "" if len(sizes) == 1 else "frequency_hz, amplitude and phase_rad: lists of one length"


KIND = Kind(
    name="hum",
    says="hum at fixed frequencies",
    places=("stage", "sensor"),
    params=(
        Param("frequency_hz", "frequency", "Hz", 0.0, 1e6, "frequencies", many=True),
        Param("amplitude_{y}", "amplitude", "", -1e9, 1e9, "amplitudes", many=True),
        Param("phase_rad", "phase", "rad", -1e3, 1e3, "phases", many=True),
    ),
    code=CODE,
    step=step,
    run=run,
    pack=_pack,
    size=no_state,
    start=settled_nothing,
    causal=False,
    invertible=False,
    check=_check,
)
