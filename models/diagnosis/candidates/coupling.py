"""Coupling: another recorded channel (a neighbouring axis, a force) moves the reading."""

import re
from collections.abc import Mapping, Sequence

import numpy as np

from dehyst.models.diagnosis.candidates.interface import Candidate, Context, Parameter, Probe, small
from dehyst.models.diagnosis.data import Data, Floats
from dehyst.models.diagnosis.kernels import lowpass, plays, second_order
from dehyst.models.diagnosis.peaks import peaks
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


class CoupledMode(Coupling):
    """The same through a mode of the stage that the other drive excites."""

    equation = "y(t) = f(u) + g q(t), q'' + 2 z w q' + w^2 q = w^2 c(t)"
    source = "a mode of the platform that several actuators drive"
    revealed_by = "the other channel with content near the mode"
    order = 62

    def __init__(self, data: Data, channel: str, reference: float) -> None:
        super().__init__(channel, reference, data.unit)
        self.key = f"coupledmode-{channel}"
        self.title = f"Coupling from {channel} through a mode"
        self.confused_with = ("resonance",)
        rate = 1.0 / data.period
        self.parameters = (
            Parameter("frequency_hz", "Hz", 1e-3 * rate, 0.5 * rate, sure=1.5e-3),
            Parameter("damping", "1", 5e-4, 0.3, sure=0.02),
        )

    def starts(self, data: Data, residual: Floats) -> list[tuple[float, ...]]:
        low, high = self.parameters[0].low, self.parameters[0].high
        near = np.array([0.96, 0.98, 1.0, 1.02, 1.04])
        return [
            (float(g), z)
            for f in peaks(data, residual)
            if low < f < 0.9 * high and _reaches(data, data.channels[self.channel], f)
            for g in f * near
            for z in (0.01, 0.04)
        ]

    def columns(self, data: Data, context: Context, theta: Sequence[float]) -> Floats:
        c = (data.channels[self.channel] - self.reference)[:, None]
        return second_order(c, 2 * np.pi * theta[0] * data.dt, theta[1], data.starts)

    def values(self, theta: Sequence[float], amplitudes: Floats) -> dict[str, tuple[float, str]]:
        out = super().values(theta, amplitudes)
        return {**out, "frequency_hz": (float(theta[0]), "Hz"), "damping": (float(theta[1]), "1")}

    def probes(self, data: Data) -> list[Probe]:
        return []

    def blocks(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> tuple[Block, ...]:
        params: dict[str, float | tuple[float, ...]] = {
            "frequency_hz": float(theta[0]),
            "damping": float(theta[1]),
            f"gain_{data.unit}_per_unit": float(amplitudes[0]),
            "reference": self.reference,
        }
        return (Block("coupled_mode", "stage", params, self.channel),)

    def says(self, values: Mapping[str, tuple[float, str]]) -> str:
        gain, f = small(values["gain_um_per_unit"]), values["frequency_hz"][0]
        return (
            f"The channel {self.channel} moves this reading by {gain}, through a mode at "
            f"{f:.4g} Hz: the axes are not decoupled, and the drives should stay away from it."
        )


def _reaches(data: Data, c: Floats, f: float) -> bool:
    """Whether a channel has content within a fifth of a frequency: 1e-3 of its power."""
    power = whole = 0.0
    for p in np.unique(data.part):
        x = c[data.part == p]
        spectrum = np.abs(np.fft.rfft((x - x.mean()) * np.hanning(x.size))) ** 2
        at = np.fft.rfftfreq(x.size, float(data.dt[data.part == p][0]))
        whole += float(spectrum.sum())
        power += float(spectrum[np.abs(at - f) < 0.2 * f].sum())
    return power > 1e-3 * whole


def candidates(data: Data) -> list[Candidate]:
    out: list[Candidate] = []
    for c in data.channels:
        if NOT_A_CAUSE.match(c) or c == data.drive_key:
            continue
        reference = float(data.channels[c].mean())
        out += [
            Coupling(c, reference, data.unit),
            CoupledMemory(data, c, reference),
            CoupledMode(data, c, reference),
        ]
    return out
