"""Find which line above the numbers holds the names of the columns, and which their units."""

import csv
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from dehyst.daemon.files.foreign.fields import number_of
from dehyst.daemon.files.foreign.roles import role_of
from dehyst.daemon.files.foreign.units import find_unit_key, split_heading

Row = Sequence[Any]
LINES_ABOVE = 4
"""Lines directly above the numbers among which names and units are looked for."""
_LABELS = {
    "long name", "name", "names", "tracename", "trace name", "units", "unit", "vunit", "einheit",
    "einheiten", "channel names", "channel name", "channel", "signal name", "signal", "kanalname",
    "kanal", "signalname",
}  # fmt: skip
"""What programs write in front of a line of names or units."""
_ANNOUNCED = re.compile(
    r"\A(?:columns?|(?:column )?names?|units?|fields?|channels?|headers?|headings?|labels?)"
    r"\s*[:=]\s*(?=[^\W\d])",
    re.IGNORECASE,
)
"""What announces names or units in a comment: "# columns: t, u, y"."""
_OF_COLUMNS = re.compile(r"(?:units?|einheit(?:en)?)(?:[ _]?labels?)?", re.IGNORECASE)
"""The label of a line of units in a preamble. An oscilloscope's "Vertical Units" may be those of
its screen."""
_OF_ECSV = re.compile(r"\{name: ([^,{}]+?),? (?:.*[ ,])?unit: ([^,{} ]+)")
"""A column in the header that astropy writes: "- {name: drive, unit: mV, datatype: float64}"."""
AT_THE_RIGHT = {
    "", "comment", "comments", "note", "notes", "remark", "remarks", "kommentar", "bemerkung",
    "start", "increment", "marker",
}  # fmt: skip
"""Headings of fields at the end of a line, which most lines of numbers omit."""
_BLANKS = re.compile(r"(?<!/)\s+(?![\[({</])(?![^\[({]*[\])}])")
"""Blanks between two names: neither before a bracket nor in it, nor next to a lone slash."""
_WITH_VALUE = re.compile(r"\A(CH\d):\s*[-+]?[\d.]+\Z", re.IGNORECASE)
"""A channel with its offset or scale, in the last of a Siglent's lines above the units."""
_BRACKETED = re.compile(r"[\[({<].*[\])}>]")


@dataclass
class Named:
    """headings, units: (width,) texts; header: the fields of the line with the names; lines: those
    used, by row; step_s, start_s: given next to the names."""

    headings: list[str]
    units: list[str]
    header: list[str] = field(default_factory=list)
    lines: set[int] = field(default_factory=set)
    step_s: float = 0.0
    start_s: float = 0.0


@dataclass
class Numbers:
    """What names have to fit: width: number of columns; most: fields that each line has, the empty
    ones at its end included; counts: the first column counts the rows; first_empty: it is empty;
    decimal: the decimal mark."""

    width: int
    most: int
    counts: bool
    first_empty: bool
    decimal: str


def texts_of(cells: Row) -> list[str]:
    return ["" if cell is None else str(cell).strip().strip("\"'").strip() for cell in cells]


def without_mark(row: Row) -> list[Any]:
    """Return the fields of a line without its comment mark, up to the last that is not empty."""
    cells = _unmarked(row)
    return cells[1:] if len(cells) > 1 and not cells[0] and _is_marked(row) else cells


def _unmarked(row: Row) -> list[Any]:
    cells = list(row)
    while cells and (cells[-1] is None or not str(cells[-1]).strip()):
        cells.pop()
    if cells and isinstance(cells[0], str):
        cells[0] = re.sub(r"^\s*(#|%|//|!)+\s*", "", cells[0])
    return cells


def _is_marked(row: Row) -> bool:
    return isinstance(row[0], str) and bool(row[0].strip())


def find_names(
    rows: Sequence[tuple[int, Row]],
    numbers: Numbers,
    split: Callable[[int], list[list[str]]] | None,
) -> Named:
    """Return the names and units in the lines above the numbers. rows: (number, fields) of the
    lines that are not empty; split: returns the ways to read a line whose names may hold blanks, if
    blanks separate."""
    near: list[tuple[int, list[str]]] = []
    for i, row in _near_or_labelled(rows, numbers):
        forms = split(i) if split else []
        cells = _of_blanks(forms, numbers) if forms else _aligned(row, numbers)
        near.append((i, _without_label(cells)))
    units = next(
        (k for k in reversed(range(len(near))) if _is_line_of_units(k, near, numbers)), None
    )
    named = [k for k, (_, cells) in enumerate(near) if _may_name(cells, numbers)]
    below_nothing = {i for i, row in rows if numbers.first_empty and _is_labelled(row)}

    def labelled(k: int) -> bool:
        return near[k][0] in below_nothing

    over = [k for k in named if k != units]
    if units is None or not over:
        roles = {k: {role_of(cell, "")[0] for cell in near[k][1]} - {""} for k in named}
        of = {k: "t" in roles[k] and len(roles[k]) > 1 for k in named}
        units, best = None, max(named, key=lambda k: (labelled(k), of[k], k), default=None)
    else:
        at = units
        best = max(over, key=lambda k: (labelled(k), _known(near[k][1]), k < at, -abs(k - at)))
    if units is not None and best is not None and units < best:
        units = None if any(split_heading(cell)[1] for cell in near[best][1]) else units
    if best is None:
        return Named([""] * numbers.width, [""] * numbers.width)
    line, header = near[best]
    header = [_WITH_VALUE.sub(r"\1", cell) for cell in header]
    header = _completed(header, near[best - 1][1] if best else [], numbers.width)
    below = [""] if units is None else near[units][1]
    width = max(numbers.width, len(header))
    step_s, start_s = _beside(header, below, numbers.width)
    return Named(
        header + [""] * (width - len(header)),
        (below + [""] * width)[:width],
        texts_of(without_mark(dict(rows)[line])),
        {line} if units is None else {line, near[units][0]},
        step_s,
        start_s,
    )


def _completed(header: list[str], above: Sequence[str], width: int) -> list[str]:
    """Return names; those that are missing are in the line above, as over merged fields."""
    if len(header) != width or len(above) > width:
        return header
    over = [*above, *[""] * (width - len(above))]
    return [n or (o if role_of(o, "")[0] else "") for n, o in zip(header, over, strict=True)]


def _without_label(cells: list[str]) -> list[str]:
    """Return the fields of a line without the label that each repeats ("Unit: mV", "Unit: nm"), or
    that announces them ("columns: t", "u")."""
    if len(cells) == 1 and _OF_COLUMNS.fullmatch(re.split(r"\s*[:=]", cells[0])[0]):
        return []  # "Unit: nm", which is that of no column
    labels = {cell.partition(": ")[0] if ": " in cell else "" for cell in cells if cell}
    label = labels.pop() if len(labels) == 1 < len(cells) else ""
    if label:
        return [cell.removeprefix(f"{label}: ") for cell in cells]
    return [_ANNOUNCED.sub("", cell) for cell in cells[:1]] + cells[1:]


def _near_or_labelled(rows: Sequence[tuple[int, Row]], numbers: Numbers) -> list[tuple[int, Row]]:
    """Return the lines among which names and units are looked for: those directly above the
    numbers, and those that a label in front of an empty column marks, as Yokogawa writes them."""
    plain = [line for line in rows if not _is_property(line[1])]
    rows = plain if any(_known(texts_of(row)) > 1 for _, row in plain) else rows
    further = [line for line in rows[:-LINES_ABOVE] if _is_labelled(line[1])]
    return [*(further if numbers.first_empty else []), *rows[-LINES_ABOVE:]]


def _is_property(row: Row) -> bool:
    """Return whether all fields begin with one label, which announces neither names nor units:
    ",Interp: zoh,Interp: zoh" of MathWorks."""
    cells = [cell for cell in texts_of(_unmarked(row)) if cell]
    labels = {cell.partition(": ")[0].lower() if ": " in cell else "" for cell in cells}
    return len(cells) > 1 == len(labels) and labels.isdisjoint({"", *_LABELS})


def _is_labelled(row: Row) -> bool:
    return next(iter(texts_of(_unmarked(row))), "").lower() in _LABELS


def add_units(found: Named, lines: Sequence[Row]) -> None:
    """Add the units that lines of a preamble state for the columns to those of a line of units;
    where two differ, both are kept, and asked for. lines: those that hold no names."""
    for row in lines:
        cells = texts_of(row)
        if own := _OF_ECSV.search(" ".join(cells)):
            cells = [f"{own[1]} unit", own[2]]
        label, mark, rest = next(iter(cells), "").replace("=", ":").partition(":")
        if mark and rest.strip():  # "Units: s, V, um"
            cells = [label, *re.split(r"\s*[,;]\s*", rest.strip()), *cells[1:]]
        if len(cells) < 2 or not all(map(find_unit_key, cells[1:])):
            continue
        stated = _columns_of_units(label.strip(), cells[1:], found.headings)
        for j, unit in stated.items():
            key, there = find_unit_key(unit), found.units[j]
            if find_unit_key(there) != key and split_heading(found.headings[j])[1] != key:
                found.units[j] = f"{there} and {unit}" if there else unit


def _columns_of_units(label: str, units: Sequence[str], headings: Sequence[str]) -> dict[int, str]:
    """Return the unit of each column that a line states: one for each column, one for each but the
    times, or one for the column that the label names ("CH1 unit")."""
    if not _OF_COLUMNS.fullmatch(label):
        named = _plain(re.sub(r"(?<![^\W_])units?(?![^\W_])", "", label, flags=re.IGNORECASE))
        own = [
            j
            for j, text in enumerate(headings)
            if named and _plain(split_heading(text)[0]) == named
        ]
        one = len(own) == len(units) == 1 and named != _plain(label)
        return {own[0]: units[0]} if one else {}
    times = [j for j, text in enumerate(headings) if role_of(text, "")[0] == "t"]
    others = [j for j in range(len(headings)) if j not in times]
    if len(units) == len(headings):
        return dict(enumerate(units))
    several = len(units) > 1  # not the unit of the line above it
    fit = len(times) == 1 and len(units) == len(others) and several
    return dict(zip(others, units, strict=True)) if fit else {}


def _plain(name: str) -> str:
    """Return a name by which a channel is recognized: "ch1" for "Channel 1" and "CH1"."""
    return re.sub(r"[\W_]", "", name.lower().replace("channel", "ch"))


def gcs_header(rows: Sequence[tuple[int, Row]], width: int) -> tuple[list[str], float]:
    """Return (names, sampling period [s] or 0) of the header that PI's controllers write, ([], 0.0)
    if the lines above the numbers are no such header."""
    lines = [" ".join(texts_of(without_mark(row))) for _, row in rows]
    if "END_HEADER" not in lines:
        return [], 0.0
    stated = dict(line.split(" = ", 1) for line in lines if " = " in line)
    step = number_of(stated.get("SAMPLE_TIME", ""))
    names = [stated.get(f"NAME{j}", "") for j in range(width)]
    return names if all(names) else [], step if step and 0.0 < step < math.inf else 0.0


def _aligned(row: Row, numbers: Numbers) -> list[str]:
    """Return the fields of a line such that each is above its column, [] if that is not known."""
    cells = texts_of(_unmarked(row))
    sizes = range(numbers.width, max(numbers.most, numbers.width) + 1)
    if not cells:
        return []
    if cells[0].lower() in _LABELS and (numbers.first_empty or len(cells) - 1 in sizes):
        return ["", *cells[1:]] if numbers.first_empty else cells[1:]
    if numbers.first_empty and cells[0] and _are_units(cells[1:]) and not find_unit_key(cells[0]):
        return []  # Yokogawa: "HUnit", "s", "s"
    if not cells[0] and _is_marked(row) and len(cells) not in sizes:
        cells = cells[1:]
    if cells and not cells[0] and _is_marked(row) and not numbers.first_empty:
        cells[0] = "#"
    if numbers.counts and len(cells) == numbers.width - 1:
        return ["", *cells]
    return cells


def _of_blanks(forms: Sequence[Sequence[str]], numbers: Numbers) -> list[str]:
    """Return the way to read a line that gives as many names as there are columns (the last may be
    a column of words); [] if there is none, or if several name equally many roles."""
    of_words = range(numbers.width + 1, numbers.most + 1)
    for size in [numbers.width, *[numbers.width - 1] * numbers.counts, *of_words]:
        fitting = [cells for cells in forms if len(cells) == size]
        most = max(map(_known, fitting), default=0)
        fitting = [cells for cells in fitting if _known(cells) == most]
        if fitting:
            alike = all(cells == fitting[0] for cells in fitting)
            return [""] * max(0, numbers.width - size) + list(fitting[0]) if alike else []
    return []


def ways_to_split(line: str) -> list[list[str]]:
    """Return the ways to read a line of names that are separated by blanks and may hold blanks: at
    two or more, after a closing bracket, at commas, or at each that is not before a bracket."""
    line = _ANNOUNCED.sub("", re.sub(r"^\s*(#|%|//|!)+\s*", "", line)).strip()
    if '"' in line:
        return [next(csv.reader([line], delimiter=" ", skipinitialspace=True), [])]
    forms = [re.split(form, line) for form in (r"\s{2,}", r"(?<=[\])])\s+", r"\s*[,;]\s*")]
    if len(forms[-1]) == 1:
        plain = line.split()
        forms.append(plain if all(map(_BRACKETED.fullmatch, plain)) else _BLANKS.split(line))
    of_labels = [{cell.endswith(":") for cell in cells} for cells in forms]  # "X axis unit: s"
    forms = [cells for cells, ends in zip(forms, of_labels, strict=True) if len(ends) == 1]
    return [[cell.rstrip(",; ") for cell in cells] for cells in forms]


def _are_units(cells: Row) -> bool:
    texts = [text for text in texts_of(cells) if text]
    known = [text for text in texts if find_unit_key(text) or text.lower() == "sequence"]
    return bool(known) and 2 * len(known) > len(texts)


def _is_line_of_units(k: int, near: Sequence[tuple[int, list[str]]], numbers: Numbers) -> bool:
    """Return whether line k holds units; one that is not directly above the numbers has no other
    text in front, as in "Vertical Units,V,V" of a preamble."""
    cells = near[k][1][: numbers.width]
    in_front = next((cell for cell in cells if cell), "")
    return _are_units(cells) and (k == len(near) - 1 or _are_units([in_front]))


def _may_name(cells: Sequence[str], numbers: Numbers) -> bool:
    """Return whether these can be the names: one for each column, and no value among them, which
    "1" and "2" are not."""
    if "=" in cells:  # a parameter
        return False
    further = cells[max(numbers.width, numbers.most) :]
    if len(cells) < numbers.width or any(c.lower() not in AT_THE_RIGHT for c in further):
        return False
    values = [number_of(cell, numbers.decimal) for cell in cells]
    plain = [re.fullmatch(r"\d\d?", cell) for cell in cells]
    return None in values and all(
        v is None or math.isnan(v) or short for v, short in zip(values, plain, strict=True)
    )


def _known(cells: Sequence[str]) -> int:
    """Return how many of these headings name a role."""
    return sum(bool(role_of(cell, "")[0]) for cell in cells if cell)


def _beside(over: Row, below: Row, width: int) -> tuple[float, float]:
    """Return the increment and start given next to the headings, as some oscilloscopes write
    them: below "Increment", or as "tInc = 1e-3"."""
    names = [str(cell).strip().lower() for cell in over]
    stated = {key.strip(): value.strip() for key, _, value in (c.partition("=") for c in names)}
    out = []
    for name, short in (("increment", "tinc"), ("start", "t0")):
        at = names.index(name) if name in names else -1
        value = number_of(below[at]) if width <= at < len(below) else None
        value = number_of(stated[short]) if short in stated else value
        out.append(value if value is not None and math.isfinite(value) else 0.0)
    return out[0], out[1]


def apart(headings: Sequence[str]) -> list[str]:
    """Make headings unique."""
    out: list[str] = []
    for heading in headings:
        number, text = 2, heading
        while text and text in out:
            text, number = f"{heading}.{number}", number + 1
        out.append(text)
    return out
