"""Slew limit: y follows x with |dy/dt| <= rate (the amplifier's current limit)."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from dehyst.models.model import Block
from dehyst.models.physics.address import Kernel, fields, record
from dehyst.models.physics.candidate import Candidate, Parameter, Probe
from dehyst.models.physics.entry import Physics, Scales, Specimen
from dehyst.models.physics.kind import Kind, Limited, Param, head_record
from dehyst.models.signals.filters import slew
from dehyst.models.signals.joined import Bools, Data, Floats
from dehyst.models.units import spell_unit

PACKED = fields("rate")
STATE = fields("y")


@Kernel
def step(
    p_at: int, n_p: int, s_at: int, n_s: int, x: float, t: float, dt: float, ch: float
) -> float:
    """Forward."""
    s = record(s_at, STATE)
    most = record(p_at, PACKED).rate * dt
    s.y += min(max(x - s.y, -most), most)
    return s.y


def _start(p: Floats, s: Floats, x: float) -> None:
    head_record(s, STATE)["y"] = x


KIND = Kind(
    name="slew",
    says="a slew limit of the drive",
    places=("drive",),
    params=(Param("rate_{u}_per_s", "rate", "/s", 1e-9, 1e12, "largest rate"),),
    packed=PACKED,
    state=STATE,
    step=step,
    start=_start,
    inverse=Limited(lambda p: (-np.inf, np.inf, p[0])),
)


SURE = 0.05  # relative uncertainty of the rate: a flank ends between two samples
ABRUPT = 0.3  # a step's rate two samples before its highest rate is below this part of it
BEGINS = 1.0
"""A step begins between two samples, but in the model at the first of them. The flank is thus half
a sample too long on average, which lowers the rate by 0.75 samples over the flank's length (least
squares fit of a line that begins early), and by up to twice that
(tests/benchmarks/models/proof: the rate was found 1.4 to 12 % too low)."""


class Slew(Candidate):
    """|dv/dt| <= rate. Typical: 60 mA / 1.4 uF = 43 V/ms, often less; shown by large fast moves and
    steps."""

    name = key = "slew"
    title = "Slew limit"
    equation = "dv/dt = clip((u - v) / dt, -rate, rate)"
    source = "amplifier current limit I into capacitance C: rate = I / C"
    confused_with = ("lag", "delay")
    order = 1
    place = "drive"
    mode = "drive"
    late = True
    limit_side = "below"

    def __init__(self, data: Data) -> None:
        rate = np.abs(np.diff(data.u)) / data.dt[1:]
        rate = rate[~data.starts[1:]]
        self._rates = np.sort(rate[rate > 0])
        top = float(self._rates[-1])
        self.unit = self.limit_unit = f"{data.drive_unit}/s"
        self.parameters = (Parameter("rate_v_per_s", self.unit, 1e-3 * top, 0.98 * top, sure=SURE),)
        self._period = data.period
        self._flanks = _flanks(data)

    def params_at(self, theta: Sequence[float]) -> tuple[Parameter, ...]:
        """Return the rate with an uncertainty that includes the unknown start of steps."""
        sizes, rates, abrupt = self._flanks
        late = rates > theta[0]
        whole = float(np.sum(sizes[late] ** 3))
        steps = float(np.sum(sizes[late & abrupt] ** 2)) / whole if whole > 0 else 0.0
        begins = BEGINS * self._period * theta[0] * steps
        return (replace(self.parameters[0], sure=float(np.hypot(SURE, begins))),)

    def starts(self, data: Data, residual: Floats) -> list[tuple[float, ...]]:
        top = float(self._rates[-1])
        quantiles = np.quantile(self._rates, (0.8, 0.9, 0.96, 0.99, 0.997))
        rates = [*quantiles, *(top * np.geomspace(0.03, 0.8, 8))]
        # inside the parameter's range, away from its ends
        inside = sorted({float(r) for r in rates if 2e-3 * top < r < 0.95 * top})
        return [(r,) for r in inside]

    def drive(self, data: Data, v: Floats, theta: Sequence[float]) -> Floats:
        return slew(v, theta[0] * data.dt, data.starts)

    def probes(self, data: Data) -> list[Probe]:
        top = float(self._rates[-1])
        return [Probe(float(r), (float(r),)) for r in top * np.geomspace(0.97, 0.01, 12)]

    def blocks(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> tuple[Block, ...]:
        return (Block("slew", "drive", {f"rate_{data.drive_unit}_per_s": float(theta[0])}),)

    def implausible(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> str:
        moving = np.abs(np.diff(data.u, prepend=data.u[0])) > 1e-5 * data.span
        late = np.abs(self.drive(data, data.u, theta) - data.u) > 1e-3 * data.span
        if moving.any() and float(np.mean(late[moving])) > 0.8:
            return "a limit that nearly every move exceeds"
        return ""

    def describe(self, values: Mapping[str, tuple[float, str]]) -> str:
        rate, unit = values["rate_v_per_s"]
        return (
            f"The amplifier slews at no more than {rate:.4g} {spell_unit(unit)}; faster commands "
            "are delayed. Slow the trajectory down or use an amplifier with more current."
        )


def _flanks(data: Data) -> tuple[Floats, Floats, Bools]:
    """Return the flanks between turns of the drive: size, highest rate, whether each begins with a
    step."""
    du = np.diff(data.u)
    du[data.starts[1:]] = 0.0
    way = np.sign(du)
    first = np.flatnonzero(np.diff(way, prepend=0.0) != 0)
    if not first.size:
        return np.zeros(0), np.zeros(0), np.zeros(0, dtype=bool)
    rate = np.abs(du) / data.dt[1:]
    sizes = np.abs(np.add.reduceat(du, first))
    rates = np.maximum.reduceat(rate, first)
    own = np.cumsum(np.diff(way, prepend=0.0) != 0) - 1
    steep = np.flatnonzero((own >= 0) & (rate >= rates[np.maximum(own, 0)]))
    before = np.where(steep >= 2, rate[np.maximum(steep - 2, 0)], 0.0)
    abrupt = np.zeros(first.size, dtype=bool)
    abrupt[own[steep]] = before < ABRUPT * rate[steep]
    return sizes, rates, abrupt


def _variants(s: Scales) -> list[Block]:
    key = f"rate_{s.drive_unit}_per_s"
    return [Block("slew", "drive", {key: k * s.rate_max}) for k in (0.4, 0.1, 0.2, 0.7, 0.9)]


PHYSICS = Physics(
    name="slew",
    kinds=(KIND,),
    candidates=lambda data: [Slew(data)],
    specimens={"slew": Specimen(_variants)},
    distinguished_by={"delay": "the same fast chirp at a large and at a small stroke"},
)
