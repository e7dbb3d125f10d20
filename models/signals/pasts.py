"""What a stage went through before a recording began, as the memory of its drive's path knows it.

A memory forgets all of its past but the extremes that nothing has reached since, so three pasts
stand for what can have been: de-energised; come from the top of the drive's range; come from its
bottom after the top. A mark in `Data.forgets` says which; 0: the memory goes on.
"""

import math

from numba import njit

from dehyst.models.signals.joined import Floats

GOES_ON, FRESH, FROM_ABOVE, FROM_BELOW = 0, 1, 2, 3


@njit(cache=True, nogil=True)
def begin_plays(h: Floats, r: Floats, past: int, low: float, high: float) -> None:
    """Set plays h (n,) with thresholds r (n,) to where a past leaves them; the range is low..high,
    and a de-energised stage has h = 0."""
    for i in range(r.size):
        h[i] = 0.0
        if past >= FROM_ABOVE:
            h[i] = max(high - r[i], min(high + r[i], 0.0))
        if past == FROM_BELOW:
            h[i] = max(low - r[i], min(low + r[i], h[i]))


@njit(cache=True, nogil=True)
def begin_dahl(z: Floats, length: Floats, past: int, low: float, high: float, first: float) -> None:
    """The same for Dahl operators z (n,), moved on to the first drive of the recording."""
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
