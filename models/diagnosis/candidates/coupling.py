"""Coupling: another recorded channel (a neighbouring axis, a force) moves the reading."""

import re
from collections.abc import Mapping, Sequence

import numpy as np

from dehyst.models.diagnosis.candidates.interface import Candidate, Context, Parameter, Probe, small
from dehyst.models.diagnosis.data import Data, Floats
from dehyst.models.diagnosis.kernels import lowpass, plays
from dehyst.models.model import Block

FRACTIONS = np.array([0.0, 0.03, 0.1, 0.2, 0.35])  # plays, of the channel's range
# readings and targets are effects; the temperature has a file of its own
NOT_A_CAUSE = re.compile(r"(temp|target|t_|y\d*_)")


class Coupling(Candidate):
    """y + g c(t) for a channel c."""

    name = "coupling"
    equation = "y(t) = f(u) + g c(t)"
    source = "parasitic motion of a neighbouring axis, or a load"
    typical = "1 to 5 % of the other axis"
    revealed_by = "the other channel moving while the own drive rests"
    confused_with = ("drift",)
    order = 60
    driven = False

    def __init__(self, channel: str, reference: float, unit: str) -> None:
        self.channel = channel
        self.key = f"coupling-{channel}"
        self.title = f"Coupling from {channel}"
        self.reference = reference
        self.unit = channel.rsplit("_", 1)[-1]
        self.limit_unit = f"{unit}/{self.unit}"

    def columns(self, data: Data, context: Context, theta: Sequence[float]) -> Floats:
        return (data.channels[self.channel] - self.reference)[:, None]

    def values(self, theta: Sequence[float], amplitudes: Floats) -> dict[str, tuple[float, str]]:
        return {"gain_um_per_unit": (float(amplitudes[0]), self.limit_unit)}

    def probes(self, data: Data) -> list[Probe]:
        return [Probe(1.0, (), (1.0,))]

    def blocks(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> tuple[Block, ...]:
        params: dict[str, float | tuple[float, ...]] = {
            f"gain_{data.unit}_per_unit": float(amplitudes[0]),
            "reference": self.reference,
        }
        return (Block("coupling", "stage", params, self.channel),)

    def says(self, values: Mapping[str, tuple[float, str]]) -> str:
        gain = small(values["gain_um_per_unit"])
        return (
            f"The channel {self.channel} moves this reading by {gain}: the axes are not decoupled."
        )


class CoupledMemory(Coupling):
    """The same where the other axis has a lag and hysteresis of its own: plays on its drive."""

    equation = "y(t) = f(u) + sum_i g_i H_i(c), c behind a lag"
    order = 61

    def __init__(self, data: Data, channel: str, reference: float) -> None:
        super().__init__(channel, reference, data.unit)
        self.key = f"coupling2-{channel}"
        self.refines = f"coupling-{channel}"
        self.scale = float(np.ptp(data.channels[channel]))
        self.parameters = (Parameter("tau_s", "s", 0.1 * data.period, 300 * data.period),)

    def refined(self, theta: Sequence[float]) -> tuple[float, ...]:
        return (self.parameters[0].low * 20,)

    def probes(self, data: Data) -> list[Probe]:
        return []

    def columns(self, data: Data, context: Context, theta: Sequence[float]) -> Floats:
        c = (data.channels[self.channel] - self.reference) / self.scale
        c = lowpass(c[:, None], data.dt / theta[0], data.starts)[:, 0]
        return plays(FRACTIONS, c, data.starts)

    def values(self, theta: Sequence[float], amplitudes: Floats) -> dict[str, tuple[float, str]]:
        gain = float(np.sum(amplitudes * (1.0 - FRACTIONS))) / self.scale
        return {
            "gain_um_per_unit": (gain, self.limit_unit),
            "tau_s": (float(theta[0]), "s"),
        }

    def blocks(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> tuple[Block, ...]:
        params: dict[str, float | tuple[float, ...]] = {
            "thresholds": tuple(float(r) for r in FRACTIONS * self.scale),
            f"gains_{data.unit}": tuple(float(a) for a in amplitudes),
            "tau_s": float(theta[0]),
            "scale": self.scale,
            "reference": self.reference,
        }
        return (Block("coupled_memory", "stage", params, self.channel),)


def candidates(data: Data) -> list[Candidate]:
    out: list[Candidate] = []
    for c in data.channels:
        if NOT_A_CAUSE.match(c) or c == data.drive_key:
            continue
        reference = float(data.channels[c].mean())
        out += [Coupling(c, reference, data.unit), CoupledMemory(data, c, reference)]
    return out
