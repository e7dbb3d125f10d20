"""A histogram of durations on a logarithmic scale: constant memory, constant time, quantiles."""

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
    """Durations in microseconds; quantiles are right to 9 % (an eighth of an octave)."""

    def __init__(self) -> None:
        self.bins: NDArray[np.int64] = np.zeros(BINS_PER_OCTAVE * OCTAVES + 1, np.int64)
        self.extreme = np.zeros(1)

    def add(self, us: float) -> None:
        """Count one duration."""
        count(self.bins, self.extreme, us)

    @property
    def maximum(self) -> float:
        """The longest duration, exact."""
        return float(self.extreme[0])

    def quantile(self, share: float) -> float:
        """Upper edge of the bin that holds the given share; 0 when empty."""
        total = int(self.bins.sum())
        if total == 0:
            return 0.0
        slot = int(np.searchsorted(np.cumsum(self.bins), share * total))
        return float(min(2.0 ** (slot / BINS_PER_OCTAVE), self.maximum))

    def summary(self) -> tuple[float, float, float, float]:
        """(p50, p99, p99.9, maximum) in microseconds."""
        return self.quantile(0.5), self.quantile(0.99), self.quantile(0.999), self.maximum

    def clear(self) -> None:
        """Start again."""
        self.bins[:] = 0
        self.extreme[0] = 0.0
