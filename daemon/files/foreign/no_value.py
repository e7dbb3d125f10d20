"""Numbers that stand for no value: -9999, the ends of an integer's range, what no gauge measures.

A number that is all nines, or the end of the range of an integer, stands for none only where it is
apart from all others.
"""

import re

import numpy as np

from dehyst.daemon.files.csv_table import LARGEST
from dehyst.models.recording import Bools, Floats

ENDS = {-(2.0**15), 2.0**15 - 1, 2.0**16 - 1, -(2.0**31), 2.0**31 - 1, 2.0**32 - 1}
NINES = re.compile(r"-?9{3,}(\.0|\.9+)?")
APART = 1.0
"""Least distance of such a number from all others, in units of their span: a gauge at the end of
its range, or a wild reading, has others nearer."""
MOST_MISSING = 0.5
"""Share of a column above which numbers beyond any measurement are damage."""


def stands_for_none(values: Floats, times: bool = False) -> tuple[Bools, str]:
    """Return which of (N,) values stand for no value, and these numbers as text, "" if there are
    none. times: the values are times, of which only those beyond any measurement stand for none."""
    known = np.isfinite(values)
    absurd = known & (np.abs(values) > LARGEST)
    if np.count_nonzero(absurd) > MOST_MISSING * np.count_nonzero(known):
        return np.zeros(values.size, dtype=bool), ""
    none, words = absurd, sorted({f"{value:g}" for value in values[absurd].tolist()})
    within = values[known & ~none]
    for number in {float(within.min()), float(within.max())} if within.size and not times else ():
        if number in ENDS or NINES.fullmatch(repr(number)):
            here = values == number
            others = within[within != number]
            if others.size > np.count_nonzero(here) and _is_apart(number, others):
                none, words = none | here, [*words, f"{number:g}"]
    return none, ", ".join(words[:3])


def _is_apart(number: float, others: Floats) -> bool:
    span = float(np.ptp(others))
    return span > 0.0 and float(np.min(np.abs(others - number))) > APART * span
