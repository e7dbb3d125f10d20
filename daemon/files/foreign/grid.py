"""Turn rows of fields, from a text or a sheet, into columns with headings: find where the numbers
begin, which line above them holds the names, which the units, and what else the preamble says."""

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from dehyst.daemon.files.csv_table import LARGEST, MOST_COLUMNS
from dehyst.daemon.files.foreign.affixes import unit_behind
from dehyst.daemon.files.foreign.beside import UNIT_FIELDS, factor_in_words
from dehyst.daemon.files.foreign.epochs import count_from_first, epoch_unit, is_rising
from dehyst.daemon.files.foreign.fields import marks_in, moment_of, number_of
from dehyst.daemon.files.foreign.found import Column, Sheet
from dehyst.daemon.files.foreign.headings import (
    AT_THE_RIGHT,
    Numbers,
    Row,
    add_units,
    apart,
    find_names,
    gcs_header,
    texts_of,
    without_mark,
)
from dehyst.daemon.files.foreign.long import refuse_long, without_annotations
from dehyst.daemon.files.foreign.runs import (
    MISSING,
    NUMBER,
    TEXT,
    find_decimal,
    keep_note,
    kinds_of,
    length_of,
    score,
)
from dehyst.daemon.files.foreign.stated_step import SAME_STEP, stated_step
from dehyst.daemon.files.foreign.units import find_unit_key, split_heading
from dehyst.models.errors import BadRecording
from dehyst.models.units import how_many

TURNED = (
    "; if each channel has a line of its own, transpose the file, so that each sample has one "
    "(with numpy: savetxt(FILE, transpose([t, u, y])))"
)
LOOKED_AT = 2000
"""Rows at the beginning that are used to find the layout; an instrument's preamble is shorter."""
MOSTLY_TEXT = 0.9


@dataclass
class GridLayout:
    """first: first row of numbers; width: number of columns; headings, units: (width,) texts;
    numeric: which columns hold numbers; late: which of these were empty in the rows that were
    looked at; notes: the preamble; step_s, start_s: stated by the preamble; decimal: the decimal
    mark; unclear: a field that leaves it open; header: the fields of the line with the headings;
    form: further remarks on the format; unit_texts: columns that repeat in each row the unit of the
    numbers to their left; texts: for columns without numbers, the first field that begins like one;
    aside: columns of a small table at the right of the recording; remarks: texts between the
    numbers and below them, which may state a unit or a factor as the preamble may."""

    first: int
    width: int
    headings: list[str]
    units: list[str]
    numeric: list[bool]
    late: list[bool]
    notes: dict[str, str] = field(default_factory=dict)
    step_s: float = 0.0
    start_s: float = 0.0
    decimal: str = "."
    unclear: str = ""
    header: list[str] = field(default_factory=list)
    form: list[str] = field(default_factory=list)
    unit_texts: dict[int, str] = field(default_factory=dict)
    texts: dict[int, str] = field(default_factory=dict)
    aside: list[int] = field(default_factory=list)
    remarks: dict[str, str] = field(default_factory=dict)

    def take_units(self, units: Mapping[int, str]) -> None:
        """Add the units that the fields of columns repeated to those of the lines above them."""
        for j, unit in ((j, unit) for j, unit in units.items() if j < self.width):
            other = self.units[j] if find_unit_key(self.units[j]) != find_unit_key(unit) else ""
            self.units[j] = f"{other} and {unit}" if other else unit


def lay_out(
    name: str,
    rows: Sequence[Row],
    decimal: str,
    split: Callable[[int], list[list[str]]] | None = None,
) -> GridLayout:
    """Find the layout from the first rows; they may show that the decimal mark is a comma, or
    leave it open. split: returns the ways to read a line of names, if blanks separate. Raises
    BadRecording if there are no numbers."""
    rows = without_annotations(name, rows)
    decimal, unclear = find_decimal(rows) if decimal == "." else (decimal, "")
    gain, first, width = score(rows, decimal)
    if not gain:
        raise BadRecording(f"{name}: holds no rows of numbers")
    if width > MOST_COLUMNS:
        raise BadRecording(f"{name}: {width} columns; at most {MOST_COLUMNS} are read{TURNED}")
    above = [(i, row) for i, row in enumerate(rows[:first]) if length_of(row)]
    kinds = [kinds_of(row, decimal) for row in rows[first:]]
    own = _width_of_most(kinds, width)
    found = find_names(above, _numbers(rows[first:], kinds, own, decimal), split)
    beside = [""] * (width - len(found.headings))
    found.headings, found.units = found.headings + beside, found.units + beside
    notes: dict[str, str] = {}
    left = [(i, without_mark(row)) for i, row in above if i not in found.lines]
    for i, row in left:
        keep_note(notes, row, f"line {i + 1}")
    names, step_s = gcs_header(above, width)
    found.headings[: len(names)] = names
    add_units(found, [row for _, row in left])
    step_s = step_s or found.step_s
    stated = [step for cells in _with_their_units(left) if (step := stated_step(cells, decimal))]
    if stated and max(stated) <= (1.0 + SAME_STEP) * min(stated):  # otherwise they contradict
        step_s = step_s or stated[0]
    width = len(found.headings)
    numbers, texts = (
        [sum(k[j] == kind for k in kinds if len(k) > j) for j in range(width)]
        for kind in (NUMBER, TEXT)
    )
    late = [bool(found.headings[j]) and not numbers[j] and not texts[j] for j in range(width)]
    numeric = [
        late[j] or numbers[j] > ((1 - MOSTLY_TEXT) * max(numbers) if texts[j] else 0)
        for j in range(width)
    ]
    aside = [j for j in range(own, width) if numeric[j] and not found.headings[j]]
    aside = [j for j in aside if any(found.headings) and 2 * numbers[j] <= max(numbers)]
    numeric = [of and j not in aside for j, of in enumerate(numeric)]
    refuse_long(name, rows[first:], numeric, found.headings)
    unit_texts = _units_in_rows(rows[first:], numeric)
    for j, unit in unit_texts.items():
        found.units[j - 1] = found.units[j - 1] or unit
    return GridLayout(
        unit_texts=unit_texts,
        texts=_like_numbers(rows[first:], numeric),
        aside=aside,
        first=first,
        width=width,
        headings=apart(found.headings),
        units=found.units,
        numeric=numeric,
        late=late,
        notes=notes,
        step_s=step_s,
        start_s=found.start_s,
        decimal=decimal,
        unclear=unclear,
        header=found.header,
    )


def _width_of_most(kinds: Sequence[Sequence[int]], width: int) -> int:
    """Return the number of columns up to the last one that holds numbers in most rows."""
    rows = sum(NUMBER in kind for kind in kinds)
    return max(
        (
            j + 1
            for j in range(width)
            if 2 * sum(len(kind) > j and kind[j] == NUMBER for kind in kinds) > rows
        ),
        default=width,
    )


def _with_their_units(lines: Sequence[tuple[int, Row]]) -> list[list[str]]:
    """Return the fields of the preamble's lines; those of two fields with the unit that the next
    line gives alone ("Sampling rate,1" above "Unit,kHz"), and Yokogawa's resolution of time with
    the unit of its own line ("HResolution,1.0e-03,1.0e-03", "HUnit,s,s")."""
    cells = [texts_of(row) for _, row in lines]
    units = {unit for one in cells if one[:1] == ["HUnit"] for unit in one[1:]}
    for here in cells:
        if here[:1] == ["HResolution"] and len(units) == 1:
            here[:] = ["Sample interval", *here[1:2], *units, *here[2:]]
    for here, below in pairwise(cells):
        if len(here) == len(below) == 2 and below[0].rstrip(":=").strip().lower() in UNIT_FIELDS:
            here.append(below[1])
    return cells


def _like_numbers(rows: Sequence[Row], numeric: Sequence[bool]) -> dict[int, str]:
    """Return the first field that begins like a number ("706.9m") of each column without
    numbers."""
    first = {
        j: [str(row[j]).strip() for row in rows if len(row) > j][:1] for j in range(len(numeric))
    }
    return {
        j: text
        for j, texts in first.items()
        for text in texts
        if not numeric[j] and re.match(r"[-+]?[.,]?\d", text)
    }


def _units_in_rows(rows: Sequence[Row], numeric: Sequence[bool]) -> dict[int, str]:
    """Return the unit in each column of texts that repeats one in every row, next to numbers."""
    out = {}
    for j in range(1, len(numeric)):
        if not numeric[j] and numeric[j - 1]:
            texts = {str(row[j]).strip() for row in rows if length_of(row) > j}
            if texts and all(map(find_unit_key, texts)):
                out[j] = min(texts)
    return out


def _numbers(
    rows: Sequence[Row], kinds: Sequence[Sequence[int]], width: int, decimal: str
) -> Numbers:
    """Return the numbers that the names have to fit."""
    counted = [number_of(row[0], decimal) for row in rows if row]
    counts = counted[0] in (0.0, 1.0) and counted == [counted[0] + i for i in range(len(counted))]
    most = min(len(row) for row, kind in zip(rows, kinds, strict=True) if NUMBER in kind)
    empty = all(kind[0] == MISSING for kind in kinds if kind)
    return Numbers(width, max(width, most), counts, empty, decimal)


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
        mark = "comma" if "," in layout.unclear else "point"
        raise BadRecording(
            f"{name}: '{layout.unclear}' may have a decimal {mark}, or thousands set apart, and no "
            "other number shows which: write it with a decimal point, or with no mark for thousands"
            + (", and the other numbers with decimal points, too" if mark == "point" else "")
        )
    kept = [j for j in range(layout.width) if layout.numeric[j]]
    values: list[list[float]] = [[] for _ in kept]
    places: list[int] = []
    empty: list[int] = []
    words: dict[int, list[tuple[int, Any]]] = {}
    first: dict[int, int] = {}
    texts = clocks = 0
    clock = [False] * layout.width
    needed = max((j for j in kept if not layout.late[j]), default=0) + 1
    for place, row in rows:
        size = length_of(row)
        if not size:
            empty += [len(places)] * (len(row) > 1)
            continue
        numbers = [number_of(row[j], decimal) if j < size else math.nan for j in kept]
        if all(v is None or math.isnan(v) for v in numbers):
            texts += any(v is None for v in numbers)
            if TEXT in kinds_of(row, decimal):
                note_text(name, layout, row, where(place))
            continue
        for j, unit in layout.unit_texts.items():
            if j < size and str(row[j]).strip() != unit:
                raise BadRecording(
                    f"{name}: {where(place)}: the unit is {str(row[j]).strip()[:20]!r}, in other "
                    f"lines {unit!r}: write all values of this column in one unit"
                )
        if len(row) < needed or size > layout.width:
            there = "the headings are" if layout.header else "the other lines have"
            raise BadRecording(
                f"{name}: {where(place)} has {size} fields, {there} {layout.width}: one field too "
                f"{'few' if size < layout.width else 'many'}, or lines joined or broken; correct "
                "the line, or delete it if it is not part of the recording"
            )
        for part, j, value in zip(values, kept, numbers, strict=True):
            if value is None and layout.late[j]:  # a column of notes, as far as is known
                words.setdefault(j, []).append((place, row[j]))
                value = math.nan
            if j in first or (value is not None and LARGEST < abs(value) < math.inf):
                missing = value is not None and math.isnan(value)
                counted = count_from_first(row[j], j, first, not part)
                value = math.nan if missing else value if j not in first else counted
            if value is None:
                raise _no_number(name, layout, j, where(place), row[j])
            part.append(value)
            if not clocks and j < size and not isinstance(row[j], int | float):
                clock[j] = moment_of(str(row[j]).strip(" \"'")) is not None
        clocks = 1
        places.append(place)
    columns = {}
    for j, part in zip(kept, values, strict=True):
        columns[j] = np.array(part)
        noted = words.get(j, [])
        if 0 < len(noted) < np.count_nonzero(np.isfinite(columns[j])):
            raise _no_number(name, layout, j, where(noted[0][0]), noted[0][1])
    for j, value in first.items():
        if not is_rising(columns[j]):
            raise _no_number(name, layout, j, where(places[0]), value)
        layout.units[j] = layout.units[j] or epoch_unit(value, layout.headings[j])
        layout.form.append(f"{layout.headings[j] or f'column {j}'} counted from {value}")
    found = sheet_of(
        layout,
        columns,
        clock,
        lambda row: where(places[row]) if row < len(places) else f"row {row + 1}",
        texts,
    )
    found.empty = [before for before in empty if 0 < before < len(places)]
    return found


def _no_number(name: str, layout: GridLayout, j: int, place: str, cell: Any) -> BadRecording:
    what = layout.headings[j] or f"column {j}"
    return BadRecording(
        f"{name}: {place}: {what} is {str(cell)[:20]!r}, not a number{marks_in(cell)}: empty "
        "the field where a value is missing, or delete the line if it is not part of the "
        "recording, such as a sum"
    )


def sheet_of(
    layout: GridLayout,
    columns: Mapping[int, Any],
    clock: Sequence[bool],
    where: Callable[[int], str],
    texts: int,
) -> Sheet:
    """Return columns (number -> values) as a sheet, without those in which no number was found."""
    for j in range(layout.width):
        none = layout.late[j] and j in columns and bool(np.all(np.isnan(columns[j])))
        layout.numeric[j] &= j in columns and not none
    notes = dict(layout.notes)
    for key, text in layout.remarks.items():
        notes[f"{key} (again)" if key in notes else key] = text
    found = Sheet(
        [
            Column(layout.headings[j], values, layout.units[j], clock[j], j)
            for j, values in columns.items()
            if layout.numeric[j]
        ],
        notes,
        layout.step_s,
        layout.start_s,
        where=where,
        factor=factor_in_words(notes),
    )
    found.blank = {
        h: layout.texts.get(j, "")
        for j, (h, of) in enumerate(zip(layout.headings, layout.numeric, strict=True))
        if h and not of
    }
    note_form(found, layout, texts)
    return found


def note_text(name: str, layout: GridLayout, row: Row, place: str) -> None:
    """Keep a line of text between the numbers. Raises BadRecording if it holds headings or units
    other than those above the numbers."""
    cells = texts_of(without_mark(row))
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
    keep_note(layout.remarks, row, place)


def note_form(found: Sheet, layout: GridLayout, texts: int) -> None:
    """Add remarks on the format."""
    if layout.notes:
        found.said.append(
            f"{how_many(len(layout.notes), 'line')} before the headings kept as notes"
        )
    left = [
        (f"'{layout.headings[j][:40]}'" if layout.headings[j] else f"column {j}")
        + (f" ({layout.texts[j][:20]!r})" if j in layout.texts else "")
        for j in range(layout.width)
        if not layout.numeric[j]
        and j not in (*layout.unit_texts, *layout.aside)
        and not (layout.late[j] and layout.headings[j].lower() in AT_THE_RIGHT)
    ]
    if left and (any(layout.headings) or any(map(unit_behind, layout.texts.values()))):
        found.said.append(f"without numbers and left out: {', '.join(left[:5])}")
    if layout.aside:
        aside = ", ".join(f"column {j}" for j in layout.aside)
        found.said.append(f"with few numbers, at the right, and left out: {aside}")
    if texts:
        found.said.append(f"{how_many(texts, 'line')} of text between the numbers left out")
    found.said += layout.form
    if layout.decimal == ",":
        found.said.append("decimal commas")
