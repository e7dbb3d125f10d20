"""The history of a stage before a recording, as far as the memory of the drive's path retains it.

A memory retains only the past extremes that no later drive has reached. Three pasts therefore
represent all possible ones: de-energised; arrived from the top of the drive range; arrived from its
bottom after the top. A mark in `Data.forgets` selects one; 0: the memory continues.
"""

import math

from numba import njit

from dehyst.models.signals.joined import Floats

GOES_ON, FRESH, FROM_ABOVE, FROM_BELOW = 0, 1, 2, 3


@njit(cache=True, nogil=True)
def begin_plays(h: Floats, r: Floats, past: int, low: float, high: float) -> None:
    """Set plays h (n,) with thresholds r (n,) to their state after a past; the drive range is
    low..high, and a de-energised stage has h = 0."""
    for i in range(r.size):
        h[i] = 0.0
        if past >= FROM_ABOVE:
            h[i] = max(high - r[i], min(high + r[i], 0.0))
        if past == FROM_BELOW:
            h[i] = max(low - r[i], min(low + r[i], h[i]))


@njit(cache=True, nogil=True)
def begin_dahl(z: Floats, length: Floats, past: int, low: float, high: float, first: float) -> None:
    """Set Dahl operators z (n,) to their state after a past, then move them to the first drive of
    the recording."""
    for i in range(length.size):
        z[i] = 0.0
        if past == FRESH:
            continue
        over = math.exp(-(high - low) / length[i])
        z[i] = 1.0 - over
        if past == FROM_BELOW:
            z[i] = -1.0 + (z[i] + 1.0) * over
            z[i] = 1.0 + (z[i] - 1.0) * math.exp(-(first - low) / length[i])
        else:
            z[i] = -1.0 + (z[i] + 1.0) * math.exp(-(high - first) / length[i])
