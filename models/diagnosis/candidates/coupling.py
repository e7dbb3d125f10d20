"""Coupling: another recorded channel (a neighbouring axis, a force) moves the reading."""

from collections.abc import Mapping, Sequence

from dehyst.models.diagnosis.candidates.interface import Candidate, Context
from dehyst.models.diagnosis.data import Data, Floats
from dehyst.models.model import Block

NOT_A_CAUSE = ("temp", "target", "y_", "t_")


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

    def __init__(self, channel: str, reference: float) -> None:
        self.channel = channel
        self.key = f"coupling-{channel}"
        self.title = f"Coupling from {channel}"
        self.reference = reference
        self.unit = channel.rsplit("_", 1)[-1]

    def columns(self, data: Data, context: Context, theta: Sequence[float]) -> Floats:
        return (data.channels[self.channel] - self.reference)[:, None]

    def values(self, theta: Sequence[float], amplitudes: Floats) -> dict[str, tuple[float, str]]:
        return {"gain_um_per_unit": (float(amplitudes[0]), f"um/{self.unit}")}

    def blocks(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> tuple[Block, ...]:
        params: dict[str, float | tuple[float, ...]] = {
            f"gain_{data.unit}_per_unit": float(amplitudes[0]),
            "reference": self.reference,
        }
        return (Block("coupling", "stage", params, self.channel),)

    def says(self, values: Mapping[str, tuple[float, str]]) -> str:
        g = values["gain_um_per_unit"][0]
        return (
            f"The channel {self.channel} moves this reading by {1e3 * g:.3g} nm per "
            f"{self.unit}: the axes are not decoupled."
        )


def candidates(data: Data) -> list[Candidate]:
    return [
        Coupling(c, float(data.channels[c].mean()))
        for c in data.channels
        if not c.startswith(NOT_A_CAUSE) and c != data.drive_key
    ]
