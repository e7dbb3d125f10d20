"""Drift with a recorded temperature: of the gain and of the zero."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from dehyst.models.diagnosis.candidates.interface import Candidate, Context, Parameter, Probe, small
from dehyst.models.diagnosis.data import Data, Floats
from dehyst.models.diagnosis.kernels import lowpass
from dehyst.models.model import Block


class Drift(Candidate):
    """y (1 + a dT) + b dT for a temperature channel, dT from its mean."""

    name = "drift"
    title = "Drift with the temperature"
    equation = "y(t) = f(u) (1 + a dT) + b dT"
    source = "thermal expansion of the frame; temperature coefficient of the ceramic"
    typical = "0.01 / K, 0.1 um / K"
    revealed_by = "minutes of recording while the temperature moves"
    confused_with = ("creep",)
    order = 50
    driven = False

    def __init__(self, data: Data, channel: str) -> None:
        self.channel = channel
        self.key = f"drift-{channel}"
        self.reference = float(data.channels[channel].mean())
        self.limit_unit = f"{data.unit}/K"

    def columns(self, data: Data, context: Context, theta: Sequence[float]) -> Floats:
        warm = data.channels[self.channel] - self.reference
        return np.column_stack([warm, warm * context.output])

    def values(self, theta: Sequence[float], amplitudes: Floats) -> dict[str, tuple[float, str]]:
        return {
            "expansion_um_per_k": (float(amplitudes[0]), self.limit_unit),
            "gain_per_k": (float(amplitudes[1]), "1/K"),
        }

    def probes(self, data: Data) -> list[Probe]:
        return [Probe(1.0, (), (1.0, 0.0))]

    def blocks(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> tuple[Block, ...]:
        params: dict[str, float | tuple[float, ...]] = {
            "gain_per_k": float(amplitudes[1]),
            f"expansion_{data.unit}_per_k": float(amplitudes[0]),
            "reference_c": self.reference,
        }
        if abs(float(amplitudes[1])) > 0.2:  # more than the plain block takes
            params["tau_s"] = 1e-3 * data.period
            return (Block("slow_drift", "stage", params, self.channel),)
        return (Block("drift", "stage", params, self.channel),)

    def implausible(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> str:
        return "more than twice the gain per kelvin" if abs(float(amplitudes[1])) > 2.0 else ""

    def says(self, values: Mapping[str, tuple[float, str]]) -> str:
        b, a = small(values["expansion_um_per_k"]), values["gain_per_k"][0]
        return (
            f"The stage follows the temperature: the zero moves {b} and the gain "
            f"{100 * a:.2g} % per kelvin; feed the temperature to the controller or shield it."
        )


class SlowDrift(Drift):
    """The same with the stage following the temperature late, by one thermal time constant."""

    equation = "y(t) = f(u) (1 + a dT) + b dT, dT behind a thermal lag"
    order = 51

    def __init__(self, data: Data, channel: str) -> None:
        super().__init__(data, channel)
        self.key = f"drift2-{channel}"
        self.refines = f"drift-{channel}"
        longest = float(data.t.max() - data.t.min())
        self.parameters = (Parameter("tau_s", "s", 5 * data.period, 2.0 * longest),)

    def refined(self, theta: Sequence[float]) -> tuple[float, ...]:
        return (max(0.02 * self.parameters[0].high, 2 * self.parameters[0].low),)

    def probes(self, data: Data) -> list[Probe]:
        return []

    def columns(self, data: Data, context: Context, theta: Sequence[float]) -> Floats:
        warm = (data.channels[self.channel] - self.reference)[:, None]
        warm = lowpass(warm, data.dt / theta[0], data.starts)[:, 0]
        return np.column_stack([warm, warm * context.output])

    def values(self, theta: Sequence[float], amplitudes: Floats) -> dict[str, tuple[float, str]]:
        return {**super().values(theta, amplitudes), "tau_s": (float(theta[0]), "s")}

    def blocks(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> tuple[Block, ...]:
        (block,) = super().blocks(theta, amplitudes, data)
        params = {**block.params, "tau_s": float(theta[0])}
        return (replace(block, kind="slow_drift", params=params),)


class Trend(Candidate):
    """y + a (1 - exp(-t / tau)) in each recording, its own a: a warm-up that nobody measured."""

    name = "drift"
    key = "drift-trend"
    title = "Drift without a temperature"
    equation = "y(t) = f(u) + a (1 - exp(-t / tau))"
    source = "warming up after switching on or after a pause"
    typical = "some 10 nm a minute"
    revealed_by = "the same drive repeated over minutes; better, a temperature channel"
    confused_with = ("creep",)
    order = 55
    last = True
    driven = False

    def __init__(self, data: Data) -> None:
        self._count = len(data.names)
        self._unit = data.unit
        self._longest = float(data.t.max() - data.t.min())
        self.parameters = (Parameter("tau_s", "s", 0.05 * self._longest, 20.0 * self._longest),)

    def starts(self, data: Data, residual: Floats) -> list[tuple[float, ...]]:
        return [(f * self._longest,) for f in (0.15, 0.5, 3.0)]

    def columns(self, data: Data, context: Context, theta: Sequence[float]) -> Floats:
        rise = 1.0 - np.exp(-data.t / theta[0])
        return rise[:, None] * (data.rec[:, None] == np.arange(self._count)[None, :])

    def values(self, theta: Sequence[float], amplitudes: Floats) -> dict[str, tuple[float, str]]:
        return {
            "tau_s": (float(theta[0]), "s"),
            "rise_um": (float(np.mean(amplitudes)), self._unit),
        }

    def blocks(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> tuple[Block, ...]:
        params: dict[str, float | tuple[float, ...]] = {
            f"rate_{data.unit}_per_s": 0.0,
            f"amount_{data.unit}": float(np.mean(amplitudes)),
            "tau_s": float(theta[0]),
        }
        return (Block("trend", "stage", params),)

    def says(self, values: Mapping[str, tuple[float, str]]) -> str:
        return (
            f"The zero drifts by {small(values['rise_um'])} in each recording with a time "
            f"constant of {values['tau_s'][0]:.3g} s, whatever the drive does: let it warm up, and "
            "record a temperature."
        )

    def implausible(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> str:
        if float(np.abs(amplitudes).max()) > 0.05 * float(np.ptp(data.y)):
            return "a drift of more than a twentieth of the stroke"
        return ""


def candidates(data: Data) -> list[Candidate]:
    by_channel: list[Candidate] = [
        kind(data, c) for c in data.channels if c.startswith("temp") for kind in (Drift, SlowDrift)
    ]
    return [*by_channel, Trend(data)]
