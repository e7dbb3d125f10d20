"""Loops that change with the rate: plays whose thresholds increase with the rate of the drive.

    y = sum_i g_i (D_i - H_i) + k_i dv/dt H_i,    D_i the play of width r_i / scale + d |dv/dt|^p

v = (u - center) / scale, H_i its plays of width r_i / scale; dv/dt and |dv/dt| are low-passed. The
first sum adds the rate-dependent plays of Al Janaideh, Rakheja and Su (Mechatronics 19, 2009, 656),
relative to the static plays of the model in use; the second is the linear rate dependence of Qin et
al. (Eq. 5). The block reads the drive that reaches the hysteresis and adds to its displacement.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numba import njit

from dehyst.models.model import Block
from dehyst.models.physics.address import Kernel, behind, fields, record
from dehyst.models.physics.candidate import Candidate, Context, Parameter
from dehyst.models.physics.entry import Physics, Scales, Specimen
from dehyst.models.physics.kind import Kind, Param, Subtracted, Values, head_record
from dehyst.models.signals.error_size import rms
from dehyst.models.signals.joined import Bools, Data, Floats

PACKED = fields("center", "scale", "power", "dilation", "tau")  # then r / scale, g, k, n of each
STATE = fields("before", "rate", "speed")  # followed by n static plays and n that dilate
HEAD = ("power", "dilation", "smoothing")
EACH = ("weights", "slopes")  # of n operators
HEAD_P, HEAD_S = 5, 3


@njit(cache=True, nogil=True)
def play_operator(h: float, v: float, r: float) -> float:
    """Return the output of a play of half width r at the drive v; h: its previous output."""
    return max(v - r, min(v + r, h))


@Kernel
def step(
    p_at: int, n_p: int, s_at: int, n_s: int, x: float, t: float, dt: float, ch: float
) -> float:
    """Forward; x: drive."""
    p, rows = record(p_at, PACKED), behind(p_at, n_p, HEAD_P)
    s, h = record(s_at, STATE), behind(s_at, n_s, HEAD_S)
    n = h.size // 2
    v = (x - p.center) / p.scale
    rate = (v - s.before) / dt if dt > 0.0 else 0.0
    s.before = v
    if dt > 0.0:
        keep = math.exp(-dt / p.tau)
        s.rate = keep * s.rate + (1.0 - keep) * rate
        s.speed = keep * s.speed + (1.0 - keep) * abs(rate)
    more = p.dilation * s.speed**p.power
    y = 0.0
    for i in range(n):
        h[i] = play_operator(h[i], v, rows[i])
        h[n + i] = play_operator(h[n + i], v, rows[i] + more)
        y += rows[n + i] * (h[n + i] - h[i]) + rows[2 * n + i] * s.rate * h[i]
    return y


def _pack(values: Values, dt: float) -> Floats:
    r, scale = values["thresholds"], values["scale"][0]
    head = [values["center"][0], scale, *(values[k][0] for k in HEAD)]
    parts = [np.broadcast_to(values[k], r.shape) for k in EACH]
    return np.concatenate([head, r / scale, *parts])


def _start(p: Floats, s: Floats, x: float) -> None:
    s[:] = 0.0
    packed = head_record(p, PACKED)
    head_record(s, STATE)["before"] = (x - packed["center"]) / packed["scale"]


def _check(values: Values) -> str:
    for k in EACH:
        if values[k].size not in (1, values["thresholds"].size):
            return f"{k}: as many as thresholds are needed"
    return ""


KIND = Kind(
    name="rate",
    says="loops that change with the rate",
    places=("stage",),
    params=(
        Param("thresholds_{u}", "thresholds", "", 0.0, 1e9, "thresholds", many=True),
        Param("weights", "weights", "", -1e9, 1e9, "of D - H", many=True),
        Param("slopes", "slopes", "", -1e9, 1e9, "of dv/dt H", many=True),
        Param("dilation", "dilation", "", 0.0, 1e9, "of the scaled thresholds at a rate of 1/s"),
        Param("power", "power", "", 0.0, 3.0, "of the rate"),
        Param("smoothing_s", "smoothing", "s", 1e-9, 100.0, "time constant of the rate"),
        Param("scale_{u}", "scale", "", 1e-9, 1e9, "drive that counts as 1"),
        Param("center_{u}", "center", "", -1e9, 1e9, "drive that counts as 0", default=(0.0,)),
    ),
    packed=PACKED,
    state=STATE,
    step=step,
    pack=_pack,
    size=lambda p, dt: HEAD_S + 2 * ((p.size - HEAD_P) // 3),
    start=_start,
    inverse=Subtracted(),
    check=_check,
)

FRACTIONS = np.array([0.01, 0.05, 0.1, 0.15, 0.2])  # thresholds, of the drive's range
SMOOTHING = 2.0  # sampling periods
SLOPED = 0.3  # a widening part smaller than this fraction of the dv/dt H part is not checked
TOGETHER = 0.65
"""Smallest sum of the weights, relative to the sum of their magnitudes: loops that widen with the
rate do so at every threshold (tests/benchmarks/models/proof: 0.79 to 1.0; friction that decreases
with the speed: -0.6 to 0.5)."""


class Rate(Candidate):
    """sum_i g_i (D_i - H_i) + k_i dv/dt H_i. Typical: loops some 10 % wider at 10 Hz than at 0.1
    Hz; shown by the same stroke at several frequencies, and several strokes at one."""

    name = key = "rate"
    title = "Loops that change with the rate"
    equation = "y + sum_i g_i (D_i - H_i) + k_i dv/dt H_i, D_i of threshold r_i + d |dv/dt|^p"
    source = "thresholds dilating with the rate (Al Janaideh 2009); Qin et al., Eq. 5"
    confused_with = ("lag", "delay", "friction")
    order = 65
    static = True
    minima = 2
    rival_if_implausible = False
    widest_spread = 0.3  # true cases have 0.03 (tests/benchmarks/models/proof)

    parameters = (Parameter("power", "1", 0.2, 2.0), Parameter("dilation", "1", 0.003, 1.0))

    def __init__(self, data: Data) -> None:
        self._usual = rms(_rates(data))

    def starts(self, data: Data, residual: Floats) -> list[tuple[float, ...]]:
        return [(p, d) for p in (0.5, 1.0) for d in (0.02, 0.1, 0.4)]

    def columns(self, data: Data, context: Context, theta: Sequence[float]) -> Floats:
        v = (context.v - data.u_min) * (2.0 / data.span)
        tau = SMOOTHING * data.period
        dilation = self._dilation(theta)
        return _columns(v, data.dt, data.starts, 2.0 * FRACTIONS, theta[0], dilation, tau)

    def _dilation(self, theta: Sequence[float]) -> float:
        """Return the dilation of the scaled thresholds at a rate of 1/s. theta contains that at the
        rms rate of the recordings, which they determine."""
        return float(theta[1] / self._usual ** theta[0])

    def values(self, theta: Sequence[float], amplitudes: Floats) -> dict[str, tuple[float, str]]:
        return {"power": (float(theta[0]), "1")}  # dilation and weights are interchangeable

    def blocks(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> tuple[Block, ...]:
        n = FRACTIONS.size
        params: dict[str, float | tuple[float, ...]] = {
            f"thresholds_{data.drive_unit}": tuple(float(r) for r in FRACTIONS * data.span),
            "weights": tuple(float(a) for a in amplitudes[:n]),
            "slopes": tuple(float(a) for a in amplitudes[n:]),
            "dilation": self._dilation(theta),
            "power": float(theta[0]),
            "smoothing_s": SMOOTHING * data.period,
            f"scale_{data.drive_unit}": 0.5 * data.span,
            f"center_{data.drive_unit}": data.u_min,
        }
        return (Block("rate", "stage", params),)

    def implausible(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> str:
        n = FRACTIONS.size
        x = self.columns(data, Context(data.u, data.y), theta)[data.rows]
        wider, sloped = (np.std(x[:, k] @ amplitudes[k]) for k in (slice(0, n), slice(n, None)))
        weights = amplitudes[:n]
        if wider > SLOPED * sloped and weights.sum() < TOGETHER * np.abs(weights).sum():
            return "some loops would grow wider with the rate, and others narrower"
        return ""

    def describe(self, values: Mapping[str, tuple[float, str]]) -> str:
        return (
            "The loops change with the rate in a way that no lag of the amplifier or the sensor "
            "explains: identify with rate-dependent weights over the band that you use."
        )


def _rates(data: Data) -> Floats:
    """Return the (N,) rate of the drive, in half ranges per second; 0 at a recording's start."""
    step = np.diff(data.u, prepend=data.u[0]) * (2.0 / data.span)
    return np.divide(step, data.dt, out=np.zeros(data.n), where=~data.starts.astype(bool))


@njit(cache=True, nogil=True)
def _columns(
    v: Floats, dt: Floats, starts: Bools, r: Floats, power: float, dilation: float, tau: float
) -> Floats:
    n = r.size
    out = np.empty((v.size, 2 * n))
    h, wider = np.zeros(n), np.zeros(n)
    slope = speed = 0.0
    for t in range(v.size):
        if starts[t]:
            h[:] = 0.0
            wider[:] = 0.0
            slope = speed = 0.0
        else:
            keep = np.exp(-dt[t] / tau)
            rate = (v[t] - v[t - 1]) / dt[t]
            slope = keep * slope + (1.0 - keep) * rate
            speed = keep * speed + (1.0 - keep) * abs(rate)
        more = dilation * speed**power
        for i in range(n):
            h[i] = play_operator(h[i], v[t], r[i])
            wider[i] = play_operator(wider[i], v[t], r[i] + more)
            out[t, i] = wider[i] - h[i]
            out[t, n + i] = slope * h[i]
    return out


def _variants(s: Scales) -> list[Block]:
    """Return blocks whose thresholds widen by 0.05 of the half range at half the highest rate."""
    u, half = s.drive_unit, 0.5 * s.span
    full = 0.5 * s.rate_max / half
    out = []
    for power in (0.5, 1.0):
        params: dict[str, float | tuple[float, ...]] = {
            f"thresholds_{u}": (0.05 * half, 0.2 * half),
            "slopes": (0.0, 0.0),
            "weights": (0.1 * s.stroke, 0.1 * s.stroke),
            "dilation": 0.05 / full**power,
            "power": power,
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
    candidates=lambda data: [Rate(data)],
    specimens={"rate": Specimen(_variants)},
    distinguished_by={
        "lag": SINES,
        "delay": SINES,
        "friction": "small reversals at several speeds",
    },
)
