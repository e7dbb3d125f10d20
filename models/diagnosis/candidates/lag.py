"""First-order lag: of the amplifier (before the hysteresis) or of the sensor (behind it)."""

from collections.abc import Mapping, Sequence

from dehyst.models.diagnosis.candidates.interface import Candidate, Parameter
from dehyst.models.diagnosis.data import Data, Floats
from dehyst.models.diagnosis.kernels import lowpass
from dehyst.models.model import Block


class Lag(Candidate):
    """tau dv/dt + v = u for the drive, or the same on the reading."""

    name = "lag"
    equation = "tau dx/dt + x = x_in, 1 / (tau s + 1)"
    source = "amplifier with the stack's capacitance (RC), or the sensor's filter"
    typical = "0.1 to 5 ms"
    revealed_by = "content above 0.1 / tau: steps, fast chirps"
    confused_with = ("delay", "resonance", "slew", "rate")

    def __init__(self, data: Data, place: str) -> None:
        self.place = place
        self.mode = "drive" if place == "drive" else "output"
        self.key = f"lag-{place}"
        self.order = 3 if place == "drive" else 40
        self.title = "Lag of the amplifier" if place == "drive" else "Lag of the sensor"
        self.parameters = (Parameter("tau_s", "s", 0.02 * data.period, 300.0 * data.period),)

    def starts(self, data: Data, residual: Floats) -> list[tuple[float, ...]]:
        return [(data.period * k,) for k in (0.3, 1.0, 3.0, 10.0, 30.0)]

    def drive(self, data: Data, v: Floats, theta: Sequence[float]) -> Floats:
        if self.place != "drive":
            return v
        return lowpass(v[:, None], data.dt / theta[0], data.starts)[:, 0]

    def output(self, data: Data, x: Floats, theta: Sequence[float]) -> Floats:
        if self.place == "drive":
            return x
        return lowpass(x, data.dt / theta[0], data.starts)

    def blocks(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> tuple[Block, ...]:
        return (Block("lag", self.place, {"tau_s": float(theta[0])}),)

    def says(self, values: Mapping[str, tuple[float, str]]) -> str:
        tau = values["tau_s"][0]
        corner = 1.0 / (6.283185 * tau)
        if self.place == "drive":
            return (
                f"The amplifier follows with a time constant of {1e3 * tau:.3g} ms (corner "
                f"{corner:.3g} Hz), as a resistor before the stack's capacitance does."
            )
        return (
            f"The reading is smoothed with a time constant of {1e3 * tau:.3g} ms (corner "
            f"{corner:.3g} Hz), as a filter in the sensor does; the stage itself is faster."
        )


def candidates(data: Data) -> list[Candidate]:
    return [Lag(data, "drive"), Lag(data, "sensor")]
