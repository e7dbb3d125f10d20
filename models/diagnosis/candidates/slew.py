"""Slew limit: the drive cannot move faster than the amplifier's current into the stack."""

from collections.abc import Mapping, Sequence

import numpy as np

from dehyst.models.diagnosis.candidates.interface import Candidate, Parameter, Probe
from dehyst.models.diagnosis.data import Data, Floats
from dehyst.models.diagnosis.kernels import slew
from dehyst.models.model import Block


class Slew(Candidate):
    """|dv/dt| <= rate."""

    name = key = "slew"
    title = "Slew limit"
    equation = "dv/dt = clip((u - v) / dt, -rate, rate)"
    source = "amplifier current limit I into capacitance C: rate = I / C"
    typical = "60 mA / 1.4 uF = 43 V/ms, often less"
    revealed_by = "large fast moves and steps"
    confused_with = ("lag", "delay")
    order = 1
    place = "drive"
    mode = "drive"
    limit_side = "below"

    def __init__(self, data: Data) -> None:
        rate = np.abs(np.diff(data.u)) / data.dt[1:]
        rate = rate[~data.starts[1:]]
        self._rates = np.sort(rate[rate > 0])
        top = float(self._rates[-1])
        self.unit = self.limit_unit = f"{data.drive_unit}/s"
        self.parameters = (Parameter("rate_v_per_s", self.unit, 1e-3 * top, 0.98 * top),)

    def starts(self, data: Data, residual: Floats) -> list[tuple[float, ...]]:
        top = float(self._rates[-1])
        quantiles = np.quantile(self._rates, (0.8, 0.9, 0.96, 0.99, 0.997))
        rates = [*quantiles, 0.3 * top, 0.1 * top, 0.03 * top]
        inside = sorted({float(r) for r in rates if 2e-3 * top < r < 0.95 * top})
        return [(r,) for r in inside]

    def drive(self, data: Data, v: Floats, theta: Sequence[float]) -> Floats:
        return slew(v, theta[0] * data.dt, data.starts)

    def probes(self, data: Data) -> list[Probe]:
        top = float(self._rates[-1])
        return [Probe(float(r), (float(r),)) for r in top * np.geomspace(0.97, 0.01, 12)]

    def blocks(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> tuple[Block, ...]:
        return (Block("slew", "drive", {"rate_v_per_s": float(theta[0])}),)

    def implausible(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> str:
        moving = np.abs(np.diff(data.u, prepend=data.u[0])) > 1e-5 * data.span
        late = np.abs(self.drive(data, data.u, theta) - data.u) > 1e-3 * data.span
        if moving.any() and float(np.mean(late[moving])) > 0.8:
            return "a limit that nearly every move exceeds"
        return ""

    def says(self, values: Mapping[str, tuple[float, str]]) -> str:
        rate, unit = values["rate_v_per_s"]
        return (
            f"The amplifier moves the drive by at most {rate:.4g} {unit}; faster commands come "
            "late. Slow the trajectory down or use an amplifier with more current."
        )


def candidates(data: Data) -> list[Candidate]:
    return [Slew(data)]
