"""The range of drives that a configuration and a model both allow."""

from dehyst.daemon.config.sections import Config
from dehyst.models.errors import BadInput
from dehyst.models.model import Model

SMALL_PART = 0.5
"""Part of the limits: `dehyst setup` identifies a model over all of them, so one that is valid in
less than half of them was probably made for another stage or amplifier."""


def narrow_validity(config: Config, model: Model) -> str:
    """Return a warning if the model is valid in a small part of the limits only; "" otherwise."""
    low, high = drive_range(config, model)
    gain, limits = config.actuator.gain, config.limits
    part = (high - low) * abs(gain) / (limits.max_v - limits.min_v)
    if part >= SMALL_PART:
        return ""
    return (
        f"the model is valid only from {low * gain:g} to {high * gain:g} V, {100 * part:.2g} % of "
        f"the limits, {limits.min_v:g} to {limits.max_v:g} V: it may be another stage's; check "
        "model.file and actuator.gain"
    )


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
