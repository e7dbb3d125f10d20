"""Predict the gauge's reading while the stage is at its target."""

import numpy as np

from dehyst.models.model import Floats, Model
from dehyst.models.physics import KINDS


def expected_reading(model: Model, target: Floats, period_s: float) -> Floats:
    """Return (n,) readings of a pass (n,) that is played repeatedly: the target after the lag,
    delay and other sensor blocks of the model. A model without sensor blocks predicts the target
    itself; the lag of a late gauge is then learned as an error."""
    seen = np.concatenate([target, target])
    times = np.asarray(period_s * np.arange(seen.size), np.float64)
    for block in model.blocks:
        kind = KINDS[block.kind]
        if block.place == "sensor" and not block.channel:
            values = kind.values(block, model.drive_unit, model.displacement_unit)
            seen = kind.run(values, seen, times)
    return np.asarray(seen[target.size :], np.float64)
