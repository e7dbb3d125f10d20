"""Targets of the loop: the newest set-point, or a queue of timed trajectory points.

Pure: times come in, no clock is read. Memory is constant: the queue is two arrays made once and a
record of numbers, which the compiled step works on; TrajectoryQueue is their face in Python.
"""

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

QUEUE_T = np.dtype(
    [
        ("id", "<u8"),
        ("first", "<i8"),
        ("count", "<i8"),
        ("start_ns", "<i8"),
        ("complete", "<i8"),
    ]
)


class TrajectoryQueue:
    """Timed points of one trajectory at a time, read by linear interpolation.

    times_ns (offsets from the trajectory's start) must increase. A trajectory starts when its
    first point arrives: its time zero is put at `start_ns`, which leaves time for the approach.
    """

    def __init__(self, capacity: int) -> None:
        self.numbers = np.zeros(1, QUEUE_T)
        self.times: NDArray[np.int64] = np.zeros(capacity, np.int64)
        self.values: NDArray[np.float64] = np.zeros(capacity)

    def clear(self) -> None:
        """Forget everything."""
        clear(self.numbers[0])

    @property
    def id(self) -> int:
        """The trajectory's number; 0: none."""
        return int(self.numbers["id"][0])

    @property
    def active(self) -> bool:
        """True while there are points of a trajectory."""
        return bool(self.numbers["count"][0] > 0)

    @property
    def full(self) -> bool:
        """True when no further point can be taken."""
        return bool(self.numbers["count"][0] == self.times.size)

    def begin(self, trajectory: int, start_ns: int) -> None:
        """Start a new trajectory whose offset 0 lies at start_ns; drops the old one."""
        clear(self.numbers[0])
        self.numbers["id"], self.numbers["start_ns"] = trajectory, start_ns

    def append(self, offset_ns: int, value: float, last: bool) -> bool:
        """Add a point; False where it is refused (no room, not later than the one before)."""
        return bool(append(self.numbers[0], self.times, self.values, offset_ns, value, last))

    @property
    def end_ns(self) -> int:
        """Time of the newest point."""
        return int(end_ns(self.numbers[0], self.times))

    def ahead_s(self, now_ns: int) -> float:
        """Seconds of trajectory that lie ahead of now."""
        return max(0.0, (self.end_ns - now_ns) * 1e-9) if self.active else 0.0

    def starved(self, now_ns: int) -> bool:
        """True when an incomplete trajectory has no point at or after now."""
        return bool(starved(self.numbers[0], self.times, now_ns))

    def finished(self, now_ns: int) -> bool:
        """True when a complete trajectory lies in the past."""
        return bool(finished(self.numbers[0], self.times, now_ns))

    def window(self, now_ns: int, period_ns: int, out: NDArray[np.float64]) -> int:
        """Targets at now, now + period, ... into `out`; returns how many are known (0 to out.size).

        Before the first point its value holds; a complete trajectory's last value holds after it.
        Points older than the segment around now are dropped.
        """
        return int(window(self.numbers[0], self.times, self.values, now_ns, period_ns, out))


@njit(cache=True, nogil=True)
def clear(queue: Any) -> None:
    """Forget everything. queue: a QUEUE_T record, as in all kernels here."""
    queue.id = 0
    queue.first = queue.count = queue.start_ns = queue.complete = 0


@njit(cache=True, nogil=True)
def end_ns(queue: Any, times: NDArray[np.int64]) -> int:
    """Time of the newest point."""
    return times[(queue.first + queue.count - 1) % times.size]


@njit(cache=True, nogil=True)
def append(
    queue: Any,
    times: NDArray[np.int64],
    values: NDArray[np.float64],
    offset_ns: int,
    value: float,
    last: bool,
) -> bool:
    """Add a point; False where it is refused."""
    if queue.count == times.size or queue.complete != 0:
        return False
    at = queue.start_ns + offset_ns
    if queue.count > 0 and at <= end_ns(queue, times):
        return False
    slot = (queue.first + queue.count) % times.size
    times[slot] = at
    values[slot] = value
    queue.count += 1
    queue.complete = 1 if last else 0
    return True


@njit(cache=True, nogil=True)
def starved(queue: Any, times: NDArray[np.int64], now_ns: int) -> bool:
    """True when an incomplete trajectory has no point at or after now."""
    return queue.count > 0 and queue.complete == 0 and now_ns > end_ns(queue, times)


@njit(cache=True, nogil=True)
def finished(queue: Any, times: NDArray[np.int64], now_ns: int) -> bool:
    """True when a complete trajectory lies in the past."""
    return queue.count > 0 and queue.complete != 0 and now_ns >= end_ns(queue, times)


@njit(cache=True, nogil=True)
def window(
    queue: Any,
    times: NDArray[np.int64],
    values: NDArray[np.float64],
    now_ns: int,
    period_ns: int,
    out: NDArray[np.float64],
) -> int:
    """Targets at now, now + period, ... into out: how many are known; drops what is over."""
    known, dropped = _fill(
        times, values, queue.first, queue.count, queue.complete != 0, now_ns, period_ns, out
    )
    queue.first = (queue.first + dropped) % times.size
    queue.count -= dropped
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
