"""Measure how long a driver's calls take, which gives the latency and rate that it declares."""

import math
import statistics
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace

from dehyst.drivers.interface import DeviceSpec, DriverConfigError

KEPT = 512
"""Newest durations kept for the percentiles."""
TRIALS = 8
"""Calls timed when a sensor is opened: enough for a median, finished quickly at 10 ms a call."""


class CallTimes:
    """Durations of the last calls, in seconds. Adding is cheap; percentiles sort on demand."""

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
        """Return the duration that `percent` of the kept calls do not exceed; NaN if none."""
        ordered = sorted(self._durations_s)
        if not ordered:
            return float("nan")
        return ordered[min(len(ordered) - 1, int(len(ordered) * percent / 100.0))]


@dataclass(frozen=True)
class Batches:
    """How a unit's calls are timed: in batches of `size`, up to `most` of them, until the `late`
    percentile of a batch is within `close_to_fastest` times the fastest call of all.

    What slows one batch and not another is this machine, not the unit, so the best batch is used.
    `usual`: percentile that gives the highest sustained rate, without room for late replies.
    """

    size: int = 30
    most: int = 8
    usual: float = 75.0
    late: float = 95.0
    close_to_fastest: float = 1.15

    def best(self, call: Callable[[], object], clock: Callable[[], float]) -> CallTimes:
        """Return the durations of the best batch. Raises whatever the call raises."""
        best, fastest_s = CallTimes(), float("inf")
        for _ in range(self.most):
            batch = CallTimes()
            for _ in range(self.size):
                started_s = clock()
                call()
                batch.add(clock() - started_s)
            fastest_s = min(fastest_s, batch.percentile_s(0.0))
            if not self.late_s(batch) >= self.late_s(best):
                best = batch
            if self.late_s(best) <= self.close_to_fastest * fastest_s:
                break
        return best

    def late_s(self, times: CallTimes) -> float:
        """Return the duration that few of these calls exceed."""
        return times.percentile_s(self.late)

    def rate_hz(self, times: CallTimes) -> float:
        """Return the highest rate at which these calls can be made."""
        return 1.0 / times.percentile_s(self.usual)

    def with_rate(
        self,
        spec: DeviceSpec,
        times: CallTimes,
        declared_hz: float | None,
        who: str,
        most_hz: float = math.inf,
    ) -> DeviceSpec:
        """Return the spec with the rate and latencies of these calls; a lower declared rate takes
        precedence. who: the device, for the message; most_hz: upper limit of the rate, however
        quick a call is. Raises DriverConfigError if the declared rate is higher than the sustained
        one."""
        sustained_hz = min(self.rate_hz(times), most_hz)
        if declared_hz is not None and declared_hz > sustained_hz:
            raise DriverConfigError(
                f"{who}: max_rate_hz = {declared_hz:g}, but a call takes {1e3 / sustained_hz:.3g} "
                f"ms here, which allows at most {sustained_hz:.0f} Hz; lower max_rate_hz, or "
                "leave it out"
            )
        return replace(
            spec,
            max_rate_hz=declared_hz or sustained_hz,
            latency_s=times.percentile_s(50.0),
            late_s=self.late_s(times),
        )


def typical_s(call: Callable[[], object], clock: Callable[[], float]) -> float:
    """Return the median duration of a few calls. Raises whatever the call raises."""
    took = []
    for _ in range(TRIALS):
        started_s = clock()
        call()
        took.append(clock() - started_s)
    return statistics.median(took)
