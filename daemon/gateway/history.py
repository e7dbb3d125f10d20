"""The newest samples, kept by their sequence numbers, for those who missed some."""

import threading
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dehyst.daemon.rings.records import TELEMETRY

LARGEST = 4_000_000
"""Most samples that are kept, whatever the configuration asks for (320 MB)."""


class TelemetryHistory:
    """A circular store of TELEMETRY records; one thread adds, others read.

    capacity: samples kept. Sample number s lies in slot s modulo capacity.
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
        """Another run of the loop, which counts from 0 again: forget everything."""
        with self._lock:
            self._store["seq"] = -1
            self.run, self.end, self.first = run, 0, 0

    def add(self, samples: NDArray[Any]) -> None:
        """Keep these records; their numbers ascend."""
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
        """Copies of the last `count` samples, fewer where there are no more."""
        return self.get(self.end - count, self.end)

    def get(self, first: int, end: int) -> NDArray[Any]:
        """Copies of the samples first <= seq < end that are still there, ascending."""
        with self._lock:
            numbers = np.arange(max(first, self.first), min(end, self.end))
            out = self._store[numbers % self.capacity]
        return out[out["seq"] == numbers]


def runs(samples: NDArray[Any], longest: int) -> list[NDArray[Any]]:
    """The samples cut where a number is missing and after at most `longest`."""
    if not samples.size:
        return []
    seq, pieces = samples["seq"], [samples]
    if seq[-1] - seq[0] != seq.size - 1:
        pieces = np.split(samples, np.flatnonzero(np.diff(seq) != 1) + 1)
    return [p[i : i + longest] for p in pieces for i in range(0, p.size, longest)]
