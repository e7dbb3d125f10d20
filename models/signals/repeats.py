"""Find readings that a recorder took repeatedly because it polled the gauge too fast, and those of
a gauge that is stuck or at its limit."""

import numpy as np

from dehyst.models.signals.joined import Bools, Floats, Ints

FROZEN_ROWS, FROZEN_WAY = 10, 0.01  # exact repeats, and the share of its range by which the drive
# moves meanwhile, that are no chance where the other readings have noise
RARE = 0.05  # largest fraction of exact repeats among the other readings
NOISY = 0.3  # least fraction of sign changes of the curvature: 0.7 for white noise, near 0 without
LEAST_READINGS = 50  # fewer show no rule
USUAL = 0.9  # least fraction of readings that last as long as the median, to within one row
DISTINCT = 0.5  # least fraction of distinct readings: with fewer they are steps, not noise; and
# largest fraction of the repeats in which the drive is constant, unless the reading changes then


def repeated_readings(y: Floats, drive: Floats) -> Bools:
    """Return (N,) True where a row repeats the previous row's reading; all False if that is no
    rule.

    y, drive: (N,), NaN where missing. A gauge polled too fast repeats each reading about equally
    often, also while the drive moves, and the next reading differs by noise, also while the drive
    is constant. A coarsely quantised reading stays until the stage reaches the next step, and
    returns to the same values; a quiet stage stays until its drive moves.
    """
    out = np.zeros(y.size, dtype=bool)
    rows = np.flatnonzero(np.isfinite(y))
    if rows.size < 2 * LEAST_READINGS:
        return out
    values = y[rows]
    same = np.r_[False, values[1:] == values[:-1]]
    begins = np.flatnonzero(~same)
    stands: Ints = np.diff(begins)
    if stands.size < LEAST_READINGS:
        return out
    usual = int(np.median(stands))
    alike = float(np.mean(np.abs(stands - usual) <= 1))
    distinct = np.unique(values[begins]).size / begins.size
    if usual > 1 and alike >= USUAL and distinct >= DISTINCT and _scatter(values[begins]):
        moves = np.r_[0, np.cumsum(np.diff(drive[rows]) != 0.0)]
        stood = np.diff(moves)[same[1:]] == 0  # a repeat while the drive is constant
        renewed = np.diff(moves[begins]) == 0  # a new reading although it is
        out[rows[same]] = np.mean(stood) <= DISTINCT or np.mean(renewed) >= DISTINCT
    return out


def frozen_readings(y: Floats, drive: Floats) -> Bools:
    """Return (N,) True where the reading stays exactly the same while the drive moves: the gauge is
    stuck, or at its limit. All False where the other readings repeat too, or show no noise.

    y, drive: (N,), NaN where missing.
    """
    out = np.zeros(y.size, dtype=bool)
    rows = np.flatnonzero(np.isfinite(y) & np.isfinite(drive))
    if rows.size < 2 * LEAST_READINGS:
        return out
    values, u = y[rows], drive[rows]
    begins = np.flatnonzero(np.r_[True, values[1:] != values[:-1]])
    ends = np.r_[begins[1:], rows.size]
    span = float(np.ptp(u))
    long = ends - begins >= FROZEN_ROWS
    for begin, end in zip(begins[long], ends[long], strict=True):
        if np.ptp(u[begin:end]) > FROZEN_WAY * span:
            out[rows[begin:end]] = True
    rest = values[~out[rows]]
    if rest.size < LEAST_READINGS:
        return np.zeros(y.size, dtype=bool)
    repeated = float(np.mean(np.diff(rest) == 0.0))
    bends = np.diff(np.sign(np.diff(rest, 2)))
    noisy = float(np.mean(bends != 0.0)) > NOISY
    return out if repeated < RARE and noisy else np.zeros(y.size, dtype=bool)


def _scatter(readings: Floats) -> bool:
    """Return whether most readings differ by more than the single steps of a slow ramp."""
    steps = np.abs(np.diff(readings))
    finest = float(np.min(np.diff(np.unique(readings))))
    return float(np.mean(steps > 1.5 * finest)) > DISTINCT
