"""Coupling: another recorded channel (a neighbouring axis, a force) moves the reading."""

import re
from collections.abc import Mapping, Sequence

import numpy as np

from dehyst.models.diagnosis.candidates.interface import Candidate, Context, Parameter, Probe, small
from dehyst.models.diagnosis.data import Data, Floats
from dehyst.models.diagnosis.kernels import lowpass, mode, plays
from dehyst.models.diagnosis.peaks import peaks
from dehyst.models.model import Block

FRACTIONS = np.array([0.0, 0.03, 0.1, 0.2, 0.35])  # plays, of the channel's range
MAX_MODES = 6
SAME_MODE = 0.01  # relative distance of frequencies, below which a mode is none of its own
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
    """The same through modes of the stage that the other drive excites."""

    equation = "y(t) = f(u) + sum_k g_k q_k + h_k q_k' / w_k, q'' + 2 z w q' + w^2 q = w^2 c(t)"
    source = "modes of the platform that several actuators drive"
    revealed_by = "the other channel with content near the modes"
    order = 62

    def __init__(self, data: Data, channel: str, reference: float) -> None:
        super().__init__(channel, reference, data.unit)
        self.key = f"coupledmode-{channel}"
        self.title = f"Coupling from {channel} through a mode"
        self.confused_with = ("resonance",)
        self._rate = 1.0 / data.period

    def params_at(self, theta: Sequence[float]) -> tuple[Parameter, ...]:
        rate = self._rate
        return tuple(
            p
            for tail in _tails(theta)
            for p in (
                Parameter(f"frequency{tail}_hz", "Hz", 1e-3 * rate, 0.5 * rate, sure=1.5e-3),
                Parameter(f"damping{tail}", "1", 5e-4, 0.3, sure=0.02),
            )
        )

    def starts(self, data: Data, residual: Floats) -> list[tuple[float, ...]]:
        near = (0.96, 0.98, 1.0, 1.02, 1.04)
        return [
            (f * g, z)
            for f in peaks(data, residual)
            if f < 0.45 * self._rate and _reaches(data, data.channels[self.channel], f)
            for g in near
            for z in (0.01, 0.04)
        ]

    def grown(self, theta: Sequence[float], data: Data, residual: Floats) -> tuple[float, ...]:
        if len(theta) >= 2 * MAX_MODES:
            return ()
        best: tuple[float, tuple[float, ...]] = (0.0, ())
        for start in self.starts(data, residual):
            if any(abs(start[0] / f - 1.0) < SAME_MODE for f in theta[::2]):
                continue
            x = self._mode(data, *start)[data.rows]
            x = x - x.mean(axis=0)
            moment = x.T @ residual[data.rows]
            gain = float(moment @ np.linalg.pinv(x.T @ x, hermitian=True) @ moment)
            best = max(best, (gain, (*theta, *start)))
        return best[1]

    def implausible(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> str:
        gaps = np.diff(np.log(np.sort(theta[::2])))
        return "two of its modes are one" if np.any(gaps < SAME_MODE) else ""

    def _mode(self, data: Data, frequency: float, damping: float) -> Floats:
        c = data.channels[self.channel] - self.reference
        return mode(c, 2 * np.pi * frequency * data.dt, damping, data.starts)

    def columns(self, data: Data, context: Context, theta: Sequence[float]) -> Floats:
        modes = zip(theta[::2], theta[1::2], strict=True)
        return np.concatenate([self._mode(data, f, z) for f, z in modes], axis=1)

    def values(self, theta: Sequence[float], amplitudes: Floats) -> dict[str, tuple[float, str]]:
        out = {"gain_um_per_unit": (float(np.sum(amplitudes[::2])), self.limit_unit)}
        for p, v in zip(self.params_at(theta), theta, strict=True):
            out[p.key] = (float(v), p.unit)
        return out

    def probes(self, data: Data) -> list[Probe]:
        return []

    def blocks(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> tuple[Block, ...]:
        out = []
        parts = (theta[::2], theta[1::2], amplitudes[::2], amplitudes[1::2])
        for f, z, gain, quadrature in zip(*parts, strict=True):
            params: dict[str, float | tuple[float, ...]] = {
                "frequency_hz": float(f),
                "damping": float(z),
                f"gain_{data.unit}_per_unit": float(gain),
                f"quadrature_{data.unit}_per_unit": float(quadrature),
                "reference": self.reference,
            }
            out.append(Block("coupled_mode", "stage", params, self.channel))
        return tuple(out)

    def says(self, values: Mapping[str, tuple[float, str]]) -> str:
        gain = small(values["gain_um_per_unit"])
        f = ", ".join(f"{v:.4g}" for k, (v, _) in values.items() if k.startswith("frequency"))
        through = "a mode" if "," not in f else "modes"
        return (
            f"The channel {self.channel} moves this reading by {gain} when at rest, through "
            f"{through} at {f} Hz: the axes are not decoupled, and the drives should stay away "
            "from there."
        )


def _tails(theta: Sequence[float]) -> list[str]:
    """What the keys of each mode's parameters have before their unit."""
    return [f"_{k + 1}" if k else "" for k in range(len(theta) // 2)]


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
