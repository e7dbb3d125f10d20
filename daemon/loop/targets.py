"""Targets of the loop: the newest set-point, or a queue of timed trajectory points.

Pure: times come in, no clock is read. Memory is constant: the queue is two arrays made once and a
record of numbers, which the kernels here work on; TrajectoryQueue makes and holds them.
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

    def ahead_s(self, now_ns: int) -> float:
        """Seconds of trajectory that lie ahead of now."""
        queue = self.numbers[0]
        if queue["count"] == 0:
            return 0.0
        return max(0.0, (int(end_ns(queue, self.times)) - now_ns) * 1e-9)


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
