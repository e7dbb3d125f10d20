"""Decide whether a reading follows its drive, by changes rather than by values: an open input that
wanders agrees with any slow drive by chance."""

import numpy as np

from dehyst.models.recording import Floats

FEWEST_BLOCKS = 40
"""Least number of blocks of which changes are compared."""
SURE = 30.0
"""Explained share of the power of the changes times their number, above which it is not chance: a
chi-square with two degrees of freedom exceeds it once in three million."""

LEAST = 0.05
"""Least share that counts: a sine explains less of a smooth relaxation over many periods."""


def follows_changes(u: Floats, y: Floats) -> bool:
    """Return whether changes of the drive, now or one block earlier, explain a part of the changes
    of the reading at any time scale. u, y: (N,) without gaps. True if there are too few rows.

    Changes of a random walk from block to block are independent of each other, and so are those of
    white noise over long blocks; two of the drive's changes cover every phase of a lag.
    """
    size = 2
    if u.size < 3 * FEWEST_BLOCKS:
        return True
    while u.size // size >= FEWEST_BLOCKS:
        count = u.size // size
        du, dy = (np.diff(x[: count * size].reshape(count, size).mean(axis=1)) for x in (u, y))
        drives = np.stack([du[1:], du[:-1]], axis=1)
        drives, change = drives - drives.mean(axis=0), dy[1:] - dy[1:].mean()
        power = float(change @ change)
        left = change - drives @ np.linalg.lstsq(drives, change, rcond=None)[0]
        share = 1.0 - float(left @ left) / power if power > 0.0 else 0.0
        if share > LEAST and share * change.size > SURE:
            return True
        size *= 2
    return False
