"""Find lone readings: single rows that a recorder wrote wrongly; and which of them lie on the
motion."""

import numpy as np
from numba import njit

from dehyst.models.recording import Bools, Floats
from dehyst.models.signals.rounding import quantum

OFF = 10.0
"""Deviation of a lone reading in robust standard deviations of all readings' deviations: noise
exceeds 6 once in 10^9 rows."""
STEPS = 4.0
"""The same in steps of the gauge."""
BOTH = 0.7
"""Share of its deviation by which a lone reading differs from both of its neighbours."""
ALONE = 0.8
"""Largest deviation of a neighbour, as a share: it has two thirds, as the lone reading is one of
its four neighbours, and a ringing mode near half the sampling rate gives more. It has the opposite
sign; at the crest of a slower mode it has the same."""
APART = 10
"""Fewest rows between two: closer ones belong to a motion, such as a mode that rings."""
DRIVEN = 0.2
"""Largest share of the deviation that the drive may explain."""
JUMP = 0.6745 * (35.0 / 18.0) ** 0.5
"""Median jump of white noise from the cubic through its neighbours, in its standard deviations."""
FEW = 0.005
"""Largest share of the rows: with more, it is something that the gauge does."""
CONTINUES = 0.5
"""Share of a reading's distance from the cubic through its neighbours on both sides: the largest
from a curve through those on one side; a lone reading is about as far from both."""


def lone_readings(y: Floats, u: Floats) -> Bools:
    """Return (N,) True where a reading is far off both of its neighbours, on the same side, while
    the drive does no such thing; all False if that is frequent. y, u: (N,) reading and drive, NaN
    where missing."""
    lone = np.zeros(y.size, dtype=bool)
    known = np.flatnonzero(np.isfinite(y) & np.isfinite(u))
    if known.size < 20:
        return lone
    v = y[known]
    jumps, driven = measure_jumps(v), measure_driven_jumps(v, u[known])
    off = np.abs(jumps)
    limit = max(OFF * 1.4826 * float(np.median(off)), STEPS * quantum(v), 1e-12 * float(np.ptp(v)))
    rest = np.maximum(np.roll(off, 1), np.roll(off, -1))  # the two rows at each end are 0
    against = np.maximum(np.roll(jumps, 1) * jumps, np.roll(jumps, -1) * jumps) <= 0.0
    far = (
        (off > limit)
        & (measure_peaks(v) > BOTH * off)
        & (driven < DRIVEN * off)
        & (rest < ALONE * off)
    )
    at = np.flatnonzero(far & against)
    gaps = np.diff(at, prepend=-APART, append=far.size + APART)
    at = at[np.minimum(gaps[:-1], gaps[1:]) >= APART]
    if 0 < at.size <= max(1.0, FEW * known.size):
        lone[known[at]] = True
    return lone


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


def measure_peaks(x: Floats) -> Floats:
    """Return how far each value (N,) lies above both of its neighbours, or below both: the distance
    to the nearer one; 0 where it lies between them, and next to NaN."""
    out = np.zeros(x.size)
    before, after = x[1:-1] - x[:-2], x[1:-1] - x[2:]
    with np.errstate(invalid="ignore"):
        same = before * after > 0.0
    out[1:-1] = np.where(same, np.minimum(np.abs(before), np.abs(after)), 0.0)
    return out


def measure_driven_jumps(y: Floats, u: Floats) -> Floats:
    """Return the largest jump (N,) of the drive among each row and its four neighbours, in units of
    the reading by the ratio of their spans. y, u: (N,) reading and drive, NaN where missing."""
    spans = [float(np.ptp(np.nanquantile(v, [0.02, 0.98]))) for v in (y, u)]
    jumps = np.abs(measure_jumps(u))
    near = np.max([np.roll(jumps, k) for k in (-2, -1, 0, 1, 2)], axis=0)
    return np.asarray(near * (spans[0] / max(spans[1], 1e-300)))


@njit(cache=True, nogil=True)
def measure_jumps(x: Floats) -> Floats:
    """Return the distance (N,) of each value from the cubic through its four neighbours; 0 next to
    NaN."""
    out = np.zeros(x.size)
    for i in range(2, x.size - 2):
        around = (4.0 * (x[i - 1] + x[i + 1]) - (x[i - 2] + x[i + 2])) / 6.0
        off = x[i] - around
        out[i] = 0.0 if np.isnan(off) else off
    return out
