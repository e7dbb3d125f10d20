"""The deadline rule, in integers and without a clock: which grid point is next, what was missed.

Grid points are start + n * period. A sample is started at the grid point's time and must have
written its voltage before the next one. When it has not, it is *missed*; grid points that passed
meanwhile are *skipped*, counted, and never made up by a burst.
"""

from dataclasses import dataclass

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


@dataclass
class Ticks:
    """The grid's state. Times in integer nanoseconds.

    scheduled_ns: the deadline that is waited for or being served.
    """

    scheduled_ns: int
    period_ns: int
    samples: int = 0
    missed: int = 0

    def lateness_ns(self, woke_ns: int) -> int:
        """How late the wake-up was (0 when early)."""
        return max(0, woke_ns - self.scheduled_ns)

    def finish(self, finished_ns: int) -> int:
        """Close the sample and move to the next grid point; returns how many were missed.

        0: in time. 1: this sample's voltage came after the next grid point. More: grid points
        passed without a sample.
        """
        self.samples += 1
        missed, self.scheduled_ns = close(self.scheduled_ns, self.period_ns, finished_ns)
        self.missed += missed
        return missed
