"""Loops that change with the rate: plays weighted by a power of the drive's rate.

    y = sum_i g_i q(t) (v - H_i) + k_i dv/dt H_i,    q = |dv/dt|^p behind a low-pass,

v = (u - center) / scale, H_i its plays of width r_i / scale. The first sum is what thresholds
that dilate with the rate do to first order, the second the linear rate dependence of Qin et al.
(Eq. 5). It reads the drive as it reaches the hysteresis and adds to its displacement.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numba import njit

from dehyst.models.model import Block
from dehyst.models.physics.address import Kernel, behind, fields, record
from dehyst.models.physics.candidate import Candidate, Context, Parameter
from dehyst.models.physics.entry import Physics, Scales, Specimen
from dehyst.models.physics.kind import Kind, Param, Subtracted, Values, named
from dehyst.models.signals.joined import Bools, Data, Floats

PACKED = fields("center", "scale", "power", "tau")  # behind: r / scale, g, k of n operators
STATE = fields("before", "smooth")  # v before, smooth rate; behind: (n,) plays
HEAD_P, HEAD_S = 4, 2


@Kernel
def step(
    p_at: int, n_p: int, s_at: int, n_s: int, x: float, t: float, dt: float, ch: float
) -> float:
    """Forward; x: drive."""
    p, rows = record(p_at, PACKED), behind(p_at, n_p, HEAD_P)
    s, h = record(s_at, STATE), behind(s_at, n_s, HEAD_S)
    n = h.size
    v = (x - p.center) / p.scale
    rate = (v - s.before) / dt if dt > 0.0 else 0.0
    s.before = v
    if dt > 0.0:
        keep = math.exp(-dt / p.tau)
        s.smooth = keep * s.smooth + (1.0 - keep) * rate
    strength = abs(s.smooth) ** p.power
    y = 0.0
    for i in range(n):
        h[i] = max(v - rows[i], min(v + rows[i], h[i]))
        y += rows[n + i] * strength * (v - h[i]) + rows[2 * n + i] * s.smooth * h[i]
    return y


def _pack(values: Values, dt: float) -> Floats:
    r, scale = values["thresholds"], values["scale"][0]
    head = [values["center"][0], scale, values["power"][0], values["smoothing"][0]]
    parts = [np.broadcast_to(values[k], r.shape) for k in ("widening", "slopes")]
    return np.concatenate([head, r / scale, *parts])


def _start(p: Floats, s: Floats, x: float) -> None:
    s[:] = 0.0
    packed = named(p, PACKED)
    named(s, STATE)["before"] = (x - packed["center"]) / packed["scale"]


def _check(values: Values) -> str:
    for k in ("widening", "slopes"):
        if values[k].size not in (1, values["thresholds"].size):
            return f"{k}: as many as thresholds are needed"
    return ""


KIND = Kind(
    name="rate",
    says="loops that change with the rate",
    places=("stage",),
    params=(
        Param("thresholds_{u}", "thresholds", "", 0.0, 1e9, "thresholds", many=True),
        Param("widening", "widening", "", -1e9, 1e9, "of q (v - H)", many=True),
        Param("slopes", "slopes", "", -1e9, 1e9, "of dv/dt H", many=True),
        Param("power", "power", "", 0.0, 3.0, "of the rate"),
        Param("smoothing_s", "smoothing", "s", 1e-9, 100.0, "time constant of the rate"),
        Param("scale_{u}", "scale", "", 1e-9, 1e9, "drive that counts as 1"),
        Param("center_{u}", "center", "", -1e9, 1e9, "drive that counts as 0", default=(0.0,)),
    ),
    packed=PACKED,
    state=STATE,
    step=step,
    pack=_pack,
    size=lambda p, dt: HEAD_S + (p.size - HEAD_P) // 3,
    start=_start,
    inverse=Subtracted(),
    check=_check,
)

FRACTIONS = np.array([0.01, 0.03, 0.08, 0.2])  # thresholds, of the drive's range
SMOOTHING = 2.0  # sampling periods


class Rate(Candidate):
    """sum_i g_i |dv/dt|^p (v - H_i) + k_i dv/dt H_i."""

    name = key = "rate"
    title = "Loops that change with the rate"
    equation = "y + sum_i g_i |dv/dt|^p (v - H_i) + k_i dv/dt H_i"
    source = "thresholds dilating with the rate (Al Janaideh 2009); Qin et al., Eq. 5"
    typical = "loops some 10 % wider at 10 Hz than at 0.1 Hz"
    revealed_by = "the same stroke at several frequencies, and several strokes at one"
    confused_with = ("lag", "delay", "friction")
    order = 65
    static = True

    parameters = (Parameter("power", "1", 0.2, 2.0),)

    def starts(self, data: Data, residual: Floats) -> list[tuple[float, ...]]:
        return [(0.5,), (1.0,)]

    def columns(self, data: Data, context: Context, theta: Sequence[float]) -> Floats:
        v = (context.v - data.u_min) * (2.0 / data.span)
        tau = SMOOTHING * data.period
        return _columns(v, data.dt, data.starts, 2.0 * FRACTIONS, theta[0], tau)

    def values(self, theta: Sequence[float], amplitudes: Floats) -> dict[str, tuple[float, str]]:
        return {"power": (float(theta[0]), "1")}

    def blocks(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> tuple[Block, ...]:
        n = FRACTIONS.size
        params: dict[str, float | tuple[float, ...]] = {
            f"thresholds_{data.drive_unit}": tuple(float(r) for r in FRACTIONS * data.span),
            "widening": tuple(float(a) for a in amplitudes[:n]),
            "slopes": tuple(float(a) for a in amplitudes[n:]),
            "power": float(theta[0]),
            "smoothing_s": SMOOTHING * data.period,
            f"scale_{data.drive_unit}": 0.5 * data.span,
            f"center_{data.drive_unit}": data.u_min,
        }
        return (Block("rate", "stage", params),)

    def says(self, values: Mapping[str, tuple[float, str]]) -> str:
        return (
            "The loops change with the rate in a way that no lag of the amplifier or the sensor "
            "makes: identify with rate-dependent weights over the band that you use."
        )


@njit(cache=True, nogil=True)
def _columns(v: Floats, dt: Floats, starts: Bools, r: Floats, power: float, tau: float) -> Floats:
    n = r.size
    out = np.empty((v.size, 2 * n))
    h = np.zeros(n)
    smooth = 0.0
    for t in range(v.size):
        if starts[t]:
            h[:] = 0.0
            smooth = 0.0
        else:
            keep = np.exp(-dt[t] / tau)
            smooth = keep * smooth + (1.0 - keep) * (v[t] - v[t - 1]) / dt[t]
        strength = abs(smooth) ** power
        for i in range(n):
            h[i] = max(v[t] - r[i], min(v[t] + r[i], h[i]))
            out[t, i] = strength * (v[t] - h[i])
            out[t, n + i] = smooth * h[i]
    return out


def _variants(s: Scales) -> list[Block]:
    """Thresholds that dilate by a tenth at half the steepest rate."""
    u, half = s.drive_unit, 0.5 * s.span
    full = 0.5 * s.rate_max / half
    out = []
    for power in (0.5, 1.0):
        widening = 0.01 * s.stroke / full**power
        params: dict[str, float | tuple[float, ...]] = {
            f"thresholds_{u}": (0.05 * half, 0.2 * half),
            "slopes": (0.0, 0.0),
            "power": power,
            "widening": (widening, widening),
            "smoothing_s": 5 * s.period_s,
            f"scale_{u}": half,
            f"center_{u}": s.drive_min,
        }
        out.append(Block("rate", "stage", params))
    return out


SINES = "sines of one frequency at several strokes, then several frequencies"
PHYSICS = Physics(
    name="rate",
    kinds=(KIND,),
    candidates=lambda data: [Rate()],
    specimens={"rate": Specimen(_variants)},
    told_from={"lag": SINES, "delay": SINES, "friction": "small reversals at several speeds"},
)
