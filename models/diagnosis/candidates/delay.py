"""Delay: the reading comes late by a fixed time."""

from collections.abc import Mapping, Sequence

import numpy as np

from dehyst.models.diagnosis.candidates.interface import Candidate, Parameter, Probe
from dehyst.models.diagnosis.data import Data, Floats
from dehyst.models.diagnosis.kernels import delayed
from dehyst.models.model import Block


class Delay(Candidate):
    """y(t - d); a pure delay commutes with everything else that the drive causes."""

    name = key = "delay"
    title = "Dead time"
    equation = "y(t) = f(u(t - d))"
    source = "transport, sampling or communication delay"
    typical = "0.1 to 6 ms"
    revealed_by = "content above 0.05 / d: steps, fast chirps"
    confused_with = ("lag", "resonance", "rate")
    order = 0
    place = "drive"
    mode = "drive"
    limit_unit = "s"
    size_index = 0

    def __init__(self, data: Data) -> None:
        self.parameters = (
            Parameter("delay_s", "s", 0.02 * data.period, 60.0 * data.period, log=True),
        )

    def starts(self, data: Data, residual: Floats) -> list[tuple[float, ...]]:
        return [(data.period * k,) for k in (0.2, 0.6, 1.5, 3.0, 6.0, 14.0)]

    def drive(self, data: Data, v: Floats, theta: Sequence[float]) -> Floats:
        return delayed(v, theta[0] / data.dt, data.starts)

    def probes(self, data: Data) -> list[Probe]:
        return [Probe(float(d), (float(d),)) for d in data.period * np.geomspace(0.003, 30, 13)]

    def blocks(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> tuple[Block, ...]:
        return (Block("delay", self.place, {"delay_s": float(theta[0])}),)

    def says(self, values: Mapping[str, tuple[float, str]]) -> str:
        d = values["delay_s"][0]
        return (
            f"The reading follows the drive {1e3 * d:.3g} ms late, by the same time at every "
            "speed: look for a buffer, a conversion time or the communication with the amplifier."
        )


def candidates(data: Data) -> list[Candidate]:
    return [Delay(data)]
