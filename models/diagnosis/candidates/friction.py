"""Friction in the guide, as far as it shows: its dependence on the speed.

Presliding alone is a rate-independent memory of the displacement and stays inside the base.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from dehyst.models.diagnosis.candidates.interface import Candidate, Context, Parameter, Probe, small
from dehyst.models.diagnosis.data import Data, Floats
from dehyst.models.diagnosis.kernels import dahl
from dehyst.models.model import Block


class Friction(Candidate):
    """x - (a + b exp(-(v / v_s)^2)) z, dz/dx = (sign v - z) / l."""

    name = key = "friction"
    title = "Friction in the guide"
    equation = "y = x - (a + b exp(-(v / v_s)^2)) z, dz/dx = (sign v - z) / l"
    source = "Dahl 1976; LuGre, Canudas de Wit et al., IEEE Trans. Autom. Control 40 (1995)"
    typical = "50 to 200 nm"
    revealed_by = "small reversals at several speeds"
    confused_with = ("rate", "lag")
    order = 45
    static = True

    def __init__(self, data: Data) -> None:
        self.limit_unit = data.unit
        stroke = float(np.ptp(data.y))
        self.parameters = (
            Parameter("length_um", data.unit, 5e-4 * stroke, 0.3 * stroke),
            Parameter("stribeck_um_per_s", f"{data.unit}/s", 0.02 * stroke, 100.0 * stroke),
        )
        self._stroke = stroke

    def starts(self, data: Data, residual: Floats) -> list[tuple[float, ...]]:
        return [(a * self._stroke, b * self._stroke) for a in (0.004, 0.03) for b in (0.6, 4.0)]

    def columns(self, data: Data, context: Context, theta: Sequence[float]) -> Floats:
        x = context.output
        z = dahl(np.array([theta[0]]), x, data.starts)[:, 0]
        speed = np.diff(x, prepend=x[0]) / data.dt
        speed[data.starts] = 0.0
        return np.column_stack([-z, -z * np.exp(-((speed / theta[1]) ** 2))])

    def values(self, theta: Sequence[float], amplitudes: Floats) -> dict[str, tuple[float, str]]:
        out = super().values(theta, amplitudes)
        out["extra_um"] = (float(amplitudes[1]), self.parameters[0].unit)
        return out

    def probes(self, data: Data) -> list[Probe]:
        return [Probe(1.0, (0.01 * self._stroke, 2.0 * self._stroke), (0.0, 1.0))]

    def blocks(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> tuple[Block, ...]:
        params: dict[str, float | tuple[float, ...]] = {
            f"length_{data.unit}": float(theta[0]),
            f"stribeck_{data.unit}_per_s": float(theta[1]),
            f"sliding_{data.unit}": float(amplitudes[0]),
            f"extra_{data.unit}": float(amplitudes[1]),
        }
        return (Block("friction", "stage", params),)

    def says(self, values: Mapping[str, tuple[float, str]]) -> str:
        return (
            f"The guide rubs: after each turn the stage lags by {small(values['extra_um'])} "
            "more at low speed than at high speed; check the guide and its preload."
        )

    def implausible(self, theta: Sequence[float], amplitudes: Floats, data: Data) -> str:
        return "friction that pushes" if amplitudes[1] < 0 else ""


def candidates(data: Data) -> list[Candidate]:
    return [Friction(data)]
