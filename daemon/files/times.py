"""Check the times of a file: cut where the clock went back, rebuild times that are only rounded.

Rows are never sorted. Where the clock goes back, something new begins (a recorder was restarted, or
two files were joined), and the time between the two parts is unknown.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dehyst.models.errors import BadRecording
from dehyst.models.recording import Bools, Floats
from dehyst.models.units import how_many

LEAST_DIGITS, OFF_THE_LINE = 50, 0.75
"""Limits in units of the last digit of rounded times. LEAST_DIGITS: least span, so that the mean
step is accurate to about one percent. OFF_THE_LINE: largest deviation from a straight line:
rounding moves each time by up to half a digit, truncation by up to half a digit about its mean."""
MOST_PARTS = 64
REVERSED, UNSORTED = 0.9, 0.2
"""Shares of rows at which the time goes back: above REVERSED the rows are in reverse order, above
UNSORTED in no order."""
SLOW_STEP_S = 1.0
"""The unit of larger steps is asked for: in seconds they are less than one row per second, in
milliseconds less than 1000. Recordings over hours at 1 or 2 Hz are ordinary."""
NOTED_STEP_S = 0.4


@dataclass
class Times:
    """t_s: (N,), increasing in each part; parts: [from, to) of rows; keep: rows that are kept,
    None: all; said: what was done."""

    t_s: Floats
    parts: list[tuple[int, int]]
    keep: Bools | None
    said: list[str]


def repair_times(
    name: str, t_s: Floats, same_row: Callable[[int], bool], where: Callable[[int], str]
) -> Times:
    """Cut and repair the times of a file.

    same_row(i): whether row i holds the same numbers as the previous row in all columns; where:
    describes the place of a row. Raises BadRecording if the times cannot be used.
    """
    said: list[str] = []
    if not np.all(np.isfinite(t_s)):
        row = int(np.flatnonzero(~np.isfinite(t_s))[0])
        raise BadRecording(
            f"{name}: {where(row)}: the time is missing: delete the line if it is not part of "
            "the recording, such as a mean; --rate HZ counts all rows"
        )
    steps = np.diff(t_s)
    if steps.size == 0 or bool(np.all(steps > 0.0)):
        return Times(t_s, [(0, t_s.size)], None, said)
    back = np.flatnonzero(steps < 0.0) + 1
    cuts = [0, *back.tolist(), t_s.size]
    if back.size > REVERSED * steps.size:
        raise BadRecording(
            f"{name}: the times fall from row to row, from {t_s[0]:.9g} to {t_s[-1]:.9g}: the "
            "newest row is first; reverse the order of the rows"
        )
    backs = how_many(back.size, "time")
    if back.size > UNSORTED * steps.size:
        raise BadRecording(
            f"{name}: {where(int(back[0]))}: the time goes back, and {backs} in all; is "
            "this the column of the time? --columns t=... names another; if it is, sort the rows "
            "by time"
        )
    if len(cuts) - 1 > MOST_PARTS:
        raise BadRecording(
            f"{name}: {where(int(back[0]))}: the time goes back, and {backs} in all; is "
            "this the column of the time? --columns t=... names another, --rate HZ counts the rows"
        )
    first, second = (t_s[begin:end] for begin, end in pairwise([*cuts, t_s.size][:3]))
    if np.array_equal(first, second) and first[0] > np.ptp(first):  # of a clock, not from 0 again
        raise BadRecording(
            f"{name}: at {where(cuts[1])} the same times come again: one channel is below the "
            "other; write each to a column of its own, next to one column of times"
        )
    out = t_s.copy()
    keep = np.ones(t_s.size, dtype=bool)
    for begin, end in pairwise(cuts):
        _settle_part(name, out, begin, end, keep, same_row, where, said)
    if back.size:
        places = ", ".join(where(int(row)) for row in back[:3]) + (", ..." if back.size > 3 else "")
        said.append(f"the clock went back at {places}: cut there into {len(cuts) - 1} parts")
    parts = list(pairwise(cuts))
    if bool(np.all(keep)):
        return Times(out, parts, None, said)
    before = np.concatenate([[0], np.cumsum(keep)])
    parts = [(int(before[a]), int(before[b])) for a, b in parts]
    return Times(out[keep], [(a, b) for a, b in parts if b > a], keep, said)


def _settle_part(
    name: str,
    t_s: Floats,
    begin: int,
    end: int,
    keep: Bools,
    same_row: Callable[[int], bool],
    where: Callable[[int], str],
    said: list[str],
) -> None:
    """Repair one part whose times do not go back: repeated times mean that rows are written twice,
    if they repeat all other columns as well, or else that the times are rounded."""
    part = t_s[begin:end]
    repeated = np.flatnonzero(np.diff(part) == 0.0) + 1
    if not repeated.size:
        return
    if all(same_row(begin + int(row)) for row in repeated):
        keep[begin + repeated] = False
        rows = how_many(repeated.size, "row that is", "rows that are")
        said.append(f"{rows} written twice left out")
        return
    rising = np.diff(part)
    quantum = float(rising[rising > 0.0].min()) if np.any(rising > 0.0) else 0.0
    even = np.linspace(0.0, 1.0, part.size)
    line = np.polynomial.Polynomial.fit(even, part, 1)
    straight = np.asarray(line(even))
    step = float(straight[-1] - straight[0]) / max(part.size - 1, 1)
    off = float(np.max(np.abs(part - straight)))
    if float(np.ptp(part)) >= LEAST_DIGITS * quantum and 0.0 < off <= OFF_THE_LINE * quantum:
        t_s[begin:end] = straight[0] + step * np.arange(part.size)
        said.append(
            f"the times are rounded to {quantum:.2g} s: rebuilt from their even step of "
            f"{step:.6g} s"
        )
        return
    if part.size == t_s.size and not np.any(rising):
        raise BadRecording(
            f"{name}: the time is {part[0]:.9g} in every row, as when a program writes each sample "
            "on its own: add --rate HZ (rows a second)"
        )
    row = begin + int(repeated[0])
    raise BadRecording(
        f"{name}: {where(row)}: the time does not increase ({t_s[row]:.9g} twice), and the rows "
        "are not evenly spaced; --rate HZ counts the rows instead"
    )


def doubt_seconds(name: str, t_s: Floats, said_by_user: bool) -> str:
    """Return a remark if the times may be milliseconds, "" otherwise. Raises BadRecording if they
    are unlikely to be seconds; said_by_user: --time-unit was given."""
    if said_by_user or t_s.size < 20:
        return ""
    step, whole = float(np.median(np.diff(t_s))), float(t_s[-1] - t_s[0])
    if step > SLOW_STEP_S * (1.0 + 1e-6):
        raise BadRecording(
            f"{name}: the rows lie {step:.4g} s apart, {whole:.4g} s in all; are the times in "
            "milliseconds? say --time-unit ms, or --time-unit s where they are seconds"
        )
    if step >= NOTED_STEP_S:
        return (
            f"the rows lie {step:.4g} s apart, {whole:.4g} s in all (--time-unit ms where these "
            "are milliseconds)"
        )
    return ""
