"""What the gauge should read while the stage is where it should be."""

import numpy as np

from dehyst.models.model import Floats, Model
from dehyst.models.physics import KINDS


def expected_reading(model: Model, target: Floats, period_s: float) -> Floats:
    """(n,) readings of a pass (n,) that is played again and again: the target, seen through the
    lag, delay and whatever else the model says of its sensor. A model without sensor blocks
    expects the target itself, so that what a late gauge shows is learned as an error."""
    seen = np.concatenate([target, target])
    times = np.asarray(period_s * np.arange(seen.size), np.float64)
    for block in model.blocks:
        kind = KINDS[block.kind]
        if block.place == "sensor" and not block.channel:
            values = kind.values(block, model.drive_unit, model.displacement_unit)
            seen = kind.run(values, seen, times)
    return np.asarray(seen[target.size :], np.float64)
