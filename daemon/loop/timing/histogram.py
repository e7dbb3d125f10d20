"""A histogram of durations on a logarithmic scale, in constant memory and time, with quantiles."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

BINS_PER_OCTAVE = 8
OCTAVES = 24  # 1 us to 16 s


@njit(cache=True, nogil=True)
def count(bins: NDArray[np.int64], extreme: NDArray[np.float64], us: float) -> None:
    """Count one duration: bins (n,), extreme (1,) as in Histogram."""
    extreme[0] = max(extreme[0], us)
    slot = 0 if us <= 1.0 else int(np.log2(us) * BINS_PER_OCTAVE) + 1
    bins[min(slot, bins.size - 1)] += 1


class Histogram:
    """Durations in microseconds; quantiles are accurate to 9 % (an eighth of an octave)."""

    def __init__(self) -> None:
        self.bins: NDArray[np.int64] = np.zeros(BINS_PER_OCTAVE * OCTAVES + 1, np.int64)
        self.extreme = np.zeros(1)
        self._past = np.zeros_like(self.bins)
        self._past_extreme = 0.0

    def add(self, us: float) -> None:
        """Count one duration."""
        count(self.bins, self.extreme, us)

    @property
    def maximum(self) -> float:
        """Return the longest duration [us], exact."""
        return float(self.extreme[0])

    def quantile(self, share: float) -> float:
        """Return the upper edge [us] of the bin that contains the given share; 0 when empty."""
        total = int(self.bins.sum())
        if total == 0:
            return 0.0
        slot = int(np.searchsorted(np.cumsum(self.bins), share * total))
        return float(min(2.0 ** (slot / BINS_PER_OCTAVE), self.maximum))

    def summary(self) -> tuple[float, float, float, float]:
        """Return (p50, p99, p99.9, maximum) in microseconds."""
        return self.quantile(0.5), self.quantile(0.99), self.quantile(0.999), self.maximum

    def clear(self) -> None:
        """Start a new window; `whole` still includes the old one."""
        self._past += self.bins
        self._past_extreme = max(self._past_extreme, self.maximum)
        self.bins[:] = 0
        self.extreme[0] = 0.0

    def whole(self) -> "Histogram":
        """Return a histogram of all windows together."""
        every = Histogram()
        every.bins[:] = self._past + self.bins
        every.extreme[0] = max(self._past_extreme, self.maximum)
        return every

    def rows(self, per_octave: int = 2) -> list[tuple[float, float, int]]:
        """Return (from us, to us, count) of coarser bins, from the first to the last non-empty
        one."""
        width = BINS_PER_OCTAVE // per_octave
        inner = self.bins[1:].reshape(-1, width).sum(axis=1)
        edges = 2.0 ** (np.arange(inner.size + 1) / per_octave)
        found = [(0.0, 1.0, int(self.bins[0]))]
        found += [(float(edges[i]), float(edges[i + 1]), int(n)) for i, n in enumerate(inner)]
        filled = [i for i, row in enumerate(found) if row[2]]
        return found[filled[0] : filled[-1] + 1] if filled else []
