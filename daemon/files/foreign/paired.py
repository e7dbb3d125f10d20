"""Read the lines above the numbers in which each channel has a label and a value, as TwinCAT's
Scope writes them: "Name,fDrive,Name,fGauge" over a column of times for each channel, or
"Name,fDrive,fGauge" over one for all; or those that name the source of each channel, as the
oscilloscopes of GW Instek write them."""

import math
import re
from collections.abc import Sequence
from itertools import zip_longest

from dehyst.daemon.files.foreign.fields import number_of

HEAD, LOOKED_AT = 60, 1000
OF_SCOPE = {"Memory Length", "Source", "Sampling Period"}
"""Labels above the numbers of GW Instek's oscilloscopes; others depend on the model."""
_STEP = re.compile(r"SampleTime\s*\[(\w+)\]")
_TICKS = re.compile(r"1[2-4]\d{16}(?=\D)")  # of 100 ns since 1601: of the years 1981 to 2076


def name_pairs(lines: list[str]) -> None:
    """Put one line of names, with their units, in place of such lines; leave others as they are."""
    _name_sources(lines)
    for mark in (",", ";", "\t"):
        for shared in (False, True):
            if _name_channels(lines, mark, shared):
                return


def _name_channels(lines: list[str], mark: str, shared: bool) -> bool:
    """Put one line of names in place of TwinCAT's; return whether they are such lines. shared: all
    channels have one column of times, and each line its label only once."""
    head = [[cell.strip() for cell in line.split(mark)] for line in lines[:HEAD]]
    begin = max((i for i, cells in enumerate(head) if shared and cells[0] == "Name"), default=0)
    end = next((i for i in range(begin, len(head)) if _is_number(head[i][0])), len(head))
    fits = _repeats_its_label if not shared else _has_a_label
    labelled = {i: head[i] for i in range(begin, end) if fits(head[i])}
    of = {cells[0]: cells[1:] if shared else cells[1::2] for cells in labelled.values()}
    step = next(filter(None, map(_STEP.fullmatch, of)), None)
    names, units = of.get("Name", []), of.get("Unit", [])
    if step is None or not names or {len(values) for values in of.values()} != {len(names)}:
        return False
    if shared and (end == len(head) or len(head[end]) != len(names) + 1):
        return False
    kept = [label for label, values in of.items() if _scales(label, values)]
    notes = [mark.join([f"Scale factor ({label})", *of[label]]) for label in kept]
    for i in labelled:
        lines[i] = notes.pop() if notes else ""
    whole = [f"{n} [{u}]" for n, u in zip(names, units or [""] * len(names), strict=True)]
    whole = [name.removesuffix(" []").removesuffix(" [(None)]") for name in whole]
    if shared:
        unit = _count_ticks(lines, end, mark) or step[1]
        lines[max(labelled)] = mark.join([f"Time [{unit}]", *whole])
    else:
        lines[max(labelled)] = mark.join(f"Time [{step[1]}]{mark}{name}" for name in whole)
    return True


def _count_ticks(lines: list[str], first: int, mark: str) -> str:
    """Put ns since the first row in place of Windows' ticks of 100 ns since 1601. Return that unit,
    "" if the times are no such ticks."""
    if not _TICKS.match(lines[first]):
        return ""
    begin = int(lines[first].partition(mark)[0])
    for i in range(first, len(lines)):
        if _TICKS.match(lines[i]):
            ticks, _, rest = lines[i].partition(mark)
            lines[i] = f"{100 * (int(ticks) - begin)}{mark}{rest}"
    return "ns"


def _scales(label: str, values: Sequence[str]) -> bool:
    """Return whether a line states a factor, or an offset other than 0."""
    words = label.lower()
    offset = "offset" in words and not words.startswith("index")  # an address in the controller
    return "scale" in words or (offset and any(v.strip("+-0.") for v in values))


def _repeats_its_label(cells: Sequence[str]) -> bool:
    """Return whether these fields repeat one label before each value."""
    alike = len(cells) > 3 and len(cells) % 2 == 0 and len(set(cells[::2])) == 1
    return alike and cells[0][:1].isalpha()


def _has_a_label(cells: Sequence[str]) -> bool:
    """Return whether a label stands before several values."""
    return len(cells) > 2 and cells[0][:1].isalpha()


def _name_sources(lines: list[str]) -> None:
    """Name the columns below a preamble that gives the source of each channel: "Source,CH1" above
    "Mode,Detail", where each channel has its times, or "Mode,Fast", where there are none."""
    rows = [[cell.strip() for cell in line.rstrip(", \t").split(",")] for line in lines[:HEAD]]
    first = next((i for i, row in enumerate(rows) if _is_number(row[0])), len(rows))
    place = {row[0]: i for i, row in enumerate(rows[:first])}
    if first == len(rows) or not place.keys() >= OF_SCOPE:
        return
    of = {label: _values(rows[i]) for label, i in place.items()}
    mode = next(iter(of.get("Mode", [])), "").lower()
    cells = re.findall(r"[^\s,]+", " ".join(lines[first : first + LOOKED_AT]))
    if mode == "fast" and all(cell.lstrip("+-").isdigit() for cell in cells):
        of["Vertical Units"] = ["counts"] * len(of["Source"])  # of the converter, not yet in volts
    pairs = zip_longest(of["Source"], of.get("Vertical Units", []), fillvalue="")
    names = [f"{source} [{unit}]".removesuffix(" []") for source, unit in pairs]
    time = f"Time [{next(iter(of.get('Horizontal Units', [])), 's')}]"
    at = [j for j, cell in enumerate(lines[first].split(",")) if cell.strip()]
    ways = [] if mode == "detail" else [names]
    if mode != "fast":
        ways += [[time, *names], [text for name in names for text in (time, name)]]
    if fitting := [way for way in ways if len(way) == len(at)]:
        named = dict(zip(at, fitting[0], strict=True))
        lines[place["Memory Length"]] = lines[first - 1]
        lines[first - 1] = ",".join(named.get(j, "") for j in range(at[-1] + 1))


def _values(row: Sequence[str]) -> Sequence[str]:
    """Return the values behind a label, which may be repeated before each."""
    return row[1::2] if len(row) > 2 and set(row[::2]) == {row[0]} else row[1:]


def _is_number(cell: str) -> bool:
    value = number_of(cell)
    return value is not None and math.isfinite(value)
