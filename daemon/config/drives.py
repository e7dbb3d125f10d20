"""The range of drives that a configuration and a model both allow."""

from dehyst.daemon.config.sections import Config
from dehyst.models.errors import BadInput
from dehyst.models.model import Model


def drive_range(config: Config, model: Model) -> tuple[float, float]:
    """Return the lowest and highest drive within both the limits and the model's validity
    [drive unit]. Raises BadInput if the two ranges do not overlap."""
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
