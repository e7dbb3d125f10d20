"""Checks whether the axes can follow a path, by inverting every target as the daemon would."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dehyst.daemon.config import Config, load_controller
from dehyst.daemon.config.drives import drive_range
from dehyst.daemon.files.models import load_model
from dehyst.models.cascade.reach import displacement_range, set_point_origin
from dehyst.models.errors import BadInput
from dehyst.models.inverse import sample
from dehyst.models.inverse.compensator import Compensator
from dehyst.models.inverse.offline import UNREACHABLE, invert_streamed
from dehyst.models.model import Model
from dehyst.models.recording import AXIS_CHANNEL, Floats
from dehyst.models.units import how_many

APPROACH = 400  # samples at the first target, for the output to get there


@dataclass(frozen=True)
class Reached:
    """Limits of an axis. drives: smallest and largest drive; slew: [drive unit/s]; zero: the
    model's displacement at set-point 0."""

    model: Model
    drives: tuple[float, float]
    slew: float
    zero: float

    @property
    def set_points(self) -> tuple[float, float]:
        """Return the smallest and largest set-point."""
        low, high = displacement_range(self.model, *self.drives)
        return low - self.zero, high - self.zero


def axes_of(path: Path, names: tuple[str, ...]) -> tuple[dict[str, Reached], float]:
    """Return the named axes of a configuration and the loop's rate [Hz]. Raises BadInput."""
    controller = load_controller(path)
    known = dict(zip(controller.axis_names, controller.axes, strict=True))
    out = {}
    for name in names:
        if name not in known:
            there = ", ".join(filter(None, known)) or "one axis without a name"
            raise BadInput(f"{path}: there is no axis {name}; it has {there}")
        config = known[name]
        out[name] = axis_of_daemon(load_model(config.model.file), config)
    return out, controller.loop.rate_hz


def axis_of_daemon(model: Model, config: Config) -> Reached:
    """Return the limits of an axis with this model and configuration."""
    drives = drive_range(config, model)
    zero = set_point_origin(config.setpoint.origin, model, *drives)
    return Reached(model, drives, config.limits.slew_v_per_s / abs(config.actuator.gain), zero)


def axis_of_model(model: Model, slew: float) -> Reached:
    """Return the limits of an axis of which only the model is known; its set-points are the model's
    displacements."""
    valid = model.validity
    return Reached(model, (valid.drive_min, valid.drive_max), slew, 0.0)


def require_reach(
    axes: Mapping[str, Reached], targets: Mapping[str, Floats], period_s: float
) -> list[str]:
    """Raise BadInput if an axis cannot follow its targets (N,), given from its set-point origin;
    return warnings for the user."""
    said = []
    for name, one in axes.items():
        target = targets[name]
        low, high = one.set_points
        unit = one.model.displacement_unit
        if target.min() < low or target.max() > high:
            raise BadInput(
                f"axis {name}: the path goes from {target.min():.4g} to {target.max():.4g} {unit}, "
                f"the axis from {low:.4g} to {high:.4g}; make it smaller or move its --center"
            )
        comp = Compensator(one.model, period_s, *one.drives, one.slew, "static")
        wanted = np.concatenate([np.full(APPROACH, target[0]), target]) + one.zero
        channels = _others(comp, axes, targets)
        flags = invert_streamed(comp, wanted, channels).flags[APPROACH:]
        for bits, what in (
            (UNREACHABLE, "out of reach"),
            (sample.SLEW, "faster than the slew limit"),
        ):
            if count := int(np.count_nonzero(flags & bits)):
                where = f"sample of {target.size} is", f"samples of {target.size} are"
                raise BadInput(
                    f"axis {name}: {how_many(count, *where)} {what}, the first at "
                    f"{np.flatnonzero(flags & bits)[0] * period_s:.4g} s; make it smaller or slower"
                )
        if count := int(np.count_nonzero(flags & sample.OUTSIDE)):
            said.append(
                f"axis {name}: {how_many(count, 'sample is', 'samples are')} outside the range "
                "or rate that its model was identified in"
            )
    return said


def _others(
    comp: Compensator, axes: Mapping[str, Reached], targets: Mapping[str, Floats]
) -> Floats | None:
    """Return the (APPROACH + N, channels) inputs of the model's channels: the targets of the other
    axes, NaN for all other channels."""
    if not comp.channels:
        return None
    columns = []
    n = next(iter(targets.values())).size
    for channel in comp.channels:
        axis = AXIS_CHANNEL.fullmatch(channel)
        column = np.full(APPROACH + n, np.nan)
        if axis and not axis[2] and axis[1] in targets:
            target = targets[axis[1]] + axes[axis[1]].zero
            column = np.concatenate([np.full(APPROACH, target[0]), target])
        columns.append(column)
    return np.stack(columns, axis=1)
