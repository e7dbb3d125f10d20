"""How long the calls of a driver take: the source of the latency and rate that it declares."""

import statistics
from collections import deque
from collections.abc import Callable

KEPT = 512
TRIALS = 8
"""Calls timed when a sensor is opened: enough for a median, soon done at 10 ms a call."""


class CallTimes:
    """Durations of the last calls, in seconds. Cheap to add to; percentiles sort on demand."""

    def __init__(self, kept: int = KEPT) -> None:
        self._durations_s: deque[float] = deque(maxlen=kept)
        self.count = 0
        self.longest_s = 0.0

    def add(self, duration_s: float) -> None:
        """Record one call."""
        self._durations_s.append(duration_s)
        self.count += 1
        if duration_s > self.longest_s:
            self.longest_s = duration_s

    def percentile_s(self, percent: float) -> float:
        """The duration that `percent` of the kept calls do not exceed; NaN without any call."""
        ordered = sorted(self._durations_s)
        if not ordered:
            return float("nan")
        return ordered[min(len(ordered) - 1, int(len(ordered) * percent / 100.0))]


def typical_s(call: Callable[[], object], clock: Callable[[], float]) -> float:
    """The median duration of a few calls; whatever the call raises."""
    took = []
    for _ in range(TRIALS):
        started_s = clock()
        call()
        took.append(clock() - started_s)
    return statistics.median(took)
