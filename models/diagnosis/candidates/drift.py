"""Drift with a recorded temperature: of the gain and of the zero."""

from collections.abc import Mapping, Sequence

import numpy as np

from dehyst.models.diagnosis.candidates.interface import Candidate, Context
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


def candidates(data: Data) -> list[Candidate]:
    return [Drift(data, c) for c in data.channels if c.startswith("temp")]
