"""Handle missing samples of a pass, and average over neighbours."""

import numpy as np
from numpy.typing import NDArray

from dehyst.models.learning.tuning import TUNING
from dehyst.models.model import Floats


def describe_missing(valid: NDArray[np.bool_]) -> str:
    """Return a message where too much of a pass has no reading, else ""."""
    lost = int(np.count_nonzero(~valid))
    if not lost:
        return ""
    edges = np.flatnonzero(np.diff(np.concatenate([[True], valid, [True]]).astype(np.int8)))
    longest = int(np.max(edges[1::2] - edges[::2]))
    if lost <= max(1.0, TUNING.missing * valid.size) and longest <= TUNING.longest_gap:
        return ""
    return f"{lost} of {valid.size} samples are missing or without a reading"


def interpolate_missing(x: Floats) -> Floats:
    """Fill missing samples by linear interpolation."""
    good = np.isfinite(x)
    if good.all():
        return x
    places = np.arange(x.size)
    return np.asarray(np.interp(places, places[good], x[good]), np.float64)


def running_mean(x: Floats, width: int) -> Floats:
    """Return (n,) means over `width` neighbours, fewer at the ends."""
    width = min(width, x.size)
    total = np.cumsum(np.concatenate([[0.0], x]))
    first = np.maximum(np.arange(x.size) - width // 2, 0)
    last = np.minimum(first + width, x.size)
    return np.asarray((total[last] - total[first]) / (last - first), np.float64)
