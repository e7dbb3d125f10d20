"""How fast a drive goes, in seconds for a part of its range: for sweeps, ramps and holds alike."""

from collections import deque

import numpy as np

from dehyst.models.recording import Floats

WAY = 0.05
"""Of the drive's range, the way whose time is the pace."""
MOST_POINTS = 20_000
"""Of a recording, at which it is measured."""


def measure_pace(t_s: Floats, u: Floats, u_range: float) -> Floats:
    """(N,) seconds back to the last row that any later row, up to this one, is WAY * u_range away
    from; to the beginning where there is none. u: (N,), without gaps."""
    each = max(1, u.size // MOST_POINTS)
    t, v = t_s[::each], u[::each]
    out = np.empty(v.size)
    highest: deque[int] = deque()  # of the rows from `last` on, each lower than those before it
    lowest: deque[int] = deque()
    last = 0
    for i, x in enumerate(v):
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
