"""Targets of the loop: the newest set-point, or a queue of timed trajectory points.

Pure: functions take times as arguments and read no clock. Memory is constant: the queue consists of
preallocated arrays and a record of numbers, on which the kernels here work; TrajectoryQueue makes
and holds them.
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
        # for a trajectory that several axes play together (dehyst.daemon.loop.axes.groups)
        ("group", "<i8"),  # its number; 0: this axis plays alone
        ("members", "<i8"),  # how many axes
        ("started", "<i8"),  # 1: all members were at their first points
        ("shift_ns", "<i8"),  # how much later than its times it is played
        ("stops", "<i8"),  # NOT: no stop; LASTING, OPEN: its time pauses from stop_ns on
        ("stop_ns", "<i8"),  # in the queue's times
        ("dry", "<i8"),  # OWN: no point ahead; OTHER: another member has no point ahead
    ]
)
NOT, LASTING, OPEN = 0, 1, 2
"""NOT: all targets are known; LASTING: the axis rests at stop_ns; OPEN: later ones are unknown."""
OWN, OTHER = 1, 2
FAR_NS = 1 << 62


class Points(NamedTuple):
    """A queue's arrays, (capacity,) each: times [ns], targets, and their learned corrections."""

    times: NDArray[np.int64]
    values: NDArray[np.float64]
    corrections: NDArray[np.float64]


class TrajectoryQueue:
    """Timed points of one trajectory at a time, read by linear interpolation.

    Times (offsets from the trajectory's start) must increase. A trajectory starts when its first
    point arrives: its time zero is set to `start_ns`, which leaves time for the approach.
    corrections: learned correction of each point, separate from its target.
    """

    def __init__(self, capacity: int) -> None:
        self.numbers = np.zeros(1, QUEUE_T)
        self.times: NDArray[np.int64] = np.zeros(capacity, np.int64)
        self.values: NDArray[np.float64] = np.zeros(capacity)
        self.corrections: NDArray[np.float64] = np.zeros(capacity)

    @property
    def points(self) -> Points:
        """Return the arrays in the form that the kernels take."""
        return Points(self.times, self.values, self.corrections)

    @property
    def begun_ns(self) -> int:
        """Return when the trajectory's time is 0; 0: none, or its group has not started."""
        queue = self.numbers[0]
        if queue["group"] and not queue["started"]:
            return 0
        return int(queue["start_ns"]) + int(queue["shift_ns"])

    def ahead_s(self, now_ns: int) -> float:
        """Return the remaining time of the trajectory [s]."""
        queue = self.numbers[0]
        if queue["count"] == 0:
            return 0.0
        end = int(end_ns(queue, self.times)) + int(queue["shift_ns"])
        return max(0.0, (end - now_ns) * 1e-9)


@njit(cache=True, nogil=True)
def clear(queue: Any) -> None:
    """Reset the queue. queue: a QUEUE_T record, as in all kernels here."""
    queue.id = queue.group = 0
    queue.first = queue.count = queue.start_ns = queue.complete = 0
    queue.members = queue.started = queue.shift_ns = 0
    queue.stops = queue.stop_ns = queue.dry = 0


@njit(cache=True, nogil=True)
def end_ns(queue: Any, times: NDArray[np.int64]) -> int:
    """Return the time of the newest point, in the queue's times."""
    return times[(queue.first + queue.count - 1) % times.size]


@njit(cache=True, nogil=True)
def drop_until(queue: Any, times: NDArray[np.int64], at_ns: int) -> None:
    """Drop the points before the last one that is not after at_ns, in the queue's times."""
    dropped = 0
    while queue.count - dropped > 1:
        if times[(queue.first + dropped + 1) % times.size] > at_ns:
            break
        dropped += 1
    queue.first = (queue.first + dropped) % times.size
    queue.count -= dropped


@njit(cache=True, nogil=True)
def queued_target(queue: Any, points: Points, time_ns: int) -> float:
    """Return the target at a time, without correction; outside the points, that of the nearest."""
    times, capacity = points.times, points.times.size
    at = time_ns - queue.shift_ns
    if queue.stops != NOT:
        at = min(at, queue.stop_ns)
    slot = queue.first
    for i in range(1, queue.count):
        after = (queue.first + i) % capacity
        if times[after] > at:
            here_ns, value = times[slot], points.values[slot]
            if at <= here_ns:
                return value
            share = (at - here_ns) / (times[after] - here_ns)
            return value + share * (points.values[after] - value)
        slot = after
    return points.values[slot]


@njit(cache=True, nogil=True)
def append(
    queue: Any,
    points: Points,
    offset_ns: int,
    value: float,
    correction: float,
    last: bool,
) -> bool:
    """Append a point; return False where it is refused."""
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
    """Return True when an incomplete trajectory has no point from now on, or its group waits."""
    if queue.count > 0 and queue.group != 0:
        return queue.dry != 0
    return queue.count > 0 and queue.complete == 0 and now_ns > end_ns(queue, times)


@njit(cache=True, nogil=True)
def finished(queue: Any, times: NDArray[np.int64], now_ns: int) -> bool:
    """Return True when a complete trajectory has been played to its end."""
    if queue.group != 0 and queue.started == 0:
        return False
    played_ns = now_ns - queue.shift_ns
    return queue.count > 0 and queue.complete != 0 and played_ns >= end_ns(queue, times)


@njit(cache=True, nogil=True)
def window(
    queue: Any,
    points: Points,
    now_ns: int,
    period_ns: int,
    out: NDArray[np.float64],
) -> tuple[int, float, float]:
    """Write corrected targets at now, now + period, ... to out. Return how many are known, and the
    present target and correction separately. Points that are over are dropped."""
    times = points.times
    capacity, complete = times.size, queue.complete != 0
    stop_ns = FAR_NS if queue.stops == NOT else queue.stop_ns
    played_ns = now_ns - queue.shift_ns
    drop_until(queue, times, min(played_ns, stop_ns))
    slot, left = queue.first, queue.count
    target = correction = 0.0
    for i in range(out.size):
        time = min(played_ns, stop_ns)
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
        if played_ns > stop_ns and queue.stops == OPEN:
            out[i:] = value + more
            return i, target, correction
        out[i] = value + more
        played_ns += period_ns
    return out.size, target, correction
