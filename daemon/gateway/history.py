"""Keeps the newest samples by sequence number, for clients that missed some."""

import threading
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dehyst.daemon.rings.records import TELEMETRY

LARGEST = 4_000_000
"""Upper limit of the samples kept, whatever the configuration says (320 MB)."""


class TelemetryHistory:
    """A circular store of TELEMETRY records; one thread adds, others read.

    capacity: samples kept. Sample number s is in slot s modulo capacity.
    """

    def __init__(self, capacity: int) -> None:
        self.capacity = max(1, min(capacity, LARGEST))
        self._store: NDArray[Any] = np.zeros(self.capacity, TELEMETRY)
        self._store["seq"] = -1
        self._lock = threading.Lock()
        self.run = 0
        self.end = 0  # number after the newest sample
        self.first = 0  # oldest number that may be there

    def restart(self, run: int) -> None:
        """Forget everything, as a new run of the loop counts from 0 again."""
        with self._lock:
            self._store["seq"] = -1
            self.run, self.end, self.first = run, 0, 0

    def add(self, samples: NDArray[Any]) -> None:
        """Store these records, whose sequence numbers ascend."""
        samples = samples[-self.capacity :]
        if not samples.size:
            return
        with self._lock:
            self._store[samples["seq"] % self.capacity] = samples
            if not self.end:
                self.first = int(samples["seq"][0])
            self.end = int(samples["seq"][-1]) + 1
            self.first = max(self.first, self.end - self.capacity)

    def newest(self, count: int) -> NDArray[Any]:
        """Return copies of the last `count` samples, or fewer if there are no more."""
        return self.get(self.end - count, self.end)

    def get(self, first: int, end: int) -> NDArray[Any]:
        """Return copies of the samples first <= seq < end that are still there, ascending."""
        with self._lock:
            numbers = np.arange(max(first, self.first), min(end, self.end))
            out = self._store[numbers % self.capacity]
        return out[out["seq"] == numbers]


def runs(samples: NDArray[Any], longest: int) -> list[NDArray[Any]]:
    """Split the samples where a number is missing, into pieces of at most `longest`."""
    if not samples.size:
        return []
    seq, pieces = samples["seq"], [samples]
    if seq[-1] - seq[0] != seq.size - 1:
        pieces = np.split(samples, np.flatnonzero(np.diff(seq) != 1) + 1)
    return [p[i : i + longest] for p in pieces for i in range(0, p.size, longest)]
