"""A drive that covers a range in many ways, to compare two models where the data are sparse.

The data may call for an output that moves backwards right after a reversal, which no invertible
model gives. A bounded fit then bends the rest of the model towards this one recording, in
directions that the recording hardly determines, and is worse on every other drive. The remedy: fit
without bounds on narrow operators first, then look for the monotone model that is close both to the
data and, on this drive, to that first fit.
"""

import numpy as np

from dehyst.models.identify.data.rows import Rows
from dehyst.models.recording import Floats

SIZES = (1.0, 0.8, 0.6, 0.4)  # of the drive range
SIZES_STATIC = (1.0, 0.7, 0.5, 0.3)  # of the drive range, for a static model
PACES = (0.02, 0.05, 0.08, 0.4, 0.8, 1.2)  # of the largest rate
CYCLES = 8  # of each sine, while its centre moves through the range and back
SAMPLES = 60  # per cycle


def make_comparison_drive(low: float, high: float, rate_max: float) -> Rows:
    """Return sines of several sizes and rates whose centres move through the range, as rows without
    displacement.

    rate_max: largest rate of the recordings [drive unit / s]; 0: the rate does not matter.
    """
    drives, rates, resets, start = [], [], [], 0
    paces, sizes = (PACES, SIZES) if rate_max > 0.0 else ((1.0,), SIZES_STATIC)
    for pace in paces:
        for size in sizes:
            u = _wander(low, high, size)
            step = np.diff(u, prepend=u[0])
            drives.append(u)
            rates.append(step / np.max(np.abs(step)) * pace * rate_max)
            resets.append(start)
            start += u.size
    u = np.concatenate(drives)
    every = np.ones(u.size, dtype=bool)
    return Rows(
        name="comparison drive",
        t_s=np.arange(float(u.size)),
        u=u,
        rate=np.concatenate(rates),
        y=np.zeros(u.size),
        use=every,
        resets=np.array(resets, dtype=np.intp),
        settled=every,
        virgin=True,
        period_s=1.0,
        piece=np.zeros(u.size, dtype=np.int8),
    )


def _wander(low: float, high: float, size: float) -> Floats:
    span = high - low
    at = np.arange(CYCLES * SAMPLES)
    half = 0.5 * size * span
    there_and_back = 0.5 * (1.0 - np.cos(2.0 * np.pi * at / (at.size - 1)))
    centre = low + half + (span - 2.0 * half) * there_and_back
    return centre - half * np.cos(2.0 * np.pi * at / SAMPLES)
