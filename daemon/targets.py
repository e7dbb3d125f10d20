"""Targets of the loop: the newest set-point, or a queue of timed trajectory points.

Pure: times come in, no clock is read. Memory is constant: the queue is two arrays made once.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray


class TrajectoryQueue:
    """Timed points of one trajectory at a time, read by linear interpolation.

    times_ns (offsets from the trajectory's start) must increase. A trajectory starts when its
    first point arrives: its time zero is put at `start_ns`, which leaves time for the approach.
    """

    def __init__(self, capacity: int) -> None:
        self._times: NDArray[np.int64] = np.zeros(capacity, np.int64)
        self._values: NDArray[np.float64] = np.zeros(capacity)
        self._capacity = capacity
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        self.id = 0
        self._first = self._count = 0
        self.start_ns = 0
        self.complete = False

    @property
    def active(self) -> bool:
        """True while there are points of a trajectory."""
        return self._count > 0

    @property
    def full(self) -> bool:
        """True when no further point can be taken."""
        return self._count == self._capacity

    @property
    def first_value(self) -> float:
        """Target of the oldest point held."""
        return float(self._values[self._first])

    def begin(self, trajectory: int, start_ns: int) -> None:
        """Start a new trajectory whose offset 0 lies at start_ns; drops the old one."""
        self.clear()
        self.id, self.start_ns = trajectory, start_ns

    def append(self, offset_ns: int, value: float, last: bool) -> bool:
        """Add a point; False where it is refused (no room, not later than the one before)."""
        if self.full or self.complete:
            return False
        if self._count and self.start_ns + offset_ns <= self.end_ns:
            return False
        slot = (self._first + self._count) % self._capacity
        self._times[slot] = self.start_ns + offset_ns
        self._values[slot] = value
        self._count += 1
        self.complete = last
        return True

    @property
    def end_ns(self) -> int:
        """Time of the newest point."""
        return int(self._times[(self._first + self._count - 1) % self._capacity])

    def ahead_s(self, now_ns: int) -> float:
        """Seconds of trajectory that lie ahead of now."""
        return max(0.0, (self.end_ns - now_ns) * 1e-9) if self._count else 0.0

    def starved(self, now_ns: int) -> bool:
        """True when an incomplete trajectory has no point at or after now."""
        return self._count > 0 and not self.complete and now_ns > self.end_ns

    def finished(self, now_ns: int) -> bool:
        """True when a complete trajectory lies in the past."""
        return self._count > 0 and self.complete and now_ns >= self.end_ns

    def window(self, now_ns: int, period_ns: int, out: NDArray[np.float64]) -> int:
        """Targets at now, now + period, ... into `out`; returns how many are known (0 to out.size).

        Before the first point its value holds; a complete trajectory's last value holds after it.
        Points older than the segment around now are dropped.
        """
        known, dropped = _fill(
            self._times, self._values, self._first, self._count, self.complete,
            now_ns, period_ns, out,
        )  # fmt: skip
        self._first = (self._first + dropped) % self._capacity
        self._count -= dropped
        return known


@njit(cache=True, nogil=True)
def _fill(
    times: NDArray[np.int64],
    values: NDArray[np.float64],
    first: int,
    count: int,
    complete: bool,
    now_ns: int,
    period_ns: int,
    out: NDArray[np.float64],
) -> tuple[int, int]:
    """(number of known targets written to out, number of points that are over)."""
    capacity = times.size
    dropped = 0
    while count - dropped > 1 and times[(first + dropped + 1) % capacity] <= now_ns:
        dropped += 1
    slot, left, time = (first + dropped) % capacity, count - dropped, now_ns
    for i in range(out.size):
        after = (slot + 1) % capacity
        while left > 1 and times[after] <= time:
            slot, left = after, left - 1
            after = (slot + 1) % capacity
        if left == 0:
            return 0, dropped
        here_ns = times[slot]
        if time <= here_ns or (left == 1 and complete):
            out[i] = values[slot]
        elif left > 1:
            share = (time - here_ns) / (times[after] - here_ns)
            out[i] = values[slot] + share * (values[after] - values[slot])
        else:
            out[i:] = values[slot]
            return i, dropped
        time += period_ns
    return out.size, dropped
