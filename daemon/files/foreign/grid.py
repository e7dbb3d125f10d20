"""Turn rows of fields, from a text or a sheet, into columns with headings: find where the numbers
begin, which line above them holds the names, which the units, and what else the preamble says."""

import math
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dehyst.daemon.files.csv_table import LARGEST, MOST_COLUMNS
from dehyst.daemon.files.foreign.fields import GROUPED, GROUPED_BY_POINTS, number_of
from dehyst.daemon.files.foreign.found import Column, Sheet
from dehyst.daemon.files.foreign.stated_step import stated_step
from dehyst.daemon.files.foreign.units import find_unit_key, split_heading
from dehyst.models.errors import BadRecording

LOOKED_AT = 2000
"""Rows at the beginning that are used to find the layout; an instrument's preamble is shorter."""
MOSTLY_EMPTY = 0.9
Row = Sequence[Any]


@dataclass
class GridLayout:
    """first: first row of numbers; width: number of columns; headings, units: (width,) texts;
    notes: the preamble; numeric: which columns hold numbers; step_s, start_s: stated by the
    preamble; decimal: the decimal mark; unclear: a field that leaves it open; header: the fields of
    the line with the headings; form: what else is to be said of the form."""

    first: int
    width: int
    headings: list[str]
    units: list[str]
    numeric: list[bool]
    notes: dict[str, str] = field(default_factory=dict)
    step_s: float = 0.0
    start_s: float = 0.0
    decimal: str = "."
    unclear: str = ""
    header: list[str] = field(default_factory=list)
    form: list[str] = field(default_factory=list)

    @property
    def most(self) -> int:
        """The most fields that a row may have."""
        return len(self.header) or self.width


def _values(row: Row, decimal: str) -> tuple[bool, ...]:
    """Return which fields of a row are numbers."""
    flags = []
    for cell in row:
        value = number_of(cell, decimal)
        flags.append(value is not None and not math.isnan(value))
    return tuple(flags)


def _length(row: Row) -> int:
    size = len(row)
    while size and (row[size - 1] is None or not str(row[size - 1]).strip()):
        size -= 1
    return size


def score(rows: Sequence[Row], decimal: str) -> tuple[int, int, int]:
    """Return (how much a layout explains of these rows, first row of numbers, number of
    columns)."""
    sizes = [_length(row) for row in rows]
    flags = [_values(row[:size], decimal) for row, size in zip(rows, sizes, strict=True)]
    runs: list[tuple[int, int, int]] = []
    begin = 0
    for i in range(len(rows) + 1):
        new = i == len(rows) or (i > begin and sizes[i] != sizes[begin])
        bad = i < len(rows) and 2 * sum(flags[i]) < max(1, sizes[i])
        if new or bad:
            if i > begin:
                gain = sum(3 * sum(f) - 2 * len(f) for f in flags[begin:i])
                runs.append((gain, begin, sizes[begin]))
            begin = i + 1 if bad else i
    gain, begin, width = max(runs, default=(0, 0, 0))
    if gain <= 0:
        return 0, 0, 0
    # rows before the longest run belong to it if they have numbers in the same columns
    share = [sum(f[j] for f in flags[begin:] if len(f) > j) for j in range(width)]
    sure = [
        j for j in range(width) if 2 * share[j] > share[max(range(width), key=share.__getitem__)]
    ]
    for i in range(begin):
        if sizes[i] <= max(sure) or not all(flags[i][j] for j in sure):
            continue
        if sizes[i] <= width + 1 or all(map(all, flags[i:begin])):  # or lines that were joined
            return gain, i, width
    return gain, begin, width


def find_decimal(rows: Sequence[Row], habit: str = "") -> tuple[str, str]:
    """Return (decimal mark, a field that leaves it open or ""). habit: the mark to take where all
    numbers leave it open ("12,586" is one number with a decimal comma and another with thousands
    apart), unless some have a point."""
    if not any(isinstance(cell, str) and "," in cell for row in rows for cell in row):
        return ".", ""
    gain, first, width = score(rows, ".")
    other = score(rows, ",")[0]
    if gain != other or not gain:
        return "." if gain >= other else ",", ""
    unclear = ""
    for j in range(width):
        cells = [str(row[j]).strip(" \"'") for row in rows[first:] if len(row) > j]
        grouped = next((cell for cell in cells if GROUPED.fullmatch(cell)), "")
        if grouped and any(re.fullmatch(r"[+-]?\d{1,3}", cell) for cell in cells):
            return ".", ""  # only numbers from 1000 on have a comma
        unclear = unclear or grouped
        habit = "" if any(map(GROUPED_BY_POINTS.fullmatch, cells)) else habit
    return (habit, "") if unclear and habit else (".", unclear)


def lay_out(name: str, rows: Sequence[Row], decimal: str) -> GridLayout:
    """Find the layout from the first rows; they may show that the decimal mark is a comma, or
    leave it open. Raises BadRecording if there are no numbers."""
    decimal, unclear = find_decimal(rows) if decimal == "." else (decimal, "")
    gain, first, width = score(rows, decimal)
    if not gain:
        raise BadRecording(f"{name}: holds no rows of numbers")
    if width > MOST_COLUMNS:
        raise BadRecording(f"{name}: {width} columns; at most {MOST_COLUMNS} are read")
    above = [(i, _stripped(row)) for i, row in enumerate(rows[:first]) if _length(row)]
    headings, units, used = [""] * width, [""] * width, set()
    header: list[str] = []
    step_s = start_s = 0.0
    if above and _are_units(above[-1][1][:width]) and len(above) > 1:
        below, over = above[-1][1], above[-2][1]
        if len(over) >= min(width, len(below)) > 0:
            units, used = _fit(below, width), {above[-1][0]}
            step_s, start_s = _beside(over, below, width)
            above.pop()
    if above and _may_name(above[-1][1], width, decimal):
        header = _texts(above[-1][1])
        headings = _fit(above[-1][1], width)
        used.add(above[-1][0])
    notes: dict[str, str] = {}
    left = [row for i, row in above if i not in used]
    for i, row in above:
        if i not in used and len(notes) < 200:
            cells = [str(cell).strip() for cell in row if cell is not None]
            key = cells[0].rstrip(":=").strip()[:60] or f"note{i + 1}"
            notes.setdefault(key, " ".join(cells[1:])[:200])
    if not step_s:
        step_s = next((step for row in left if (step := stated_step(_texts(row), decimal))), 0.0)
    flags = [_values(row[:width], decimal) for row in rows[first:]]
    most = max(sum(f[j] for f in flags if len(f) > j) for j in range(width))
    numeric = [
        sum(f[j] for f in flags if len(f) > j) > (1 - MOSTLY_EMPTY) * most for j in range(width)
    ]
    return GridLayout(
        first, width, _apart(headings), units, numeric, notes, step_s, start_s, decimal, unclear,
        header,
    )  # fmt: skip


def _stripped(row: Row) -> list[Any]:
    """Return a line without its comment mark."""
    cells = list(row[: _length(row)])
    if cells and isinstance(cells[0], str):
        cells[0] = re.sub(r"^\s*(#|%|//|!)+\s*", "", cells[0])
        if not cells[0] and len(cells) > 1 and str(row[0]).strip():
            cells.pop(0)
    return cells


def _texts(cells: Row) -> list[str]:
    return ["" if cell is None else str(cell).strip().strip("\"'").strip() for cell in cells]


def _fit(cells: Row, width: int) -> list[str]:
    return (_texts(cells) + [""] * width)[:width]


def _are_units(cells: Row) -> bool:
    texts = [str(cell).strip().strip("\"'") for cell in cells if cell is not None]
    texts = [text for text in texts if text]
    known = [text for text in texts if find_unit_key(text) or text.lower() == "sequence"]
    return bool(known) and 2 * len(known) > len(texts)


def _may_name(cells: Row, width: int, decimal: str) -> bool:
    if not width - 1 <= len(cells) <= width + 2:
        return False
    return any(number_of(cell, decimal) is None for cell in cells[:width])


def _beside(over: Row, below: Row, width: int) -> tuple[float, float]:
    """Return the increment and start given next to the headings, as some oscilloscopes write
    them."""
    names = [str(cell).strip().lower() for cell in over]
    out = []
    for name in ("increment", "start"):
        at = names.index(name) if name in names else -1
        value = number_of(below[at]) if width <= at < len(below) else None
        out.append(value if value is not None and math.isfinite(value) else 0.0)
    return out[0], out[1]


def _apart(headings: Sequence[str]) -> list[str]:
    """Make headings unique."""
    out: list[str] = []
    for heading in headings:
        number, text = 2, heading
        while text and text in out:
            text, number = f"{heading}.{number}", number + 1
        out.append(text)
    return out


def fill(
    name: str,
    layout: GridLayout,
    rows: Iterable[tuple[int, Row]],
    where: Callable[[int], str],
) -> Sheet:
    """Return the columns below a layout. rows: (place, fields); where: describes a place. Raises
    BadRecording naming the place of a field that is not a number."""
    decimal = layout.decimal
    if layout.unclear:
        raise BadRecording(
            f"{name}: '{layout.unclear}' may have a decimal comma, or thousands set apart, and no "
            "other number shows which: write it with a decimal point, or with no mark for thousands"
        )
    kept = [j for j in range(layout.width) if layout.numeric[j]]
    values: list[list[float]] = [[] for _ in kept]
    places: list[int] = []
    texts = clocks = 0
    clock = [False] * layout.width
    needed = max(kept) + 1
    for place, row in rows:
        size = _length(row)
        if not size:
            continue
        numbers = [number_of(row[j], decimal) if j < size else math.nan for j in kept]
        if all(v is None or math.isnan(v) for v in numbers):
            texts += any(v is None for v in numbers)
            refuse_other_headings(name, layout, row, where(place))
            continue
        if len(row) < needed or size > layout.most:
            there = "the headings are" if layout.header else "the other lines have"
            raise BadRecording(
                f"{name}: {where(place)} has {size} fields, {there} {layout.most}: a field too "
                f"{'few' if size < layout.most else 'many'}, or lines joined or broken"
            )
        for part, j, value in zip(values, kept, numbers, strict=True):
            if value is None or (abs(value) > LARGEST and not math.isinf(value)):
                shown = str(row[j])[:20]
                what = layout.headings[j] or f"column {j}"
                raise BadRecording(f"{name}: {where(place)}: {what} is {shown!r}, not a number")
            part.append(value)
            if not clocks and not isinstance(row[j], int | float) and ":" in str(row[j]):
                clock[j] = True
        clocks = 1
        places.append(place)
    found = Sheet(
        [
            Column(layout.headings[j], np.array(part), layout.units[j], clock[j])
            for part, j in zip(values, kept, strict=True)
        ],
        layout.notes,
        layout.step_s,
        layout.start_s,
        where=lambda row: where(places[row]) if row < len(places) else f"row {row + 1}",
    )
    note_form(found, layout, texts)
    return found


def refuse_other_headings(name: str, layout: GridLayout, row: Row, place: str) -> None:
    """Raise BadRecording if a line of text between the numbers holds headings or units, but not
    those above the numbers."""
    cells = _texts(_stripped(row))
    if cells in (layout.header, [unit for unit in layout.units if unit]):
        return
    known = sum(cell in layout.header for cell in cells if cell)
    named = [cell for cell in cells if not re.search(r"(?<!\w)\d", cell)]  # not "moved by 5 um"
    measured = sum(bool(split_heading(cell)[1]) for cell in named)
    if known > 1 or (measured > 1 and 2 * measured > len(cells)):
        shown = ", ".join(cells)[:60]
        raise BadRecording(
            f"{name}: {place} holds other headings ({shown}) than the first line of headings: cut "
            "the file there into two"
        )


def note_form(found: Sheet, layout: GridLayout, texts: int) -> None:
    """Add remarks on the format."""
    if layout.notes:
        lines = "1 line" if len(layout.notes) == 1 else f"{len(layout.notes)} lines"
        found.said.append(f"{lines} before the headings kept as notes")
    left = [
        layout.headings[j] or f"column {j}" for j in range(layout.width) if not layout.numeric[j]
    ]
    left = [f"'{text}'" for text, j in zip(left, range(99), strict=False) if text]
    if left and any(layout.headings):
        found.said.append(f"without numbers and left out: {', '.join(left[:5])}")
    if texts:
        found.said.append(f"{texts} lines of text between the numbers left out")
    found.said += layout.form
    if layout.decimal == ",":
        found.said.append("decimal commas")
