"""Histogram of the loop's wake-up lateness over the last minute. Pure."""

from collections import deque
from typing import Any

import numpy as np
from numpy.typing import NDArray

PER_OCTAVE, BINS = 2, 40
"""Bins of half an octave from 1 us to 1 s; the first and the last include all values beyond."""
KEPT_S = 60


class Wakeups:
    """Counts of lateness by bin, for each of the last KEPT_S seconds."""

    def __init__(self) -> None:
        self._seconds: deque[NDArray[np.int64]] = deque(maxlen=KEPT_S)
        self._second = -1

    def add(self, samples: NDArray[Any]) -> None:
        """Count the lateness of (n,) TELEMETRY records."""
        if not samples.size:
            return
        second = int(samples["scheduled_ns"][-1]) // 1_000_000_000
        if second != self._second or not self._seconds:
            self._second = second
            self._seconds.append(np.zeros(BINS, np.int64))
        late_us = (samples["actual_ns"] - samples["scheduled_ns"]) * 1e-3
        bins = np.floor(PER_OCTAVE * np.log2(np.maximum(late_us, 1.0))).astype(np.int64)
        self._seconds[-1] += np.bincount(np.minimum(bins, BINS - 1), minlength=BINS)

    def counts(self) -> list[int]:
        """Return (BINS,) numbers of samples by lateness."""
        return [int(n) for n in sum(self._seconds, np.zeros(BINS, np.int64))]


def edges_us() -> list[float]:
    """Return (BINS,) the lower edge of each bin [us]."""
    return [float(2.0 ** (i / PER_OCTAVE)) for i in range(BINS)]
