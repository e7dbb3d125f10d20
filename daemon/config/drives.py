"""The range of drives that a configuration and a model both allow."""

from dehyst.daemon.config.sections import Config
from dehyst.models.cascade.reach import displacement_range
from dehyst.models.errors import BadInput
from dehyst.models.model import Model
from dehyst.models.units import spell_unit

SMALL_PART = 0.5
"""Part of the limits or of the model's valid range: `dehyst setup` identifies a model over all of
the limits, so where the two share less than half of one, the model was probably made for another
stage or amplifier, or for other units."""


def implausible_ranges(config: Config, model: Model) -> list[str]:
    """Return a warning for each of limits, model and set-point origin that hardly fits the
    others."""
    low, high = drive_range(config, model)
    gain, limits, valid = config.actuator.gain, config.limits, model.validity
    of_limits = (high - low) * abs(gain) / (limits.max_v - limits.min_v)
    of_model = (high - low) / (valid.drive_max - valid.drive_min)
    said = []
    if of_limits < SMALL_PART:
        said.append(
            f"the model is valid only from {low * gain:g} to {high * gain:g} V, "
            f"{100 * of_limits:.2g} % of the limits, {limits.min_v:g} to {limits.max_v:g} V: it "
            "may be another stage's; check model.file and actuator.gain"
        )
    if of_model < SMALL_PART:
        said.append(
            f"the limits use only {100 * of_model:.2g} % of the model's valid range, "
            f"{valid.drive_min:g} to {valid.drive_max:g} {spell_unit(model.drive_unit)}: if that "
            "is not meant, check limits, model.file and actuator.gain"
        )
    origin = config.setpoint.origin
    if not isinstance(origin, str):
        least, most = displacement_range(model, valid.drive_min, valid.drive_max)
        if not 2 * least - most <= origin <= 2 * most - least:
            unit = spell_unit(model.displacement_unit)
            said.append(
                f"setpoint.origin = {origin:g} {unit} is farther from the model's displacements, "
                f"{least:.4g} to {most:.4g} {unit}, than they reach: check its unit"
            )
    return said


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
