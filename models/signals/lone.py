"""Find lone readings: single rows that a recorder wrote wrongly."""

import numpy as np

from dehyst.models.recording import Bools, Floats
from dehyst.models.signals.rounding import quantum

OFF = 10.0
"""Deviation of a lone reading in robust standard deviations of all readings' deviations: noise
exceeds 6 once in 10^9 rows."""
STEPS = 4.0
"""The same in steps of the gauge."""
BOTH = 0.7
"""Share of its deviation by which a lone reading differs from both of its neighbours."""
DRIVEN = 0.2
"""Largest share of the deviation that the drive may explain."""
FEW = 0.005
"""Largest share of the rows: with more, it is something that the gauge does."""


def lone_readings(y: Floats, u: Floats) -> Bools:
    """Return (N,) True where a reading is far off both of its neighbours, on the same side, while
    the drive does no such thing; all False if that is frequent. y, u: (N,) reading and drive, NaN
    where missing."""
    lone = np.zeros(y.size, dtype=bool)
    known = np.flatnonzero(np.isfinite(y) & np.isfinite(u))
    if known.size < 20:
        return lone
    v, drive = y[known], u[known]
    off, beside = _off_the_cubic(v), np.abs(_off_the_cubic(drive))
    size = 1.4826 * float(np.median(np.abs(off)))
    limit = max(OFF * size, STEPS * quantum(v), 1e-12 * float(np.ptp(v)))
    before, after = v[2:-2] - v[1:-3], v[2:-2] - v[3:-1]
    both = np.where(before * after > 0.0, np.minimum(np.abs(before), np.abs(after)), 0.0)
    gain = float(np.ptp(np.quantile(v, [0.02, 0.98])))
    gain /= max(float(np.ptp(np.quantile(drive, [0.02, 0.98]))), 1e-300)
    near = np.max([np.roll(beside, k) for k in (-2, -1, 0, 1, 2)], axis=0)
    far = (np.abs(off) > limit) & (both > BOTH * np.abs(off)) & (gain * near < DRIVEN * np.abs(off))
    if 0 < np.count_nonzero(far) <= max(1.0, FEW * known.size):
        lone[known[2:-2][far]] = True
    return lone


def _off_the_cubic(x: Floats) -> Floats:
    """Return the distance (N - 4,) of each inner value from the cubic through its four
    neighbours."""
    return x[2:-2] - (4.0 * (x[1:-3] + x[3:-1]) - (x[:-4] + x[4:])) / 6.0
