"""Computes the path of a move at a set velocity, like the motor record: constant acceleration,
constant velocity, constant deceleration. Pure."""

import numpy as np

from dehyst.models.arrays import Floats


def move_profile(
    start: float, end: float, velocity: float, ramp_s: float, period_s: float
) -> tuple[Floats, Floats]:
    """Return (n,) times [s] and (n,) positions of a move from rest to rest. velocity: largest
    velocity [unit/s]; ramp_s: time from rest to this velocity; period_s: spacing of the points. A
    short move has a triangular velocity profile with the same acceleration; a ramp shorter than one
    point is omitted. The last point is exactly `end`."""
    distance = abs(end - start)
    ramp_s = ramp_s if ramp_s >= period_s else 0.0  # shorter than one point
    if distance < velocity * ramp_s:  # the move never reaches its velocity
        ramp_s = float(np.sqrt(distance * ramp_s / velocity))
        velocity = distance / ramp_s
    total_s = distance / velocity + ramp_s
    t = np.arange(max(2, int(np.ceil(total_s / period_s)) + 1)) * period_s
    slope = velocity / ramp_s if ramp_s > 0 else 0.0
    left = np.maximum(total_s - t, 0.0)
    way = np.where(
        t < ramp_s,
        0.5 * slope * t * t,
        np.where(
            left < ramp_s, distance - 0.5 * slope * left * left, velocity * (t - 0.5 * ramp_s)
        ),
    )
    positions = start + np.sign(end - start) * np.clip(way, 0.0, distance)
    positions[-1] = end
    return np.asarray(t, np.float64), np.asarray(positions, np.float64)
