"""The points of a trajectory that is played repeatedly, pass after pass without a gap."""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dehyst.models.errors import BadInput
from dehyst.models.recording import Floats

Numbers = NDArray[np.int64]
LONGEST_GAP_NS = 1_000_000_000
"""Longest time between two points that are sent [ns]: a daemon accepts only a few seconds at once,
and a player sends three seconds ahead."""
LATEST_S = 4e9
"""Latest time that a trajectory is computed with [s]: 127 years, which fits 64 bits in ns."""
MOST_GAPS = 10_000_000
"""Most points after the gaps were filled (a gap of 115 days): beyond it, the times are not in s."""


class Repeated:
    """A repeated trajectory: point number k overall is point k modulo n of pass k // n. Points that
    are far apart get others between them, on the straight line that the daemon follows anyway.

    t_s, value: (n,) times [s] and targets; times: number of passes, 0: until `end` is called.
    correct: returns the learned corrections of point numbers (m,). Raises BadInput if the times do
    not increase.
    """

    def __init__(
        self,
        t_s: ArrayLike,
        value: ArrayLike,
        times: int = 1,
        correct: Callable[[Numbers], Floats] | None = None,
    ) -> None:
        t, self.targets = np.asarray(t_s, np.float64), np.asarray(value, np.float64)
        if t.ndim != 1 or t.shape != self.targets.shape or t.size < 2:
            raise BadInput("a trajectory needs two or more points, as many times as targets")
        if not np.all(np.isfinite(t)):
            raise BadInput("the times of a trajectory must be finite and strictly increase")
        # later times do not fit into 64 bits; a message below refuses them
        self.offset_ns = np.round(np.clip(t - t[0], -LATEST_S, LATEST_S) * 1e9).astype(np.int64)
        if t[-1] - t[0] <= LATEST_S and np.any(np.diff(self.offset_ns) <= 0):
            raise BadInput("the times of a trajectory must be finite and strictly increase")
        if times < 0:
            raise BadInput(f"{times} repetitions: give 1 or more, or 0 to play until stopped")
        self.offset_ns, self.targets = without_long_gaps(self.offset_ns, self.targets)
        self.n = self.offset_ns.size
        self.pass_ns = int(self.offset_ns[-1]) + round(float(np.median(np.diff(self.offset_ns))))
        self.total: int | None = times * self.n if times else None
        self._correct = correct

    def end(self, sent: int) -> None:
        """End after the last pass of which points have been sent (`sent` points so far)."""
        if self.total is None:
            self.total = self.n * max(1, -(-sent // self.n))

    def over(self, sent: int) -> bool:
        """Return True once all points have been sent."""
        return self.total is not None and sent >= self.total

    def left(self, sent: int) -> Floats:
        """Return the (m,) targets of the points from number `sent` on; those of a whole pass if
        there is no end."""
        if self.total is None:
            return self.targets
        return self.targets[np.arange(sent, self.total) % self.n]

    @property
    def duration_s(self) -> float:
        """Return the duration of all passes [s]; infinite if there is no end."""
        if self.total is None:
            return float("inf")
        return (self.pass_ns * (self.total // self.n - 1) + int(self.offset_ns[-1])) * 1e-9

    def samples(self, period_s: float) -> int:
        """Return how many samples of the loop all passes take."""
        return 1 << 62 if self.total is None else round(self.duration_s / period_s) + 1

    def piece(self, first: int, span_s: float, most: int) -> tuple[Numbers, Floats, Floats]:
        """Return offsets [ns], targets and corrections of the points from number `first` on: those
        within `span_s`, at least two and at most `most`."""
        last = first + most if self.total is None else min(first + most, self.total)
        numbers = np.arange(first, last)
        offsets = self.offset_ns[numbers % self.n] + numbers // self.n * self.pass_ns
        begun = offsets[0] if first else 0
        end = int(np.searchsorted(offsets, begun + round(span_s * 1e9), side="right"))
        numbers = numbers[: max(end, 2)]
        learned = np.zeros(numbers.size) if self._correct is None else self._correct(numbers)
        return offsets[: numbers.size], self.targets[numbers % self.n], learned


def without_long_gaps(offset_ns: Numbers, value: Floats) -> tuple[Numbers, Floats]:
    """Add points to those (n,) times [ns] and targets, on the straight lines between them, so that
    no two are more than LONGEST_GAP_NS apart. Raises BadInput if they are too far apart."""
    parts = -(-np.diff(offset_ns) // LONGEST_GAP_NS)
    if not np.any(parts > 1):
        return offset_ns, value
    if parts.sum() > MOST_GAPS:
        days = offset_ns[-1] * 1e-9 / 86400
        raise BadInput(f"the trajectory takes {days:.0f} days: are its times in seconds?")
    begun, width = np.repeat(offset_ns[:-1], parts), np.repeat(np.diff(offset_ns), parts)
    number = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)
    times = np.append(begun + number * width // np.repeat(parts, parts), offset_ns[-1])
    return times, np.asarray(np.interp(times, offset_ns, value), np.float64)


def on_grid(t_s: Floats, value: Floats, period_s: float) -> tuple[Floats, Floats]:
    """Resample one pass to the loop's period: (m,) times and targets, a whole number of periods, so
    that every pass visits the same positions."""
    begun = t_s - t_s[0]
    step = float(np.median(np.diff(begun)))
    periods = max(2, round((float(begun[-1]) + step) / period_s))
    times = period_s * np.arange(periods)
    closed = np.append(begun, begun[-1] + step), np.append(value, value[0])
    return np.asarray(times, np.float64), np.asarray(np.interp(times, *closed), np.float64)
