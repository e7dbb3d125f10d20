"""Prepare a trajectory for the inverse: in the model's unit, evenly spaced, with channels."""

import math

import numpy as np

from dehyst.daemon.files.axis_columns import unit_factor
from dehyst.models.errors import BadInput, BadRecording
from dehyst.models.inverse.compensator import Compensator
from dehyst.models.model import Floats, Model
from dehyst.models.recording import AXIS_CHANNEL, Trajectory

EVEN = 1e-3  # largest deviation of a time step from the median step, as a fraction of it
# a shorter step means that the times are not in s; more samples take over 160 MB a column
SHORTEST_S, MOST_SAMPLES = 1e-6, 20_000_000


def target_in_unit(trajectory: Trajectory, model: Model) -> Floats:
    """Return the targets in the model's displacement unit. Raises BadRecording if they cannot be
    converted."""
    unit, wanted = trajectory.unit, model.displacement_unit
    factor = unit_factor(unit, wanted)
    if factor is not None:
        return trajectory.target if factor == 1.0 else trajectory.target * factor
    raise BadRecording(
        f"{trajectory.name}: targets in {unit}, the model's displacement is in {wanted}; "
        f"a column target_{wanted} is needed"
    )


def spaced_evenly(
    trajectory: Trajectory, target: Floats, period: float | None
) -> tuple[Floats, Floats, float]:
    """Return evenly spaced times, the targets at these times, and the period [s]; `period` None:
    the trajectory's own. Raises BadInput on a bad period, BadRecording on uneven times."""
    t_s = trajectory.t_s
    if period is not None:
        if not SHORTEST_S <= period < math.inf:
            raise BadInput(f"--period: must be at least {SHORTEST_S:g} s, not {period:g}")
        span = t_s[-1] - t_s[0]
        if 0.0 < span < period:
            raise BadInput(
                f"--period {period:g}: longer than the trajectory, which takes {span:g} s"
            )
        if span / period > MOST_SAMPLES:
            raise BadInput(f"--period {period:g}: makes more than {MOST_SAMPLES} samples")
        even = t_s[0] + np.arange(int(span / period + 1.5)) * period
        return even, np.interp(even, t_s, target), period
    if t_s.size < 2:
        raise BadRecording(f"{trajectory.name}: one sample has no period; give --period")
    steps = np.diff(t_s)
    mean = float(np.median(steps))
    if mean < SHORTEST_S:
        raise BadRecording(
            f"{trajectory.name}: t_s steps by {mean:g} s; at least {SHORTEST_S:g} s are needed "
            "(is the time in seconds?)"
        )
    row = int(np.argmax(np.abs(steps - mean)))
    if abs(steps[row] - mean) > EVEN * mean:
        raise BadRecording(
            f"{trajectory.name}: the time step after {t_s[row]:g} s is {steps[row]:g} s, "
            f"elsewhere {mean:g} s; give --period to resample"
        )
    return t_s, target, float((t_s[-1] - t_s[0]) / (t_s.size - 1))


def channels_along(trajectory: Trajectory, compensator: Compensator, t_s: Floats) -> Floats | None:
    """Return (N, number of channels) values of the model's further channels along the trajectory;
    None if the model has none. Raises BadRecording if one is missing."""
    if not compensator.channels:
        return None
    columns = trajectory.channels
    for name in compensator.channels:
        if name not in columns:
            axis = AXIS_CHANNEL.fullmatch(name)
            column = f"target_{axis[1]}_{trajectory.unit}" if axis and not axis[2] else name
            raise BadRecording(
                f"{trajectory.name}: the model needs the column {column}; it is missing"
            )
    return np.stack(
        [np.interp(t_s, trajectory.t_s, columns[n]) for n in compensator.channels], axis=1
    )
