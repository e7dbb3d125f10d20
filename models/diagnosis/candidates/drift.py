"""Drift with a recorded temperature: of the gain and of the zero."""

from collections.abc import Mapping, Sequence

import numpy as np

from dehyst.models.diagnosis.candidates.interface import Candidate, Context, Parameter
from dehyst.models.diagnosis.data import Data, Floats
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

    def columns(self, data: Data, context: Context, theta: Sequence[float]) -> Floats:
        warm = data.channels[self.channel] - self.reference
        return np.column_stack([warm, warm * context.output])

    def values(self, theta: Sequence[float], amplitudes: Floats) -> dict[str, tuple[float, str]]:
        return {
            "expansion_um_per_k": (float(amplitudes[0]), "um/K"),
            "gain_per_k": (float(amplitudes[1]), "1/K"),
        }

    def blocks(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> tuple[Block, ...]:
        params: dict[str, float | tuple[float, ...]] = {
            "gain_per_k": float(amplitudes[1]),
            "expansion_um_per_k": float(amplitudes[0]),
            "reference_c": self.reference,
        }
        return (Block("drift", "stage", params, self.channel),)

    def says(self, values: Mapping[str, tuple[float, str]]) -> str:
        b, a = values["expansion_um_per_k"][0], values["gain_per_k"][0]
        return (
            f"The stage follows the temperature: the zero moves {1e3 * b:.3g} nm and the gain "
            f"{100 * a:.2g} % per kelvin; feed the temperature to the controller or shield it."
        )


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
    driven = False

    def __init__(self, data: Data) -> None:
        self._count = len(data.names)
        self._longest = float(data.t.max() - data.t.min())
        self.parameters = (Parameter("tau_s", "s", 0.05 * self._longest, 20.0 * self._longest),)

    def starts(self, data: Data, residual: Floats) -> list[tuple[float, ...]]:
        return [(f * self._longest,) for f in (0.15, 0.5, 3.0)]

    def columns(self, data: Data, context: Context, theta: Sequence[float]) -> Floats:
        rise = 1.0 - np.exp(-data.t / theta[0])
        return rise[:, None] * (data.rec[:, None] == np.arange(self._count)[None, :])

    def values(self, theta: Sequence[float], amplitudes: Floats) -> dict[str, tuple[float, str]]:
        return {"tau_s": (float(theta[0]), "s"), "rise_um": (float(np.mean(amplitudes)), "um")}

    def blocks(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> tuple[Block, ...]:
        params: dict[str, float | tuple[float, ...]] = {
            f"rate_{data.unit}_per_s": 0.0,
            f"amount_{data.unit}": float(np.mean(amplitudes)),
            "tau_s": float(theta[0]),
        }
        return (Block("trend", "stage", params),)

    def says(self, values: Mapping[str, tuple[float, str]]) -> str:
        return (
            f"The zero drifts by {1e3 * values['rise_um'][0]:.3g} nm in each recording with a time "
            f"constant of {values['tau_s'][0]:.3g} s, whatever the drive does: let it warm up, and "
            "record a temperature."
        )


def candidates(data: Data) -> list[Candidate]:
    by_channel: list[Candidate] = [Drift(data, c) for c in data.channels if c.startswith("temp")]
    return [*by_channel, Trend(data)]
