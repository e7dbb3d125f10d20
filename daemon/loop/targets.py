"""Targets of the loop: the newest set-point, or a queue of timed trajectory points.

Pure: times come in, no clock is read. Memory is constant: the queue is two arrays made once and a
record of numbers, which the kernels here work on; TrajectoryQueue makes and holds them.
"""

from typing import Any, NamedTuple

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


class Points(NamedTuple):
    """A queue's arrays, (capacity,) each: times [ns], targets, and what was learned for them."""

    times: NDArray[np.int64]
    values: NDArray[np.float64]
    corrections: NDArray[np.float64]


class TrajectoryQueue:
    """Timed points of one trajectory at a time, read by linear interpolation.

    times_ns (offsets from the trajectory's start) must increase. A trajectory starts when its
    first point arrives: its time zero is put at `start_ns`, which leaves time for the approach.
    corrections: what was learned for each point; kept apart from its target.
    """

    def __init__(self, capacity: int) -> None:
        self.numbers = np.zeros(1, QUEUE_T)
        self.times: NDArray[np.int64] = np.zeros(capacity, np.int64)
        self.values: NDArray[np.float64] = np.zeros(capacity)
        self.corrections: NDArray[np.float64] = np.zeros(capacity)

    @property
    def points(self) -> Points:
        """The arrays as the kernels take them."""
        return Points(self.times, self.values, self.corrections)

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
    points: Points,
    offset_ns: int,
    value: float,
    correction: float,
    last: bool,
) -> bool:
    """Add a point; False where it is refused."""
    times = points.times
    if queue.count == times.size or queue.complete != 0:
        return False
    at = queue.start_ns + offset_ns
    if queue.count > 0 and at <= end_ns(queue, times):
        return False
    slot = (queue.first + queue.count) % times.size
    times[slot] = at
    points.values[slot], points.corrections[slot] = value, correction
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
    points: Points,
    now_ns: int,
    period_ns: int,
    out: NDArray[np.float64],
) -> tuple[int, float, float]:
    """Targets with their corrections at now, now + period, ... into out: how many are known; and
    target and correction of now alone. Drops what is over."""
    times = points.times
    capacity, complete = times.size, queue.complete != 0
    dropped = 0
    while queue.count - dropped > 1 and times[(queue.first + dropped + 1) % capacity] <= now_ns:
        dropped += 1
    queue.first = (queue.first + dropped) % capacity
    queue.count -= dropped
    slot, left, time = queue.first, queue.count, now_ns
    target = correction = 0.0
    for i in range(out.size):
        after = (slot + 1) % capacity
        while left > 1 and times[after] <= time:
            slot, left = after, left - 1
            after = (slot + 1) % capacity
        if left == 0:
            return 0, target, correction
        here_ns = times[slot]
        share = 0.0
        if time > here_ns and left > 1:
            share = (time - here_ns) / (times[after] - here_ns)
        elif time > here_ns and not complete:
            out[i:] = points.values[slot] + points.corrections[slot]
            return i, target, correction
        value, more = points.values[slot], points.corrections[slot]
        if share > 0.0:
            value += share * (points.values[after] - value)
            more += share * (points.corrections[after] - more)
        if i == 0:
            target, correction = value, more
        out[i] = value + more
        time += period_ns
    return out.size, target, correction
