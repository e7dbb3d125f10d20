"""Read LabVIEW's text (.lvm): each segment has a header of its own, which states the units and,
where the times are not written, their beginning and step."""

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from dehyst.daemon.files.foreign.counted import UNSET_S, number_rows
from dehyst.daemon.files.foreign.fields import number_of
from dehyst.daemon.files.foreign.found import Column, Sheet
from dehyst.daemon.files.foreign.units import find_unit_key, read_heading
from dehyst.models.errors import BadRecording

END = "***End_of_Header***"
SEPARATED = {"tab": "\t", "comma": ","}
_X_VALUE = re.compile(r"X_Value(\.\d+)?")
Header = dict[str, list[str]]
Reader = Callable[[str, int, str, str], Sheet]


def is_lvm(lines: Sequence[str]) -> bool:
    ends = sum(line.startswith(END) for line in lines)
    return lines[0].startswith("LabVIEW Measurement") and ends > 1


def read_lvm(name: str, lines: Sequence[str], read: Reader) -> Sheet:
    """Return the columns of all segments, one below the other. read: returns the columns of (a
    text, the number of lines above it, its separator, its decimal mark)."""
    ends = [i for i, line in enumerate(lines) if line.startswith(END)]
    separator = next((s for s in "\t," if f"Separator{s}" in "\n".join(lines[: ends[0]])), "\t")
    file = _header(lines[: ends[0]], separator)
    separator = SEPARATED.get(_first(file, "Separator").lower(), separator)
    between = [(last, end) for last, end in pairwise(ends) if last != ends[0]]
    begins = [ends[0] + 1, *(_begin(lines, last, end, separator) for last, end in between)]
    parts: list[Sheet] = []
    places: list[int] = []
    notes: Header = {}
    for begin, end, after in zip(begins, ends[1:], [*begins[1:], len(lines)], strict=True):
        if sum(bool(line.strip()) for line in lines[end + 1 : after]) < 2:
            continue  # begun, but without a row
        places.append(end + 2)
        header = _header(lines[begin:end], separator)
        notes = notes or file | header
        part = read(
            "\n".join(lines[end + 1 : after]), end + 1, separator, _first(file, "Decimal_Separator")
        )
        _add_times(part, header, _first(file, "X_Columns"))
        _add_units(part, header)
        parts.append(part)
    if not parts:
        raise BadRecording(f"{name}: holds no rows of numbers")
    return _joined(name, parts, places, {key: " ".join(c)[:200] for key, c in notes.items()})


def _header(lines: Sequence[str], separator: str) -> Header:
    rows = [line.rstrip(separator).split(separator) for line in lines]
    return {row[0]: [cell.strip() for cell in row[1:]] for row in rows if row[0].strip()}


def _first(header: Header, key: str) -> str:
    return next(iter(header.get(key, [])), "")


def _begin(lines: Sequence[str], last: int, end: int, separator: str) -> int:
    """Return the first line of the header that ends at a line, after the end of the last one."""
    first = f"Channels{separator}"
    return next((i for i in range(end, last, -1) if lines[i].startswith(first)), end)


def _numbers(header: Header, key: str) -> list[float | None]:
    cells = [cell for cell in header.get(key, []) if cell]
    return [number_of(cell, "," if "," in cell else ".") for cell in cells]


def _add_times(part: Sheet, header: Header, x_columns: str) -> None:
    """Put the times that the header states in front of the columns, where none are written, or give
    each channel its own, where they differ. Where times are written, keep the period, which may
    have more digits than they have."""
    begins, steps = _numbers(header, "X0"), _numbers(header, "Delta_X")
    timed = set(header.get("X_Dimension", [])) <= {"Time", ""}
    channels = [c for c in part.columns if not _X_VALUE.fullmatch(c.heading)]
    waves = [(b, s) for b, s in zip(begins, steps, strict=False) if b is not None and s]
    if timed and x_columns != "One" and len(set(waves)) > 1 and len(waves) == len(channels):
        part.said = [text for text in part.said if not text.endswith(": 'X_Value'")]
        part.columns, part.start_s = channels, min(begin for begin, _ in waves)
        for column, wave in zip(channels, waves, strict=True):
            column.wave = wave
    elif x_columns == "No" and timed and len(set(begins)) == len(set(steps)) == 1:
        begin, step = begins[0], steps[0]
        if begin is not None and step is not None and step > 0.0:
            times = begin + step * number_rows(len(part.columns[0].values), part)
            part.said = [text for text in part.said if not text.endswith(": 'X_Value'")]
            part.columns.insert(0, Column("X_Value", times, "s", number=0))
    elif timed:
        step = next(iter(steps), None) or 0.0
        if len(set(steps)) == 1 and step > 0.0 and step != UNSET_S:
            part.step_s = step
        for column in part.columns:
            if _X_VALUE.fullmatch(column.heading):
                column.unit = column.unit or "s"


def _add_units(part: Sheet, header: Header) -> None:
    """Give each channel the unit in the header, unless its heading states the same, or states one
    and the header none that is known. Words in brackets, "Voltage (DC)", are part of the name."""
    units = header.get("Y_Unit_Label", [])
    channels = [c for c in part.columns if not _X_VALUE.fullmatch(c.heading)]
    of = channels if len(units) == len(channels) else part.columns  # with a field for each time
    above = {number: unit for number, unit in enumerate(units, 1) if unit}
    if len(units) == len(of):
        named = list(zip(of, units, strict=True))
    elif above.keys() <= (numbers := {c.number for c in channels}) and 0 not in numbers:
        named = [(c, above.get(c.number, "")) for c in channels]  # each unit is above its column
    else:
        named = []
    for column, unit in named:
        own, known = read_heading(column.heading).unit, find_unit_key(unit)
        column.unit = column.unit or ("" if own and known in ("", own) else unit)


def _joined(
    name: str, parts: Sequence[Sheet], places: Sequence[int], notes: dict[str, str]
) -> Sheet:
    """Return the parts as one. Raises BadRecording if they hold different channels."""
    first = parts[0]
    for part, place in zip(parts, places, strict=True):
        if [(c.heading, c.unit) for c in part.columns] != [
            (c.heading, c.unit) for c in first.columns
        ]:
            raise BadRecording(
                f"{name}: line {place}: this segment holds other channels than the first one: cut "
                "the file there into two"
            )
    if len(parts) > 1 and any(column.wave for column in first.columns):
        raise BadRecording(
            f"{name}: its channels begin at different times, in {len(parts)} segments: cut the "
            "file into one for each segment"
        )
    sizes = np.cumsum([0] + [len(part.columns[0].values) for part in parts])

    def where(row: int) -> str:
        at = min(int(np.searchsorted(sizes, row, "right")) - 1, len(parts) - 1)
        return parts[at].where(row - int(sizes[at]))

    columns = [
        replace(c, values=np.concatenate([part.columns[j].values for part in parts]))
        for j, c in enumerate(first.columns)
    ]
    said = [*first.said, *([f"{len(parts)} segments"] if len(parts) > 1 else [])]
    steps = {part.step_s for part in parts}
    step_s = steps.pop() if len(steps) == 1 else 0.0
    return Sheet(columns, notes, step_s, first.start_s, said=said, where=where)
