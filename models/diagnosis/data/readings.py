"""Which rows hold a reading of their own: not those that repeat the one before at irregular
intervals; and which readings lie on the motion, though far off both of their neighbours."""

import numpy as np

from dehyst.models.signals.joined import Bools, Floats
from dehyst.models.signals.lone import measure_jumps
from dehyst.models.signals.repeats import DISTINCT, LEAST_READINGS
from dehyst.models.signals.rounding import quantum

CHANCE = 3.0  # repeated readings per change by one step of the gauge; noise gives one at most
ONWARD = 0.2  # least fraction of repeats amid a motion: a third in white noise, none at turns
STILL = 1e-3  # of the drive's range, between two rows: within this the drive is constant, or noise
RENEWED = 0.05  # least fraction of repeated readings that change while the drive is constant, where
# most repeats are; a noise-free reading gives none
CONTINUES = 0.5  # of a reading's distance from the cubic through its neighbours on both sides: the
# largest from a curve through those on one side; a lone reading is about as far from both


def irregular_repeats(y: Floats, drive: Floats) -> Bools:
    """Return (N,) True where a row repeats the previous row's reading, at whatever intervals; all
    False where that may be chance or the stage's own rest.

    y, drive: (N,), NaN where missing. A gauge that resolves its noise gives the same reading twice
    as seldom as one that differs by a single step. A noise-free reading stays while the drive is
    constant, and at turns, as behind a dead zone or at the amplifier's limit.
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


def readings_on_curves(y: Floats) -> Bools:
    """Return (N,) True where a reading continues the motion after it, backwards, or the motion
    before it: that turns there, though the drive need not, as behind a slew limit. y: (N,), NaN
    where missing."""
    out = np.zeros(y.size, dtype=bool)
    rows = np.flatnonzero(np.isfinite(y))
    v = y[rows]
    off = np.full(v.size, np.inf)
    for order in (2, 3):  # differences: from the line, and the parabola, through as many rows
        miss = np.abs(np.diff(v, order))
        off[:-order] = np.minimum(off[:-order], miss)
        off[order:] = np.minimum(off[order:], miss)
    out[rows] = off < CONTINUES * np.abs(measure_jumps(v))
    return out
