"""Reduce telemetry for a screen to the smallest and the largest value in each bucket of time.

A screen has some hundred columns; a minute at 10 kHz has 600 000 samples. Each column shows the
range of its samples, so that no peak is lost, however short. Level k has buckets of 2^k ms. Each
level is computed from the one before and keeps its newest KEPT buckets: the finest 8 s, the
coarsest hours. Pure; buckets are numbered by the controller's monotonic clock.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

FINEST_NS = 1_000_000  # 1 ms
LEVELS = 11  # up to 1.024 s
KEPT = 8192  # of each level
SIGNALS = ("target", "measured", "error", "trim", "learned", "volts")
BACKWARDS_NS = 1_000_000_000
"""Telemetry older than the newest by more than this comes from a clock that was restarted."""


class BucketPiece(NamedTuple):
    """Buckets number[i] with least and largest values (n, len(SIGNALS)), NaN: no sample has one;
    cursor: where the next piece begins; anew: discard all earlier pieces."""

    number: NDArray[np.int64]
    least: NDArray[np.float32]
    largest: NDArray[np.float32]
    cursor: int
    anew: bool


class Level:
    """The buckets of one length, the newest KEPT of them."""

    def __init__(self) -> None:
        self.end = 0  # number of buckets finished so far
        self._number = np.zeros(KEPT, np.int64)
        self._least = np.zeros((KEPT, len(SIGNALS)), np.float32)
        self._largest = np.zeros((KEPT, len(SIGNALS)), np.float32)
        self._open: tuple[Any, Any, Any] | None = None

    def add(
        self, number: NDArray[np.int64], least: NDArray[np.float32], largest: NDArray[np.float32]
    ) -> tuple[NDArray[np.int64], NDArray[np.float32], NDArray[np.float32]]:
        """Add values (n, len(SIGNALS)) of ascending buckets; return the buckets that are now
        finished."""
        if self._open is not None:
            number = np.concatenate([self._open[0], number])
            least = np.concatenate([self._open[1], least])
            largest = np.concatenate([self._open[2], largest])
        starts = np.concatenate([[0], np.flatnonzero(np.diff(number)) + 1])
        number = number[starts]
        least = np.fmin.reduceat(least, starts, axis=0)
        largest = np.fmax.reduceat(largest, starts, axis=0)
        self._open = number[-1:], least[-1:], largest[-1:]
        finished = number[:-1], least[:-1], largest[:-1]
        places = np.arange(self.end, self.end + finished[0].size)[-KEPT:] % KEPT
        self._number[places] = finished[0][-KEPT:]
        self._least[places] = finished[1][-KEPT:]
        self._largest[places] = finished[2][-KEPT:]
        self.end += finished[0].size
        return finished

    def since(self, cursor: int, first: int) -> BucketPiece:
        """Return the buckets finished since `cursor`. If the cursor is too old or -1, return all
        that are kept, from bucket `first` on."""
        anew = not max(0, self.end - KEPT) <= cursor <= self.end
        start = max(0, self.end - KEPT) if anew else cursor
        places = np.arange(start, self.end) % KEPT
        if anew:
            places = places[self._number[places] >= first]
        return BucketPiece(
            self._number[places], self._least[places], self._largest[places], self.end, anew
        )


class Buckets:
    """All levels of one controller's telemetry."""

    def __init__(self) -> None:
        self._levels = [Level() for _ in range(LEVELS)]
        self.newest_ns = -1
        self.run = 0  # incremented when the clock was restarted

    def add(self, samples: NDArray[Any]) -> None:
        """Add (n,) TELEMETRY records; those not newer than the newest are skipped."""
        if not samples.size:
            return
        if int(samples["scheduled_ns"][-1]) < self.newest_ns - BACKWARDS_NS:
            self._levels = [Level() for _ in range(LEVELS)]
            self.newest_ns = -1
            self.run += 1
        samples = samples[samples["scheduled_ns"] > self.newest_ns]
        if not samples.size:
            return
        self.newest_ns = int(samples["scheduled_ns"][-1])
        values = np.empty((samples.size, len(SIGNALS)), np.float32)
        for place, signal in enumerate(SIGNALS):
            if signal == "error":
                values[:, place] = samples["measured"] - samples["target"]
            else:
                values[:, place] = samples[signal]
        number, least, largest = samples["scheduled_ns"] // FINEST_NS, values, values
        for level in self._levels:
            number, least, largest = level.add(number, least, largest)
            if not number.size:
                return
            number = number >> 1

    def since(self, level: int, cursor: int, window_s: float) -> BucketPiece:
        """Return a level's buckets since the cursor of an earlier piece; -1: the last window_s."""
        first_ns = self.newest_ns - round(window_s * 1e9)
        return self._levels[level].since(cursor, first_ns // (FINEST_NS << level))


def level_for(window_s: float, width_px: int) -> int:
    """Return the coarsest level that has a bucket for each column of the screen."""
    column_ms = max(1.0, 1e3 * window_s / max(1, width_px))
    return min(LEVELS - 1, int(np.log2(column_ms)))


def level_between(newest_ns: int, first_ns: int, end_ns: int, width_px: int) -> int:
    """Return the level for a past interval: not finer than the screen, and still kept."""
    level = level_for((end_ns - first_ns) * 1e-9, width_px)
    while level < LEVELS - 1 and newest_ns - first_ns > KEPT * (FINEST_NS << level):
        level += 1
    return level
