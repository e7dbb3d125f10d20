"""Find jumps of a reading that the drive does not make: stick-slip, or a switching hysteresis."""

import numpy as np

from dehyst.models.recording import Floats
from dehyst.models.signals.joined import Ints

STEEPEST = 4.0
"""Slope of the reading over the drive from row to row, over the mean slope, above which that of a
hysteresis does not rise: play operators with creep stay below 3."""
SIGMAS = 6.0
"""Least size of a jump, in standard deviations of the difference of two readings."""
LEAST = 0.025
"""Least size of a jump, as a fraction of the range: a plane of few relays has smaller ones."""
EVEN = 0.3
"""Largest share of its travel that a drive may make in the fastest twentieth of its rows: 0.16 for
a sine, 0.05 for a triangle. After a quick ramp of the drive a late reading jumps."""


def measure_share_in_jumps(u: Floats, y: Floats) -> tuple[float, int]:
    """Return the share of its travel that a reading makes in jumps, each in the direction of the
    drive, and their number; (0, 0) if they go in both directions, as hum and outliers do. u, y:
    (N,) without gaps. Readings that repeat exactly are taken once, as a slow gauge holds them."""
    fresh = np.flatnonzero(np.concatenate([[True], np.diff(y) != 0.0]))
    u, y = u[fresh], y[fresh]
    if u.size < 8 or not np.ptp(u) or not np.ptp(y):  # rows: none show jumps
        return 0.0, 0
    du, dy = np.diff(u), np.diff(y)
    fastest = np.sort(np.abs(du))[-max(1, du.size // 20) :]
    if float(fastest.sum()) > EVEN * float(np.abs(du).sum()):
        return 0.0, 0
    gain = float(np.polyfit(u, y, 1)[0])
    mean = float(np.ptp(y) / np.ptp(u))
    ahead = dy - np.sign(gain) * mean * du
    noise = 1.4826 * float(np.median(np.abs(ahead - np.median(ahead))))  # std of normal noise
    least = max(SIGMAS * noise, LEAST * float(np.ptp(y)))
    most = np.maximum(least, STEEPEST * mean * np.abs(du))
    at: Ints = np.flatnonzero(np.abs(dy) > most)
    along = dy[at] * np.sign(gain) * du[at]
    if not at.size or np.count_nonzero(along > 0.0) < (1.0 - 1.0 / SIGMAS) * at.size:
        return 0.0, 0
    return float(np.sum(np.abs(dy[at])) / (mean * np.sum(np.abs(du)))), at.size
