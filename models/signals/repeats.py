"""Find readings that a recorder took repeatedly, at regular or irregular intervals, because the
gauge gave no new one, and those of a gauge that is stuck or at its limit."""

import numpy as np

from dehyst.models.signals.joined import Bools, Floats, Ints
from dehyst.models.signals.rounding import quantum

FROZEN_ROWS, FROZEN_WAY = 10, 0.01  # exact repeats, and the share of its range by which the drive
# moves meanwhile, that are no chance where the other readings have noise
RARE = 0.05  # largest fraction of exact repeats among the other readings
NOISY = 0.3  # least fraction of sign changes of the curvature: 0.7 for white noise, near 0 without
LEAST_READINGS = 50  # fewer show no rule
USUAL = 0.9  # least fraction of readings that last as long as the median, to within one row
DISTINCT = 0.5  # least fraction of distinct readings: with fewer they are steps, not noise; and
# largest fraction of the repeats in which the drive is constant, unless the reading changes then
CHANCE = 3.0  # repeated readings per change by one step of the gauge; noise gives one at most
ONWARD = 0.2  # least fraction of repeats amid a motion: a third in white noise, none at turns
STILL = 1e-3  # of the drive's range, between two rows: within this the drive is constant, or noise
RENEWED = 0.05  # least fraction of repeated readings that change while the drive is constant, where
# most repeats are; a noise-free reading gives none


def find_repeats(y: Floats, drive: Floats) -> tuple[Bools, Bools]:
    """Return (N,) True where a row repeats the previous row's reading, at regular or irregular
    intervals, and (N,) True at the other rows where the gauge is stuck or at its limit.

    y, drive: (N,), NaN where missing.
    """
    again, frozen = repeated_readings(y, drive), frozen_readings(y, drive)
    again |= irregular_repeats(np.where(again | frozen, np.nan, y), drive)
    return again, frozen & ~again


def repeated_readings(y: Floats, drive: Floats) -> Bools:
    """Return (N,) True where a row repeats the previous row's reading; all False if repeats are not
    the rule.

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


def irregular_repeats(y: Floats, drive: Floats) -> Bools:
    """Return (N,) True where a row repeats the previous row's reading, at whatever intervals; all
    False where that may be chance or the stage's own rest.

    y, drive: (N,), NaN where missing. A gauge that resolves its noise repeats a reading no more
    often than it changes by a single step. A noise-free reading stays while the drive is constant,
    and at turns, as after a dead zone or at the amplifier's limit.
    """
    out = np.zeros(y.size, dtype=bool)
    rows = np.flatnonzero(np.isfinite(y) & np.isfinite(drive))
    values, u = y[rows], drive[rows]
    same = np.diff(values) == 0.0
    begins = np.flatnonzero(np.r_[True, ~same])
    again = np.diff(begins)[1:] > 1  # readings that are repeated, with one before and one after
    if np.count_nonzero(again) < LEAST_READINGS:
        return out
    fresh = values[begins]
    steps = np.diff(fresh)
    by_one = np.count_nonzero(np.abs(steps) < 1.5 * quantum(values))
    onward = (steps[1:] * steps[:-1] > 0.0)[again]
    rests = np.abs(np.diff(u)) <= STILL * np.ptp(u)
    moves = np.diff(np.r_[0, np.cumsum(~rests)][begins])[1:]
    renewed = moves[again] == 0  # a repeated reading gives way to another, the drive being constant
    if (
        np.count_nonzero(again) > CHANCE * by_one
        and np.unique(fresh).size >= DISTINCT * fresh.size
        and np.mean(onward) > ONWARD
        and (np.mean(rests[same]) <= DISTINCT or np.mean(renewed) >= RENEWED)
    ):
        out[rows[1:][same]] = True
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
