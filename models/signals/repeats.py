"""Readings that a recorder took more than once, because the gauge reads more slowly than it was
polled."""

import numpy as np

from dehyst.models.signals.joined import Bools, Floats, Ints

LEAST_READINGS = 50  # fewer show no rule
USUAL = 0.9  # of the readings, that stand as long as the others, within a row
DISTINCT = 0.5  # of the readings: with fewer values they are steps of the reading, not noise; and
# of the repeats, in which the drive may stand


def repeated_readings(y: Floats, drive: Floats) -> Bools:
    """(N,) True where a row repeats the reading of the row before; all False where that is no rule.

    y, drive: (N,), NaN where missing. A polled gauge repeats each reading about equally often, also
    while the drive moves, and the next one differs by noise. A reading in coarse steps stays as
    long as the stage takes to the next step, and comes back to the same values.
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
        stood = np.diff(drive[rows])[same[1:]] == 0.0
        out[rows[same]] = np.mean(stood) <= DISTINCT
    return out


def _scatter(readings: Floats) -> bool:
    """Whether readings differ by more than single steps, as a slow ramp in steps does."""
    steps = np.abs(np.diff(readings))
    finest = float(np.min(np.diff(np.unique(readings))))
    return float(np.mean(steps > 1.5 * finest)) > DISTINCT
