"""Read the lines above the numbers in which each channel has a label and a value, as TwinCAT's
Scope writes them: "Name,fDrive,Name,fGauge" over a column of times for each channel; or those that
name the source of each channel, as the oscilloscopes of GW Instek write them."""

import math
import re
from collections.abc import Sequence
from itertools import zip_longest

from dehyst.daemon.files.foreign.fields import number_of

HEAD = 60
OF_SCOPE = {"Memory Length", "Source", "Sampling Period"}
"""Labels above the numbers of GW Instek's oscilloscopes; others depend on the model."""
_STEP = re.compile(r"SampleTime\s*\[(\w+)\]")


def name_pairs(lines: list[str]) -> None:
    """Put one line of names, with their units, in place of such lines; leave others as they are."""
    _name_sources(lines)
    for mark in (",", ";", "\t"):
        labelled = {
            i: cells for i, line in enumerate(lines[:HEAD]) if (cells := _paired(line, mark))
        }
        of = {cells[0]: cells[1::2] for cells in labelled.values()}
        step = next(filter(None, map(_STEP.fullmatch, of)), None)
        names, units = of.get("Name", []), of.get("Unit", [])
        if step is None or not names or {len(values) for values in of.values()} != {len(names)}:
            continue
        kept = [cells for cells in labelled.values() if _scales(cells)]
        notes = [mark.join([f"Scale factor ({cells[0]})", *cells[1::2]]) for cells in kept]
        for i in labelled:
            lines[i] = notes.pop() if notes else ""
        whole = [f"{n} [{u}]" for n, u in zip(names, units or [""] * len(names), strict=True)]
        lines[max(labelled)] = mark.join(
            f"Time [{step[1]}]{mark}{name.removesuffix(' []')}" for name in whole
        )


def _scales(cells: Sequence[str]) -> bool:
    """Return whether a line states a factor, or an offset other than 0."""
    label = cells[0].lower()
    return "scale" in label or ("offset" in label and any(v.strip("+-0.") for v in cells[1::2]))


def _paired(line: str, mark: str) -> Sequence[str]:
    """Return the fields of a line that repeats one label before each value, () of any other."""
    cells = [cell.strip() for cell in line.split(mark)]
    alike = len(cells) > 3 and len(cells) % 2 == 0 and len(set(cells[::2])) == 1
    return cells if alike and cells[0][:1].isalpha() else ()


def _name_sources(lines: list[str]) -> None:
    """Name the columns below a preamble that gives the source of each channel: "Source,CH1" above
    "Mode,Detail", where each channel has its times, or "Mode,Fast", where there are none."""
    rows = [[cell.strip() for cell in line.rstrip(", \t").split(",")] for line in lines[:HEAD]]
    first = next((i for i, row in enumerate(rows) if _is_number(row[0])), len(rows))
    place = {row[0]: i for i, row in enumerate(rows[:first])}
    if first == len(rows) or not place.keys() >= OF_SCOPE:
        return
    of = {label: _values(rows[i]) for label, i in place.items()}
    pairs = zip_longest(of["Source"], of.get("Vertical Units", []), fillvalue="")
    names = [f"{source} [{unit}]".removesuffix(" []") for source, unit in pairs]
    time = f"Time [{next(iter(of.get('Horizontal Units', [])), 's')}]"
    at = [j for j, cell in enumerate(lines[first].split(",")) if cell.strip()]
    mode = next(iter(of.get("Mode", [])), "").lower()
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
