"""Which displacements a model reaches within the limits, and what a set-point of 0 means."""

import numpy as np

from dehyst.daemon.config import Config
from dehyst.models.errors import BadInput
from dehyst.models.hysteresis.forward import simulate_hysteresis
from dehyst.models.model import Model

REMANENCE = 0.2  # of the range: how far the loop may stay off the virgin stage's zero


def displacement_range(model: Model, drive_min: float, drive_max: float) -> tuple[float, float]:
    """Displacements on the major loop between two drives [model units]."""
    way = np.linspace(drive_min, drive_max, 2001)
    y = simulate_hysteresis(model.hysteresis, np.concatenate([way, way[::-1], way]), 1e9)[
        way.size :
    ]
    return float(np.min(y)), float(np.max(y))


def origin(choice: str | float, low: float, high: float) -> float:
    """Model displacement at set-point 0 (see SetpointConfig.origin)."""
    if not isinstance(choice, str):
        return float(choice)
    margin = REMANENCE * (high - low)
    arbitrary = not low - margin <= 0.0 <= high + margin
    if choice == "mid-range" or (choice == "auto" and arbitrary):
        return 0.5 * (low + high)
    return 0.0


def drive_range(config: Config, model: Model) -> tuple[float, float]:
    """Drives that both the limits and the model's validity allow [drive unit]."""
    gain, valid = config.actuator.gain, model.validity
    low = max(config.limits.min_v / gain, valid.drive_min)
    high = min(config.limits.max_v / gain, valid.drive_max)
    if low >= high:
        raise BadInput(
            f"the model is valid from {valid.drive_min:g} to {valid.drive_max:g} "
            f"{model.drive_unit}, the limits allow {config.limits.min_v / gain:g} to "
            f"{config.limits.max_v / gain:g}: check limits and actuator.gain"
        )
    return low, high
