"""A pure delay, y(t) = x(t - delay), and a lead, y(t) = x(t + tau).

Past inputs are interpolated between samples by the cubic through the four nearest samples, and at
the newest end by the parabola through the last three. Before the first sample the input equals the
first one. A lead represents a recorder that reads late, or a stage whose rate is the derivative at
a sample and not the difference from the previous one. A lead of a fraction of a sample is
x + tau dx/dt, where dx/dt is that difference. Whole samples are looked up where later samples are
known; in a loop they are not, and the lead is extrapolated in the same way.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numba import njit

from dehyst.models.model import Block
from dehyst.models.physics.address import Kernel, behind, fields, record
from dehyst.models.physics.candidate import Candidate, Parameter, Probe
from dehyst.models.physics.entry import Physics, Scales, Specimen
from dehyst.models.physics.kind import SAME, Kind, Led, Param, Shifted, Values, head_record
from dehyst.models.signals.filters import delayed
from dehyst.models.signals.joined import Data, Floats

PACKED = fields("delay")
STATE = fields("newest", "stored")  # index of the newest sample, count; followed by the ring
HEAD = 2
MOST_SAMPLES = 1_000_000


@njit(cache=True, nogil=True)
def _interpolate(ring: Floats, newest: int, back: int, n: int, t: float) -> float:
    """Return Lagrange's polynomial at t through n samples of the ring, the latest of which is
    `back` samples before the newest."""
    total, size = 0.0, ring.shape[0]
    for i in range(n):
        a = (newest - back - i) % size
        part = ring[a, 1]
        for j in range(n):
            if j != i:
                b = (newest - back - j) % size
                part *= (t - ring[b, 0]) / (ring[a, 0] - ring[b, 0])
        total += part
    return total


@Kernel
def step(
    p_at: int, n_p: int, s_at: int, n_s: int, x: float, t: float, dt: float, ch: float
) -> float:
    """Forward. The ring contains pairs of time and input."""
    p, s = record(p_at, PACKED), record(s_at, STATE)
    size = (n_s - HEAD) // 2
    ring = behind(s_at, n_s, HEAD).reshape((size, 2))
    newest = (int(s.newest) + 1) % size
    stored = min(int(s.stored) + 1, size)
    s.newest, s.stored = newest, stored
    ring[newest, 0], ring[newest, 1] = t, x
    at = t - p.delay
    if p.delay == 0.0 or stored == 1:
        return x
    oldest = (newest - stored + 1) % size
    if at <= ring[oldest, 0]:
        return ring[oldest, 1]
    low, high = 0, stored - 1  # searches the latest sample that is not after `at`
    while low < high:
        middle = (low + high) // 2
        if ring[(newest - middle) % size, 0] <= at:
            high = middle
        else:
            low = middle + 1
    first = max(low - 2, 0)
    return _interpolate(ring, newest, first, min(low + 1, stored - 1) - first + 1, at)


def _start(p: Floats, s: Floats, x: float) -> None:
    s[:] = 0.0
    head_record(s, STATE)["newest"] = -1.0


KIND = Kind(
    name="delay",
    says="a pure delay",
    places=("drive", "stage", "sensor"),
    params=(Param("delay_s", "delay", "s", 0.0, 10.0, "delay"),),
    packed=PACKED,
    state=STATE,
    step=step,
    size=lambda p, dt: HEAD + 2 * min(math.ceil(p[0] / dt) + 4, MOST_SAMPLES),
    start=_start,
    inverse=Shifted(lambda p: p[0]),
)

LEAD_PACKED = fields("tau")
LEAD_STATE = fields("x")  # previous input


@Kernel
def step_lead(
    p_at: int, n_p: int, s_at: int, n_s: int, x: float, t: float, dt: float, ch: float
) -> float:
    """Forward."""
    p, s = record(p_at, LEAD_PACKED), record(s_at, LEAD_STATE)
    y = x
    if dt > 0.0:
        y += p.tau * (x - s.x) / dt
    s.x = x
    return y


def _look_up(values: Values, x: Floats, t_s: Floats) -> tuple[Values, Floats]:
    """Return the rest of a lead, and the input (N,) from as many whole samples later; after the
    last sample the input keeps its value."""
    if x.size < 2:
        return values, x
    period = float(np.median(np.diff(t_s)))
    ahead = float(values["tau"][0]) / period
    whole = np.floor(ahead + SAME)
    if whole < 1.0:
        return values, x
    rest = max(ahead - whole, 0.0) * period
    return values | {"tau": np.array([rest])}, np.interp(t_s + whole * period, t_s, x)


def _start_lead(p: Floats, s: Floats, x: float) -> None:
    head_record(s, LEAD_STATE)["x"] = x


LEAD = Kind(
    name="lead",
    says="a lead",
    places=("drive", "stage", "sensor"),
    params=(Param("tau_s", "tau", "s", 0.0, 10.0, "time by which the output is ahead"),),
    packed=LEAD_PACKED,
    state=LEAD_STATE,
    step=step_lead,
    start=_start_lead,
    foresee=_look_up,
    inverse=Led(lambda p: (-p[0], 0.0)),
)


def lead(place: str, tau_s: float) -> Block:
    """Return the block of a lead by tau_s [s]."""
    return Block("lead", place, {"tau_s": tau_s})


OF_A_SAMPLE = 0.1
"""Uncertainty of a time in samples: the drive between two samples is unknown
(tests/benchmarks/models/proof: of 11 intervals the 4 that missed were off by up to 0.06)."""


class Delay(Candidate):
    """y(t - d); a pure delay commutes with all other effects of the drive. Typical: 0.1 to 6 ms;
    shown by content above 0.05 / d: steps, fast chirps."""

    name = key = "delay"
    title = "Dead time"
    equation = "y(t) = f(u(t - d))"
    source = "transport, sampling or communication delay"
    confused_with = ("lag", "resonance", "rate")
    order = 0
    place = "drive"
    mode = "drive"
    late = True
    limit_unit = "s"
    size_index = 0

    def __init__(self, data: Data) -> None:
        self.parameters = (
            Parameter(
                "delay_s",
                "s",
                0.02 * data.period,
                60.0 * data.period,
                within=OF_A_SAMPLE * data.path.period,
            ),
        )

    def starts(self, data: Data, residual: Floats) -> list[tuple[float, ...]]:
        return [(data.period * k,) for k in (0.2, 0.6, 1.5, 3.0, 6.0, 14.0)]

    def after(self, ahead_s: float, theta: Sequence[float]) -> tuple[float, ...]:
        (delay,) = self.parameters
        return (min(max(theta[0] + ahead_s, delay.low), delay.high),)

    def drive(self, data: Data, v: Floats, theta: Sequence[float]) -> Floats:
        return delayed(v, theta[0] / data.dt, data.starts)

    def probes(self, data: Data) -> list[Probe]:
        return [Probe(float(d), (float(d),)) for d in data.period * np.geomspace(0.003, 30, 13)]

    def blocks(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> tuple[Block, ...]:
        return (Block("delay", self.place, {"delay_s": float(theta[0])}),)

    def describe(self, values: Mapping[str, tuple[float, str]]) -> str:
        d = values["delay_s"][0]
        return (
            f"The reading is delayed by {1e3 * d:.3g} ms at every speed: look for buffering, "
            "conversion time or communication with the amplifier."
        )


def _variants(s: Scales) -> list[Block]:
    times = [k * s.period_s for k in (1.0, 0.2, 0.5, 2.0, 5.0, 20.0)]
    leads = (lead(place, 0.5 * s.period_s) for place in LEAD.places)
    return [*(Block("delay", "drive", {"delay_s": d}) for d in times), *leads]


PHYSICS = Physics(
    name="delay",
    kinds=(KIND, LEAD),
    candidates=lambda data: [Delay(data)],
    specimens={"delay": Specimen(_variants)},
    distinguished_by={
        "lag": "a chirp from 1 Hz to a few hundred hertz at a small stroke",
        "resonance": "steps, with the ringing sampled well above its frequency",
    },
)
