"""Turn rows of fields, from a text or a sheet, into columns with headings: find where the numbers
begin, which line above them holds the names, which the units, and what else the preamble says."""

import math
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from datetime import date, datetime, time
from typing import Any

import numpy as np

from dehyst.daemon.files.csv_table import LARGEST, MOST_COLUMNS
from dehyst.daemon.files.foreign.found import Column, Sheet
from dehyst.daemon.files.foreign.units import find_unit_key
from dehyst.models.errors import BadRecording

MISSING = {"", "nan", "na", "n/a", "#n/a", "#nv", "null", "none", "-", "--", "---", "#num!", "nil"}
LOOKED_AT = 2000
"""Rows at the beginning that are used to find the layout; an instrument's preamble is shorter."""
MOSTLY_EMPTY = 0.9
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?", re.IGNORECASE)
_GROUPED = re.compile(r"[+-]?\d{1,3}(,\d{3})+(\.\d*)?")
_CLOCK = re.compile(r"(\d{1,2}):(\d\d):(\d\d(?:\.\d*)?)")
_GERMAN_DATE = re.compile(r"(\d\d)\.(\d\d)\.(\d{4})[ T](.*)")
_STEP = re.compile(
    r"(sample interval|sampling interval|sampling period|x ?increment|delta[ _]x|increment|dt)"
    r"\s*(?:[\[(].*[\])])?"
)
_RATE = re.compile(
    r"(sample rate|sampling rate|sampling frequency|samples/s|fs)\s*(?:[\[(].*[\])])?"
)

Row = Sequence[Any]


def number_of(cell: Any, decimal: str = ".") -> float | None:
    """Return a field as a number, or a timestamp in seconds; NaN if it is missing; None if it is
    neither."""
    if isinstance(cell, bool):
        return float(cell)
    if isinstance(cell, int | float):
        return float(cell)
    if isinstance(cell, datetime):
        return cell.timestamp() if cell.tzinfo else (cell - datetime(1970, 1, 1)).total_seconds()
    if isinstance(cell, time):
        return cell.hour * 3600.0 + cell.minute * 60.0 + cell.second + cell.microsecond / 1e6
    if cell is None:
        return math.nan
    if isinstance(cell, date):
        return None
    text = str(cell).strip().strip("\"'").strip()
    if text.lower() in MISSING:
        return math.nan
    if decimal == ",":
        text = text.replace(".", "") if re.fullmatch(r"[+-]?\d{1,3}(\.\d{3})+,\d*", text) else text
        if "." in text and ":" not in text:
            return None
        text = text.replace(",", ".")
    elif _GROUPED.fullmatch(text):
        text = text.replace(",", "")
    if _NUMBER.fullmatch(text):
        return float(text)
    if text.lower() in ("inf", "+inf", "-inf", "infinity", "-infinity"):
        return float(text)
    return moment_of(text)


def moment_of(text: str) -> float | None:
    """Return the seconds of "12:00:01.25", "2024-03-05 12:00:01.25" or "05.03.2024 12:00:01.25"."""
    if ":" not in text or len(text) > 40:
        return None
    if clock := _CLOCK.fullmatch(text):
        return int(clock[1]) * 3600.0 + int(clock[2]) * 60.0 + float(clock[3])
    if german := _GERMAN_DATE.fullmatch(text):
        text = f"{german[3]}-{german[2]}-{german[1]} {german[4]}"
    try:
        moment = datetime.fromisoformat(text.replace("/", "-"))
    except ValueError:
        return None
    return number_of(moment)


@dataclass
class GridLayout:
    """first: first row of numbers; width: number of columns; headings, units: (width,) texts;
    notes: the preamble; numeric: which columns hold numbers; step_s, start_s: stated by the
    preamble."""

    first: int
    width: int
    headings: list[str]
    units: list[str]
    numeric: list[bool]
    notes: dict[str, str] = field(default_factory=dict)
    step_s: float = 0.0
    start_s: float = 0.0


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
        if sizes[i] >= max(sure) + 1 and sizes[i] <= width + 1 and all(flags[i][j] for j in sure):
            return gain, i, width
    return gain, begin, width


def lay_out(name: str, rows: Sequence[Row], decimal: str) -> GridLayout:
    """Find the layout from the first rows. Raises BadRecording if there are no numbers."""
    gain, first, width = score(rows, decimal)
    if not gain:
        raise BadRecording(f"{name}: holds no rows of numbers")
    if width > MOST_COLUMNS:
        raise BadRecording(f"{name}: {width} columns; at most {MOST_COLUMNS} are read")
    above = [(i, _stripped(row)) for i, row in enumerate(rows[:first]) if _length(row)]
    headings, units, used = [""] * width, [""] * width, set()
    step_s = start_s = 0.0
    if above and _are_units(above[-1][1][:width]) and len(above) > 1:
        below, over = above[-1][1], above[-2][1]
        if len(over) >= min(width, len(below)) > 0:
            units, used = _fit(below, width), {above[-1][0]}
            step_s, start_s = _beside(over, below, width)
            above.pop()
    if above and _may_name(above[-1][1], width):
        headings = _fit(above[-1][1], width)
        used.add(above[-1][0])
    notes: dict[str, str] = {}
    for i, row in above:
        if i not in used and len(notes) < 200:
            cells = [str(cell).strip() for cell in row if cell is not None]
            key = cells[0].rstrip(":=").strip()[:60] or f"note{i + 1}"
            notes.setdefault(key, " ".join(cells[1:])[:200])
    if not step_s:
        step_s = _stated_step(notes)
    flags = [_values(row[:width], decimal) for row in rows[first:]]
    most = max(sum(f[j] for f in flags if len(f) > j) for j in range(width))
    numeric = [
        sum(f[j] for f in flags if len(f) > j) > (1 - MOSTLY_EMPTY) * most for j in range(width)
    ]
    return GridLayout(first, width, _apart(headings), units, numeric, notes, step_s, start_s)


def _stripped(row: Row) -> list[Any]:
    """Return a line without its comment mark."""
    cells = list(row[: _length(row)])
    if cells and isinstance(cells[0], str):
        cells[0] = re.sub(r"^\s*(#|%|//|!)+\s*", "", cells[0])
        if not cells[0] and len(cells) > 1 and str(row[0]).strip():
            cells.pop(0)
    return cells


def _fit(cells: Row, width: int) -> list[str]:
    texts = ["" if cell is None else str(cell).strip().strip("\"'").strip() for cell in cells]
    return (texts + [""] * width)[:width]


def _are_units(cells: Row) -> bool:
    texts = [str(cell).strip().strip("\"'") for cell in cells if cell is not None]
    texts = [text for text in texts if text]
    known = [text for text in texts if find_unit_key(text) or text.lower() == "sequence"]
    return bool(known) and 2 * len(known) > len(texts)


def _may_name(cells: Row, width: int) -> bool:
    if not width - 1 <= len(cells) <= width + 2:
        return False
    return any(number_of(cell) is None for cell in cells[:width])


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


def _stated_step(notes: dict[str, str]) -> float:
    for key, text in notes.items():
        plain = key.lower().replace("_", " ")
        both = f"{key} {text}"
        first = re.search(r"[-+]?\d+(?:[.,]\d+)?(?:e[-+]?\d+)?", text, re.IGNORECASE)
        if first is None:
            continue
        value = float(first[0].replace(",", "."))
        small = (
            "ms" if re.search(r"\bms\b", both) else "us" if re.search(r"\b[uµ]s\b", both) else "s"
        )
        if _STEP.fullmatch(plain) and value > 0.0:
            return value * {"s": 1.0, "ms": 1e-3, "us": 1e-6}[small]
        if _RATE.fullmatch(plain) and value > 0.0:
            return 1.0 / (value * (1e3 if re.search(r"\bk(Hz|S/s)", both) else 1.0))
    return 0.0


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
    decimal: str,
    where: Callable[[int], str],
) -> Sheet:
    """Return the columns below a layout. rows: (place, fields); where: describes a place. Raises
    BadRecording naming the place of a field that is not a number."""
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
            continue
        if len(row) < needed or size > layout.width + 2:
            raise BadRecording(
                f"{name}: {where(place)} has {size} fields, those before have {layout.width}"
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
