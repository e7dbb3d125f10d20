"""Times counted in nanoseconds or microseconds since 1970, which are too long for a float."""

import re
from typing import Any

import numpy as np

from dehyst.daemon.files.foreign.units import read_heading

_LONG = re.compile(r"\d{16,19}")
_THIS_CENTURY = {"ns": (10**18, 41 * 10**17), "us": (10**15, 41 * 10**14)}
"""Numbers that are moments between 2001 and 2099 in these units, and in no other."""
SHARE_RISING = 0.9


def count_from_first(cell: Any, j: int, first: dict[int, int], may_begin: bool) -> float | None:
    """Return a number of 16 to 19 digits counted from that in the first row of column j, which is
    kept in `first`; None if it is not such a number, or the first row held none."""
    text = str(cell).strip(" \"'")
    if not _LONG.fullmatch(text) or not (may_begin or j in first):
        return None
    return float(int(text) - first.setdefault(j, int(text)))


def is_rising(values: Any) -> bool:
    """Return whether numbers increase steadily, as times do."""
    steps = np.diff(np.asarray(values, dtype=np.float64))
    steps = steps[np.isfinite(steps)]
    return bool(steps.size and np.count_nonzero(steps > 0.0) >= SHARE_RISING * steps.size)


def epoch_unit(first: int, heading: str) -> str:
    """Return the unit of times of which the first is known if the heading gives none, or ""."""
    named = read_heading(heading)
    if named.unit or named.stated:
        return ""
    return next((u for u, (low, high) in _THIS_CENTURY.items() if low <= first < high), "")
