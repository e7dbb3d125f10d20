"""Clipping: the amplifier does not reach the ends of the commanded range."""

from collections.abc import Mapping, Sequence

import numpy as np

from dehyst.models.diagnosis.candidates.interface import Candidate, Parameter, Probe
from dehyst.models.diagnosis.data import Data, Floats
from dehyst.models.model import Block


class Clip(Candidate):
    """v = min(max(u, min_v), max_v)."""

    name = key = "clip"
    title = "Clipped drive"
    equation = "v = min(max(u, v_min), v_max)"
    source = "supply rails or a set limit of the amplifier"
    typical = "a few per cent of the range at one end"
    revealed_by = "moves over the full range"
    confused_with = ("asymmetry", "sensor")
    order = 2
    static = True
    place = "drive"
    mode = "drive"
    limit_side = "below"

    def __init__(self, data: Data) -> None:
        self.limit_unit = data.drive_unit
        low, high = data.u_min, data.u_min + data.span
        self._low, self._high, span = low, high, data.span
        self.parameters = (
            Parameter("min_v", data.drive_unit, low - 0.05 * span, low + 0.4 * span, False),
            Parameter("max_v", data.drive_unit, high - 0.4 * span, high + 0.05 * span, False),
        )

    def starts(self, data: Data, residual: Floats) -> list[tuple[float, ...]]:
        low, high, span = self._low, self._high, self._high - self._low
        out = [(low, high - f * span) for f in (0.01, 0.03, 0.08, 0.15)]
        out += [(low + f * span, high) for f in (0.01, 0.03, 0.05, 0.07, 0.09, 0.15)]
        out += [(low + f * span, high - f * span) for f in (0.02, 0.06)]
        return [(float(a), float(b)) for a, b in out]

    def drive(self, data: Data, v: Floats, theta: Sequence[float]) -> Floats:
        return np.clip(v, theta[0], theta[1])

    def values(self, theta: Sequence[float], amplitudes: Floats) -> dict[str, tuple[float, str]]:
        out = {}
        unit = self.parameters[0].unit
        if theta[0] > self._low:
            out["min_v"] = (float(theta[0]), unit)
        if theta[1] < self._high:
            out["max_v"] = (float(theta[1]), unit)
        return out

    def probes(self, data: Data) -> list[Probe]:
        span = self._high - self._low
        return [
            Probe(float(self._high - d * span), (self._low, float(self._high - d * span)))
            for d in np.geomspace(0.002, 0.35, 10)
        ]

    def blocks(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> tuple[Block, ...]:
        return (Block("clip", "drive", {"min_v": float(theta[0]), "max_v": float(theta[1])}),)

    def says(self, values: Mapping[str, tuple[float, str]]) -> str:
        ends = [
            f"{word} {values[k][0]:.4g} {values[k][1]}"
            for k, word in (("min_v", "below"), ("max_v", "above"))
            if k in values
        ]
        return (
            f"The drive has no effect {' and '.join(ends)}: the amplifier's limit is reached. "
            "Keep the trajectory inside, or raise the limit."
        )


def candidates(data: Data) -> list[Candidate]:
    return [Clip(data)]
