"""The pace of a drive: seconds for a fraction of its range. Defined for sweeps, ramps and holds."""

from collections import deque

import numpy as np

from dehyst.models.recording import Floats

WAY = 0.05
"""Travel whose duration is the pace, as a fraction of the drive range."""
MOST_POINTS = 20_000
"""Largest number of points of a recording at which the pace is computed."""
PAUSE = 100.0
"""Sampling periods: what the drive did in a longer gap was not recorded, so the pace starts
again after it."""


def measure_pace(t_s: Floats, u: Floats, u_range: float) -> Floats:
    """Return (N,) the duration [s] of the longest stretch up to each row in which the drive stays
    within a range of WAY * u_range; it is limited by the recording's start, and by a pause in it.
    u: (N,), no missing values."""
    each = max(1, u.size // MOST_POINTS)
    t, v = t_s[::each], u[::each]
    steps = np.diff(t, prepend=t[:1])
    begins = steps > PAUSE * np.median(steps[1:]) if t.size > 1 else np.zeros(t.size, dtype=bool)
    out = np.empty(v.size)
    highest: deque[int] = deque()  # rows from `last` on, in descending order of v
    lowest: deque[int] = deque()
    last = 0
    for i, x in enumerate(v):
        if begins[i]:
            last = i
            highest.clear()
            lowest.clear()
        while highest and v[highest[-1]] <= x:
            highest.pop()
        while lowest and v[lowest[-1]] >= x:
            lowest.pop()
        highest.append(i)
        lowest.append(i)
        while max(v[highest[0]] - x, x - v[lowest[0]]) > WAY * u_range:
            last += 1
            if highest[0] < last:
                highest.popleft()
            if lowest[0] < last:
                lowest.popleft()
        out[i] = t[i] - t[last]
    return np.repeat(out, each)[: u.size] if each > 1 else out


def measure_slowest_s(t_s: Floats, u: Floats, u_range: float) -> float:
    """Return the duration [s] that the pace of 99 rows in 100 does not exceed; slower ones are too
    few to show what is slow. 0 without rows."""
    pace = measure_pace(t_s, u, u_range)
    return float(np.quantile(pace, 0.99)) if pace.size else 0.0
