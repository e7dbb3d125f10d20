"""Find columns of times, and continue clocks and counters that start again. Times counted in
nanoseconds or microseconds since 1970, which are too long for a float, count from the first."""

import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from dehyst.daemon.files.foreign.found import Column
from dehyst.daemon.files.foreign.roles import BY_WORD, role_of, words_of
from dehyst.daemon.files.foreign.stated_step import SAME_STEP
from dehyst.daemon.files.foreign.units import TIME, UNITS, find_unit_key, read_heading

_LONG = re.compile(r"\d{16,19}")
_THIS_CENTURY = {"ns": (10**18, 41 * 10**17), "us": (10**15, 41 * 10**14)}
"""Numbers that are moments between 2001 and 2099 in these units, and in no other."""
_SINCE_1970 = {"unix", "unixtime", "epoch", "posix"}
_BY_NAME = {**_THIS_CENTURY, "ms": (10**12, 41 * 10**11), "s": (10**9, 41 * 10**8)}
"""Also moments of this century, where the heading says that they count from 1970."""
SHARE_RISING = 0.9
EVEN = 0.5
"""Largest spread of the steps of evenly rising values, in mean steps: clocks are rounded."""
COUNTED_SHARE = 0.9
"""Least share of equal steps of a count of the samples, of which some were lost."""
TURNS_S = (3600.0, 43200.0, 86400.0)
"""Times at which a clock without a date starts again [s]: Excel's minutes, and those of a day."""
TURNS = (2.0**16, 2.0**24, 2.0**31, 2.0**32)
"""Numbers at which a counter of a microcontroller or a controller starts again."""
LONGEST_TURN = 3.0
"""Largest step across such a place, in median steps; with more, something new may begin there."""


def continued(values: Any, clock: bool) -> tuple[Any, list[int]]:
    """Return times (N,) in which a clock or a counter goes on where it started again, and the rows
    at which it did. What begins at 0 each time may be several recordings, and stays, unless a
    counter goes on in its even steps. clock: the values are those of a clock, in seconds."""
    steps = np.diff(values)
    back = np.flatnonzero(steps < 0.0)
    rising = steps[steps > 0.0]
    if not back.size or not rising.size or not np.all(np.isfinite(values)):
        return values, []
    longest = LONGEST_TURN * float(np.median(rising))
    whole = clock or bool(np.all(values == np.round(values)))
    for turn in (*(TURNS_S if clock else ()), *(TURNS if whole and not clock else ())):
        across = steps[back] + turn
        even = rises_evenly(np.cumsum(rising)) and not np.any(values[back + 1] == values[0])
        even &= bool(np.all((across >= np.min(rising)) & (across <= np.max(rising))))
        near = bool(np.all((across >= 0.0) & (across <= longest)))
        if (near and values[0] > longest) or (even and not clock):
            ahead = np.zeros(values.size)
            ahead[back + 1] = turn
            return values + np.cumsum(ahead), [int(row) + 1 for row in back]
    return values, []


def join_clocks(columns: Sequence[Column]) -> list[Column]:
    """Return the columns with one, of seconds, in place of several that hold the times together,
    such as "Hour", "Min", "Sec", "msec", or a clock of whole seconds and "ms"; all as they are if
    there are none."""
    headings = [read_heading(c.heading) for c in columns]
    names = [h.name for h in headings if h.unit and UNITS[h.unit][0] == TIME]
    parts = [
        (c, UNITS[unit][2])
        for c in columns
        if (unit := "s" if c.clock else find_unit_key(c.unit) or read_heading(c.heading).unit)
        if UNITS[unit][0] == TIME and (c.clock or _is_part_of_a_clock(c.heading, names))
    ]
    scales = [scale for _, scale in parts]
    if len(parts) < 2 or scales != sorted(set(scales), reverse=True):
        return list(columns)
    values = [np.asarray(c.values, dtype=np.float64) for c, _ in parts]
    for k, v in enumerate(values):
        most = np.inf if k == 0 else scales[k - 1] / scales[k]
        whole = k == len(values) - 1 or bool(np.all(v == np.round(v)))
        if not (whole and np.all((v >= 0.0) & (v < most))):
            return list(columns)
    if parts[0][0].clock and np.any(np.diff(values[1])[np.diff(values[0]) == 1.0] >= 0.0):
        return list(columns)  # not the digits of its seconds, which begin again with each
    heading = " + ".join(c.heading for c, _ in parts)
    whole_days = 86400.0 * np.floor(values[0][0] * scales[0] / 86400.0)  # since 1970, perhaps
    values[0] = values[0] - whole_days / scales[0]
    together = np.sum([v * scale for v, scale in zip(values, scales, strict=True)], axis=0)
    joined = Column(heading, together, "s", clock=True, number=parts[0][0].number)
    first, *further = (c.number for c, _ in parts)
    kept = [column for column in columns if column.number not in further]
    return [joined if column.number == first else column for column in kept]


def _is_part_of_a_clock(heading: str, names: Sequence[str]) -> bool:
    """Return whether a heading is a unit of time alone, or names the time, or has the name of
    another column with a unit of time ("header.stamp.sec" and "header.stamp.nanosec"), so that a
    latency in ms, next to times in whole seconds, is not taken for digits of theirs. names: of all
    such columns."""
    name = read_heading(heading).name
    return names.count(name) > 1 or not name or role_of(name, "") == ("t", BY_WORD)


def doubt_of_digits(values: Any, in_seconds: bool, given: bool) -> str:
    """Return why the digits of times (N,) are doubtful as seconds, and what to type, "" where they
    are not. in_seconds: the file says that they are seconds; given: it is known that they are."""
    if not given and is_packed_clock(values, in_seconds):
        return (
            "jumps as hours, minutes and seconds in one number do (HHMMSS): add --time-unit s if "
            "these are seconds with pauses; otherwise write them as HH:MM:SS, or add --rate HZ "
            "where no row is missing"
        )
    if lack_zeros(values):
        return (
            "goes back within one second several times, as fractions without their zeros do (10.99 "
            "before 10.100): write all digits of the fraction, or add --rate HZ where no row is "
            "missing"
        )
    return ""


def lack_zeros(values: Any) -> bool:
    """Return whether times (N,) in seconds hold fractions that were written without the zeros in
    front, as whole numbers: "10.99" is followed by "10.100", which is earlier in the same
    second."""
    values = np.asarray(values, dtype=np.float64)
    back = np.flatnonzero(np.diff(values) < 0.0)
    before, after = values[back], values[back + 1]
    first = np.floor(10.0 * (after - np.floor(after)) + 1e-5)  # digit after the point
    return back.size > 1 and bool(np.all((np.floor(before) == np.floor(after)) & (first == 1.0)))


def is_packed_clock(values: Any, in_seconds: bool) -> bool:
    """Return whether numbers (N,) hold hours, minutes and seconds one after the other, such as
    140759.5: they never show a second or a minute of 60 or more, and jump by 40 into a new minute.
    in_seconds: the file says that they are seconds, in which a pause jumps so once."""
    values = np.asarray(values, dtype=np.float64)
    values = values[np.isfinite(values)]
    steps = np.diff(values)
    jumps = np.abs(steps) >= 40.0
    few = 0 < 2 * np.count_nonzero(jumps) < steps.size
    if not few or not np.all((values >= 0.0) & (values < 240_000.0)):
        return False
    usual = float(np.median(steps))
    in_turn = np.all((values % 100.0 < 60.0) & (values // 100.0 % 100.0 < 60.0))
    short = np.all(np.minimum(steps[jumps] % 40.0, steps[jumps]) <= LONGEST_TURN * usual)
    minutes = np.count_nonzero(steps[jumps] <= 40.0 + LONGEST_TURN * usual)
    often = minutes > 1 or not in_seconds
    return bool(in_turn and short and often and np.all(np.diff(values // 100.0)[jumps] > 0.0))


def count_from_first(cell: Any, j: int, first: dict[int, int], may_begin: bool) -> float | None:
    """Return a number of 16 to 19 digits counted from that in the first row of column j, which is
    kept in `first`; None if it is not such a number, or the first row held none."""
    text = str(cell).strip(" \"'")
    if not _LONG.fullmatch(text) or not (may_begin or j in first):
        return None
    return float(int(text) - first.setdefault(j, int(text)))


def rises_evenly(values: Any) -> bool:
    """Return whether values (N,) rise in nearly even steps, as times and row numbers do."""
    steps = np.diff(np.asarray(values, dtype=np.float64))
    if steps.size < 2 or not bool(np.all(steps > 0.0)):
        return False
    return float(np.ptp(steps)) < EVEN * float(np.mean(steps))


def never_falls(values: Any) -> bool:
    """Return whether values (N,) rise at most rows and never fall, as times do."""
    values = np.asarray(values, dtype=np.float64)
    steps = np.diff(values[np.isfinite(values)])
    return bool(np.all(steps >= 0.0)) and 2 * int(np.count_nonzero(steps)) > steps.size


def counts_up(values: Any) -> bool:
    """Return whether values (N,) are row numbers."""
    values = np.asarray(values, dtype=np.float64)
    return bool(np.all(np.diff(values) == 1.0)) and float(values[0]).is_integer()


def counts_samples(values: Any) -> bool:
    """Return whether values (N,) only count the samples: whole numbers that step by the same
    amount, except where some were lost or the counter began again."""
    values = np.asarray(values, dtype=np.float64)
    steps = np.diff(values)
    if steps.size < 2 or not np.array_equal(values, np.round(values)):
        return False
    usual = float(np.median(steps))
    return usual != 0.0 and float(np.mean(steps == usual)) >= COUNTED_SHARE


def apart_as_times(times: Sequence[Any]) -> str:
    """Return a condition for choosing one of several columns of times (N,), "" where they are of
    one clock: drive and displacement of different times do not belong together row by row."""
    begins = [np.asarray(values, dtype=np.float64) - float(values[0]) for values in times]
    near = SAME_STEP * float(np.median(np.abs(np.diff(begins[0]))))
    if all(np.allclose(begins[0], other, rtol=0.0, atol=near) for other in begins[1:]):
        first = [float(values[0]) for values in times]
        if len(set(first)) == 1 or abs(first[1] - first[0]) > abs(float(begins[0][-1])):
            return ""  # one clock from its own beginning, and one since 1970
    return (
        " if drive and displacement were both taken at these times; if each has its own, bring "
        "them to one column of times first"
    )


def same_time(times: Sequence[tuple[Any, float]]) -> int:
    """Return which of several columns of times to take if all give the same time, each from its own
    beginning or since 1970, within half a row: the finest; -1 if they do not. times: (N,) values,
    and seconds in a unit of them."""
    seconds = [np.asarray(values, dtype=np.float64) * scale for values, scale in times]
    begins = [values - values[0] for values in seconds]
    finest = max(range(len(begins)), key=lambda i: np.unique(begins[i]).size)
    length, rows = abs(float(begins[finest][-1])), begins[finest].size
    starts = [abs(float(values[0] - seconds[finest][0])) for values in seconds]
    apart = [float(np.max(np.abs(values - begins[finest]))) for values in begins]
    alike = all(gap <= 0.5 * length / rows for gap in apart)
    return finest if alike and all(not 0.0 < start <= length for start in starts) else -1


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


def unit_since_1970(first: float, heading: str) -> str:
    """Return the unit of times that begin at a moment of this century, where their heading says
    that they count from 1970 ("unix_time", "epoch"); "" otherwise."""
    named = read_heading(heading)
    if named.unit or named.stated or not words_of(heading) & _SINCE_1970:
        return ""
    return next((u for u, (low, high) in _BY_NAME.items() if low <= first < high), "")
