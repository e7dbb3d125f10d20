"""Nonlinear reading that repeats along the range: interpolation error of an encoder or fringe.

A smooth static error of the reading (a polynomial) cannot be told from the hysteresis' own shape
by recordings of one stage, and is left to the base.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from dehyst.models.diagnosis.candidates.interface import Candidate, Context, Parameter, Probe, small
from dehyst.models.diagnosis.data import Data, Floats
from dehyst.models.model import Block


class Sensor(Candidate):
    """y = x + a sin(2 pi x / p) + b (cos(2 pi x / p) - 1)."""

    name = key = "sensor"
    title = "Nonlinear sensor"
    equation = "y = x + a sin(2 pi x / p) + b (cos(2 pi x / p) - 1)"
    source = "interpolation error of encoders and interferometers"
    typical = "0.1 to 1 % of the range"
    revealed_by = "slow full strokes; settled by a calibration against another sensor"
    confused_with = ("asymmetry", "friction")
    order = 80
    static = True
    many = True
    place = "sensor"

    def __init__(self, data: Data) -> None:
        self.limit_unit = data.unit
        self._range = float(np.ptp(data.y))
        self.parameters = (
            Parameter("period_um", data.unit, 0.02 * self._range, 0.4 * self._range),
        )

    def starts(self, data: Data, residual: Floats) -> list[tuple[float, ...]]:
        # neighbours share two thirds of a period over the range: the search cannot fall between
        counts = np.arange(2.7, 45.0, 0.5) if self._range > 0 else np.zeros(0)
        order = _strongest(data.y[data.rows], residual[data.rows], self._range / counts)
        return [(float(p),) for p in order[:3]]

    def columns(self, data: Data, context: Context, theta: Sequence[float]) -> Floats:
        angle = 2 * np.pi * context.output / theta[0]
        return np.column_stack([np.sin(angle), np.cos(angle) - 1.0])

    def values(self, theta: Sequence[float], amplitudes: Floats) -> dict[str, tuple[float, str]]:
        unit = self.parameters[0].unit
        return {
            "period_um": (float(theta[0]), unit),
            "amplitude_um": (float(np.hypot(*amplitudes)), unit),
        }

    def probes(self, data: Data) -> list[Probe]:
        return [Probe(1.0, (0.2 * self._range,), (1.0, 0.0))]

    def blocks(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> tuple[Block, ...]:
        params: dict[str, float | tuple[float, ...]] = {
            f"period_{data.unit}": float(theta[0]),
            f"sine_{data.unit}": float(amplitudes[0]),
            f"cosine_{data.unit}": float(amplitudes[1]),
        }
        return (Block("ripple", "sensor", params),)

    def says(self, values: Mapping[str, tuple[float, str]]) -> str:
        period, unit = values["period_um"]
        return (
            f"The reading errs by {small(values['amplitude_um'])} in a pattern that "
            f"repeats every {period:.3g} {unit} along the range: calibrate the sensor; the "
            " drive must not correct this."
        )


def _strongest(y: Floats, residual: Floats, periods: Floats) -> Floats:
    """Periods by the power of the residual at them, averaged over bins of the reading."""
    bins = np.linspace(y.min(), y.max(), 401)
    place = np.clip(np.digitize(y, bins) - 1, 0, 399)
    count = np.bincount(place, minlength=400)
    mean = np.bincount(place, residual, 400) / np.maximum(count, 1)
    centre = 0.5 * (bins[1:] + bins[:-1])
    weight = np.sqrt(count)
    power = [abs(np.sum(weight * mean * np.exp(-2j * np.pi * centre / p))) for p in periods]
    return periods[np.argsort(power)[::-1]]


def candidates(data: Data) -> list[Candidate]:
    return [Sensor(data)]
