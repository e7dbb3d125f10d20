"""Coupling from another channel that has hysteresis and a lag of its own.

    y = x + sum_i g_i H_i(c),    tau dc/dt + c = (channel - reference) / scale

with H_i the play of width r_i on c: a neighbouring axis whose piezo creeps round its own loops.
"""

import math

import numpy as np
from numba import njit

from dehyst.models.blocks.kind import Kind, Param, Values
from dehyst.models.model import Floats

CODE = 17


@njit(cache=True, nogil=True)
def step(p: Floats, s: Floats, x: float, t: float, dt: float, ch: float) -> float:
    """p: [reference, scale, tau, then r / scale, g of n plays]; s: [input before, c, started,
    (n,) plays]."""
    n = s.size - 3
    c = (ch - p[0]) / p[1]
    if s[2] == 0.0:
        s[0] = s[1] = c
        s[2] = 1.0
    elif p[2] > 0.0 and dt > 0.0:
        trail = p[2] * (c - s[0]) / dt
        s[1] = c - trail + math.exp(-dt / p[2]) * (s[1] - s[0] + trail)
        s[0] = c
    else:
        s[0] = s[1] = c
    y = x
    for i in range(n):
        h = max(s[1] - p[3 + i], min(s[1] + p[3 + i], s[3 + i]))
        s[3 + i] = h
        y += p[3 + n + i] * h
    return y


@njit(cache=True, nogil=True)
def run(p: Floats, s: Floats, x: Floats, t: Floats, ch: Floats, y: Floats) -> None:
    """The whole record: y (N,) for x (N,) at times t (N,)."""
    for i in range(x.size):
        dt = t[i] - t[i - 1] if i > 0 else 0.0
        y[i] = step(p, s, x[i], t[i], dt, ch[i] if ch.size > 0 else 0.0)


def _pack(values: Values, dt: float) -> Floats:
    scale = values["scale"][0]
    head = [values["reference"][0], scale, values["tau"][0]]
    return np.concatenate([head, values["thresholds"] / scale, values["gains"]])


def _start(p: Floats, s: Floats, x: float) -> None:
    s[:] = 0.0


def _check(values: Values) -> str:
    if values["gains"].size != values["thresholds"].size:
        return "gains: as many as thresholds are needed"
    return ""


KIND = Kind(
    name="coupled_memory",
    says="coupling from another channel with hysteresis",
    places=("stage", "sensor"),
    params=(
        Param("thresholds", "thresholds", "unit", 0.0, 1e9, "of the plays", many=True),
        Param("gains_{y}", "gains", "", -1e9, 1e9, "of the plays", many=True),
        Param("tau_s", "tau", "s", 0.0, 100.0, "lag of the channel"),
        Param("scale", "scale", "unit", 1e-12, 1e12, "change of the channel that counts as 1"),
        Param("reference", "reference", "", -1e9, 1e9, "channel at rest", default=(0.0,)),
    ),
    code=CODE,
    step=step,
    run=run,
    pack=_pack,
    size=lambda p, dt: 3 + (p.size - 3) // 2,
    start=_start,
    causal=True,
    channel=True,
    check=_check,
)
