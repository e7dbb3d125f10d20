"""The deadline rule, in integers and without a clock: which grid point is next, what was missed.

Grid points are start + n * period. A sample is started at the grid point's time and must have
written its voltage before the next one. When it has not, it is *missed*; grid points that passed
meanwhile are *skipped*, counted, and never made up by a burst.
"""

from numba import njit


@njit(cache=True, nogil=True)
def close(scheduled_ns: int, period_ns: int, finished_ns: int) -> tuple[int, int]:
    """(how many deadlines were missed, the next deadline) when a sample has been finished."""
    late_periods = (finished_ns - scheduled_ns) // period_ns
    # late by less than a period at the next point: serve that point late, do not skip it
    return max(0, late_periods), scheduled_ns + max(1, late_periods) * period_ns


def next_ns(grid_ns: int, now_ns: int, period_ns: int) -> int:
    """The first point after now_ns on the grid that grid_ns belongs to, not before grid_ns."""
    return grid_ns + max(0, (now_ns - grid_ns) // period_ns + 1) * period_ns
