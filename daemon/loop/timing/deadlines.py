"""Compute the next grid point and the missed deadlines, in integers and without a clock.

Grid points are start + n * period. A sample starts at a grid point and must have written its
voltage before the next one; otherwise its deadline is *missed*. Grid points that passed meanwhile
are *skipped*, counted, and never made up by a burst.
"""

from numba import njit


@njit(cache=True, nogil=True)
def close(scheduled_ns: int, period_ns: int, finished_ns: int) -> tuple[int, int]:
    """Return (number of missed deadlines, next deadline) after a finished sample."""
    late_periods = (finished_ns - scheduled_ns) // period_ns
    # if the next point is late by less than a period, serve it late instead of skipping it
    return max(0, late_periods), scheduled_ns + max(1, late_periods) * period_ns


def next_ns(grid_ns: int, now_ns: int, period_ns: int) -> int:
    """Return the first point after now_ns on the grid of grid_ns, not before grid_ns."""
    return grid_ns + max(0, (now_ns - grid_ns) // period_ns + 1) * period_ns
