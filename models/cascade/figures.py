"""Summarise a model's stage in one line, which reveals wrong units at once."""

from dataclasses import dataclass, replace

import numpy as np

from dehyst.models.hysteresis.forward import simulate_hysteresis
from dehyst.models.model import Model
from dehyst.models.units import spell_unit

POINTS = 400
"""Points of each sweep over the drive range: the branches are resolved to a four-hundredth."""


@dataclass(frozen=True)
class Figures:
    """Key figures for slow motion over the drive range. stroke: [displacement unit]; gain: stroke
    per drive; hysteresis: largest distance between the rising and the falling branch, relative to
    the stroke; offset: displacement at rest, de-energised."""

    stroke: float
    gain: float
    hysteresis: float
    offset: float
    drive_min: float
    drive_max: float
    drive_unit: str
    unit: str

    def sentence(self) -> str:
        """Return the figures in one line."""
        d, y = spell_unit(self.drive_unit), spell_unit(self.unit)
        low, high, offset = (x + 0.0 for x in (self.drive_min, self.drive_max, self.offset))
        return (
            f"{self.stroke:.4g} {y} over {low:.4g} to {high:.4g} {d}, "
            f"{self.gain:.4g} {y}/{d}, {self.hysteresis:.2%} hysteresis, offset "
            f"{offset:.4g} {y}"
        )


def describe(model: Model) -> Figures:
    """Compute the figures by running the model's hysteresis over its whole drive range."""
    v = model.validity
    h = replace(model.hysteresis, k=np.zeros(model.hysteresis.n))
    up = np.linspace(v.drive_min, v.drive_max, POINTS)
    y = simulate_hysteresis(h, np.concatenate([up[::-1], up, up[::-1]]), 1.0)
    rising, falling = y[POINTS : 2 * POINTS], y[2 * POINTS :][::-1]
    stroke = abs(float(rising[-1] - rising[0]))
    rest = min(max(0.0, v.drive_min), v.drive_max)
    return Figures(
        stroke=stroke,
        gain=float(rising[-1] - rising[0]) / (v.drive_max - v.drive_min),
        hysteresis=float(np.max(np.abs(falling - rising))) / stroke if stroke else 0.0,
        offset=float(simulate_hysteresis(h, np.array([rest]), 1.0)[0]),
        drive_min=v.drive_min,
        drive_max=v.drive_max,
        drive_unit=model.drive_unit,
        unit=model.displacement_unit,
    )
