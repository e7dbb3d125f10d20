"""Numbers that are not what was measured: -9999, the ends of an integer's range, what no gauge
measures; rows that a column marks as invalid; a displacement that a counter wrapped.

A number that is all nines, or the end of the range of an integer, stands for no value only if it is
far from all others.
"""

import re
from collections.abc import Mapping, Sequence

import numpy as np

from dehyst.daemon.files.csv_table import LARGEST
from dehyst.daemon.files.foreign.found import Column
from dehyst.daemon.files.foreign.roles import words_of
from dehyst.models.recording import Bools, Floats
from dehyst.models.units import how_many

ENDS = {-(2.0**15), 2.0**15 - 1, 2.0**16 - 1, -(2.0**31), 2.0**31 - 1, 2.0**32 - 1}
_VALID, _INVALID = {"valid", "validity", "ok", "good"}, {"invalid", "bad", "saturated", "clipped"}
"""Words of columns that mark rows with 0 and 1."""
NINES = re.compile(r"-?9{3,}(\.0|\.9+)?")
WHOLE, NEAR, LEAST_WRAPPED = 0.8, 2, 20
"""Least share of the range by which a wrapped displacement jumps; rows before and after a jump in
which it must go on as before; least number of rows."""
APART = 1.0
"""Least distance of such a number from all others, in units of their span: a reading at the end of
a gauge's range, or an outlier, has others nearer to it."""
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


def note_marked(columns: Sequence[Column]) -> list[str]:
    """Return a remark on each column that marks rows as invalid, because their values are kept."""
    said = []
    for column in columns:
        words, values = words_of(column.heading), np.asarray(column.values, dtype=np.float64)
        mark = 0.0 if words & _VALID else 1.0
        rows = int(np.count_nonzero(values == mark))
        if words & (_VALID | _INVALID) and set(np.unique(values)) == {0.0, 1.0}:
            said.append(
                f"'{column.heading[:40]}' is {mark:g} in {how_many(rows, 'row')}, whose values are "
                "kept: empty their fields in the file if they are invalid"
            )
    return said


def note_wrapped(columns: Mapping[str, Floats]) -> str:
    """Return a remark if the displacement jumps from one end of its range to the other while the
    drive does not, and goes on as before, as a counter or a phase does; "" otherwise."""
    found = [next((v for k, v in columns.items() if k.startswith(r)), None) for r in ("u_", "y_")]
    if any(values is None for values in found):
        return ""
    u, y = (np.asarray(values, dtype=np.float64) for values in found)
    if y.shape != u.shape or y.size < LEAST_WRAPPED or not np.all(np.isfinite(y)):
        return ""
    size = np.abs(np.diff(y))
    jumps = size > WHOLE * float(np.ptp(y))
    rows = np.flatnonzero(jumps)
    rows = rows[(rows >= NEAR) & (rows < y.size - 1 - NEAR)]
    if not rows.size or np.max(size[~jumps], initial=0.0) > (1.0 - WHOLE) * float(np.ptp(y)):
        return ""
    leap = y[rows + 1] - y[rows]
    on = ((y[rows] - y[rows - NEAR]) * leap < 0.0) & (
        (y[rows + 1 + NEAR] - y[rows + 1]) * leap < 0.0
    )
    still = np.abs(u[rows + 1] - u[rows]) < (1.0 - WHOLE) * float(np.ptp(u))
    if not np.all(on & still):
        return ""
    which = how_many(rows.size, "row")
    return (
        f"the displacement jumps by about {float(np.median(np.abs(leap))):.5g} in {which}, as a "
        "counter or a phase does when it wraps: if so, unwrap it first (numpy.unwrap with "
        "period=...)"
    )


def _is_apart(number: float, others: Floats) -> bool:
    span = float(np.ptp(others))
    return span > 0.0 and float(np.min(np.abs(others - number))) > APART * span
