"""Which column to advise for a role that the headings leave open, and the option that names it."""

import re
from collections.abc import Mapping, Sequence

import numpy as np

from dehyst.daemon.files.foreign.encoding import UNCLEAR
from dehyst.daemon.files.foreign.epochs import (
    counts_samples,
    counts_up,
    never_falls,
    rises_evenly,
)
from dehyst.daemon.files.foreign.found import Column
from dehyst.daemon.files.foreign.reading import ReadOptions
from dehyst.daemon.files.foreign.roles import (
    NAMES,
    is_real,
    kind_of,
    says_neither,
    says_role,
    shows_another,
)
from dehyst.daemon.files.foreign.units import ANGLE, LENGTH, VOLTAGE, find_unit_key, split_heading

LEAST_COMMON_ROWS = 16
"""Rows in which two columns must agree to be the same but for their unit."""
FEWEST_COUNTS = 20
"""Range below which any curve follows a straight line within the rounding."""
ROUNDED_TWICE = 1.5
"""Counts by which a column in counts may differ from one that is rounded as well."""


def describe_column(column: Column) -> str:
    text = f"'{column.heading[:40]}'" if column.heading else f"column {column.number}"
    return text + (f" ({column.unit.strip('[](){}')[:24]})" if column.unit else "")


def option_for(columns: Sequence[Column], of: Mapping[str, int]) -> str:
    """Return the option that names a column for each role."""
    return "--columns " + ",".join(f"{role}={_name(columns, i)}" for role, i in of.items())


def _name(columns: Sequence[Column], i: int) -> str:
    heading = columns[i].heading
    unique = sum(column.heading.lower() == heading.lower() for column in columns) == 1
    short = 0 < len(heading) <= 40
    typed = heading.isprintable() and not re.search(r"[\"$`\\!,]", heading)  # in a shell's quotes
    typed = typed and UNCLEAR not in heading
    if not (unique and short and typed):
        return str(columns[i].number)
    plain = re.fullmatch(r"[\w.]+", heading) and not heading.isdecimal()
    return heading if plain else f'"{heading}"'


def most_like(
    columns: Sequence[Column], of: Sequence[int], role: str, others: Mapping[str, int]
) -> int:
    """Return the candidate to advise: the one with the axis or number of the column for the other
    role (drive or displacement), then a voltage for the drive or a length for the displacement,
    then one that was measured."""
    other = others.get("y" if role == "u" else "u")
    beside = _marks(columns[other].heading) if other is not None else set()

    def fits(i: int) -> tuple[int, bool, bool, bool]:
        heading = columns[i].heading
        kind = kind_of(heading, find_unit_key(columns[i].unit))
        usual = kind in ((LENGTH, ANGLE) if role == "y" else (VOLTAGE,))
        return len(_marks(heading) & beside), usual, is_real(heading), not shows_another(heading)

    return max(of, key=fits)


def _marks(heading: str) -> set[str]:
    """Return words and numbers of a heading, and the axis of "Vx"."""
    words = set(re.findall(r"\d+|[^\W\d_]+", split_heading(heading)[0].lower()))
    return words | {word[1] for word in words if len(word) == 2 and word[1] in "xyz"}


def may_be_named(
    columns: Sequence[Column],
    of: Sequence[int],
    roles: Mapping[int, tuple[str, int]],
    role: str,
) -> list[int]:
    """Return the columns that may be named for a role that no heading names: those without a role
    if there are any; the only displacement is not to become the drive, and a count of the samples
    is neither, nor is a column again as whole numbers of its converter."""
    units = {i: find_unit_key(columns[i].unit) for i in of}
    may = [i for i in of if not says_neither(columns[i].heading, units[i]) and roles[i][0] != "t"]
    may = [i for i in may if not counts_samples(columns[i].values)]
    may = [i for i in may if moves(columns[i])] or may
    may = [i for i in may if not any(_in_counts(c, columns[i]) for c in columns[:i])] or may
    measured = [i for i in may if roles[i][0] == "y"]
    if role == "u" and len(measured) == 1:
        may.remove(measured[0])
    named = [i for i in of if says_role(columns[i].heading, role)]  # "Drive (%)"
    return [i for i in may if not roles[i][0]] or may or named


def _in_counts(column: Column, other: Column) -> bool:
    """Return whether another column gives the same in whole numbers."""
    x, y = (np.asarray(c.values, dtype=np.float64) for c in (column, other))
    both = np.isfinite(x) & np.isfinite(y)
    x, y = x[both], y[both]
    if x.size < LEAST_COMMON_ROWS or np.any(y != np.round(y)) or not np.any(x % 1.0):
        return False
    if np.ptp(y) < FEWEST_COUNTS:
        return False
    slope, offset = np.polyfit(x, y, 1)
    return bool(np.max(np.abs(slope * x + offset - y)) <= ROUNDED_TWICE)


def lacking_columns(columns: Sequence[Column], left: Sequence[int], roles: Sequence[str]) -> str:
    """Return what to do if fewer columns are left than roles are required, "" if there are enough.
    left: columns that may have one of these roles."""
    counters = [i for i in left if counts_samples(columns[i].values)]
    if len(left) - len(counters) >= len(roles):
        return ""
    names = ", ".join(describe_column(column) for column in columns[:6])
    counting = f" ({_only_count(columns, counters)})" if counters else ""
    return (
        f"no heading names the {NAMES[roles[-1]]} (there are {names}), and no column is left for "
        f"it{counting}: write drive and displacement to one file, a column each"
    )


def note_counters(columns: Sequence[Column], of: Sequence[int]) -> str:
    """Return words for a list of columns on those that only count the samples; "" if none does."""
    counters = [i for i in of if counts_samples(columns[i].values)]
    return f"; {_only_count(columns, counters)}" if counters else ""


def _only_count(columns: Sequence[Column], which: Sequence[int]) -> str:
    names = " and ".join(describe_column(columns[i]) for i in which[:4])
    one = len(which) == 1
    return (
        f"{names} only count{'s' * one} the samples; name {'it' if one else 'one'} with --columns "
        f"if {'it measures' if one else 'they measure'} something"
    )


def ask_by_number(
    columns: Sequence[Column],
    free: Sequence[int],
    chosen: Mapping[str, int],
    reading: ReadOptions,
    wants: Sequence[str],
    asked: list[str],
) -> None:
    """Ask for the required columns by number, because no column has a heading."""
    roles = [r for r in wants if r not in chosen and not (r == "t" and reading.rate_hz)]
    also = [r for r in "uy" if r not in (*wants, *chosen) and "target" not in wants]
    which, untimed = _advised_without_headings(columns, free, roles, also)
    further = [role for role in roles if role != "t"]
    left = [i for i in free if i != which.get("t")] if "t" in which else free
    lacking = lacking_columns(columns, free, further)
    if lacking := lacking or lacking_columns(columns, left, further):
        known = f"; the others are {option_for(columns, which)}" if "t" in which else ""
        asked.append(lacking + known)
    elif roles:
        first = ", ".join(
            f"column {columns[i].number}: {columns[i].values[0]:.6g}" for i in free[:6]
        )
        option = option_for(columns, which) + (
            " --rate HZ (no column holds times)" if untimed else ""
        )
        asked.append(
            f"{len(columns)} columns of numbers without headings (the first row is {first}): say "
            f"which is which: {option}"
        )


def _advised_without_headings(
    columns: Sequence[Column], free: Sequence[int], roles: Sequence[str], also: Sequence[str]
) -> tuple[dict[str, int], bool]:
    """Return (column to advise for each role, whether none of them holds times): the times rise,
    row numbers are neither times nor anything else, and a column that is constant or a duplicate is
    advised only if nothing else is left for a role. also: further roles, to advise columns for if
    any are left."""
    steady = [i for i in free if rises_evenly(columns[i].values)]
    rising = [i for i in steady if not counts_up(columns[i].values)]
    rising += [i for i in free if i not in steady and never_falls(columns[i].values)]
    times = rising[:1] if "t" in roles else []
    counters = [i for i in free if counts_samples(columns[i].values)]
    moving = [i for i in free if i not in (*steady, *times, *counters) and moves(columns[i])]
    others = [i for i in moving if not any(all_the_same(columns, [j, i]) for j in moving if j < i)]
    further = [role for role in (*roles, *also) if role != "t"]
    needed = len(further) - len(also)
    rest = [i for i in free if i not in (*others, *times, *counters)]
    others += rest[: max(0, needed - len(others))]
    advised = {"t": times[0]} if times else {}
    return advised | dict(zip(further, others, strict=False)), "t" in roles and not times


def moves(column: Column) -> bool:
    values = np.asarray(column.values, dtype=np.float64)
    return np.unique(values[np.isfinite(values)]).size > 1


def all_the_same(columns: Sequence[Column], which: Sequence[int]) -> bool:
    first = columns[which[0]].values
    return all(np.array_equal(first, columns[i].values, equal_nan=True) for i in which[1:])
