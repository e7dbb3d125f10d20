"""Read text whose fields repeat their names or units, or are written as lists: "t:0.005,u:50.1 V",
"0.005 s; 50.1 V", "[0.005, 50.1]", "np.float64(50.1)"; or that holds more words than numbers."""

import math
import re
from collections.abc import Callable, Sequence

from dehyst.daemon.files.foreign.fields import number_of
from dehyst.daemon.files.foreign.units import LETTERS, find_unit_key

_FIELD = re.compile(
    r"\s*(?:(?P<name>[^\W\d][\w \[\]()/.]*?)\s*[:=]\s*)?"
    r"(?:\[|(?:np|numpy)\.\w+\()?"
    r"(?P<number>[-+]?(?:\d+[.,]?\d*|[.,]\d+)(?:e[-+]?\d+)?)"
    r"[\])]?\s*(?P<unit>[^\W\d]{1,8}|°C?|%)?\s*",
    re.IGNORECASE,
)
_LISTED = re.compile(r"\s*[\[(](?=[^\])]*[,;])(.*)[\])],?\s*")
"""A line that is a Python list."""
_WITH_UNIT = re.compile(
    r"\s*([-+]?(?:\d+[.,]?\d*|[.,]\d+)(?:e[-+]?\d+)?)\s?([^\W\d_]{1,8}|°C?|%)\s*", re.IGNORECASE
)
_STAMPED = re.compile(r"\s*(\d\d?:\d\d:\d\d(?:\.\d+)?) -> ")
LEAST_ROWS = 3


def split_off_times(lines: list[str]) -> None:
    """Make a field of the time that a serial monitor writes in front of each line, in place:
    "10:11:12.345 -> 57.79,7.759"."""
    filled = [line for line in lines if line.strip()]
    if len(filled) < LEAST_ROWS or not all(map(_STAMPED.match, filled)):
        return
    for i, line in enumerate(lines):
        if found := _STAMPED.match(line):
            rest = line[found.end() :]
            mark = next((mark for mark in "\t;," if mark in rest), " ")
            time = "time" if rest[:1].isalpha() else found[1]
            lines[i] = f"{time}{mark}{rest}"


def bare_numbers(lines: Sequence[str], places: Sequence[int]) -> list[str] | None:
    """Return the lines of a text without the names and units that its fields repeat, which are then
    in two lines above the rows; None if its fields repeat none, or differ from row to row, as in
    "999 mV" and "1.2 V". places: of the lines that are not empty."""
    for separator in (";", "\t", ",", None):
        fits = [bool(_split(lines[place], separator)) for place in places]
        first = next((k for k in range(len(fits)) if all(fits[k : k + LEAST_ROWS])), None)
        if first is None or len(places) - first < LEAST_ROWS:
            continue
        rows = [_split(line, separator) for line in lines[places[first] :]]
        whole = [row for row in rows if row]
        alike = {
            tuple((field["name"] or "", field["unit"] or "") for field in row) for row in whole
        }
        plain = all(field.string.strip() == field["number"] for field in whole[0])
        if len(alike) > 1 or (plain and not _LISTED.fullmatch(lines[places[first]])):
            continue
        affixes = alike.pop()
        mark = ";" if separator != "," or any("," in f["number"] for r in whole for f in r) else ","
        names = [name for name, _ in affixes]
        above = lines[: places[first]]
        if not any(names) and above:
            cells = [cell.strip() for cell in above[-1].split(separator)]
            names = cells if len(cells) == len(names) else names
        units = [unit for _, unit in affixes]
        body = [
            mark.join(field["number"] for field in row) if row else line  # which is then counted
            for row, line in zip(rows, lines[places[first] :], strict=True)
        ]
        return [*above, mark.join(names), mark.join(units), *body]
    return None


def without_units(
    lines: Sequence[str], places: Sequence[int], split: Callable[[str], list[str]], separator: str
) -> tuple[list[str], dict[int, str]] | None:
    """Return (the lines without the unit that each field of a column repeats, the unit by column);
    None if no column does. places: of the lines that are not empty."""
    rows = [split(lines[i]) for i in places]
    units = {j: unit for j, cell in enumerate(rows[len(rows) // 2]) if (unit := unit_behind(cell))}
    for j, unit in [*units.items()]:
        of = [unit_behind(row[j]) for row in rows if len(row) > j]
        if 2 * of.count(unit) < len(rows) or set(of) - {"", unit}:
            del units[j]  # or in several units
    if not units or not separator:
        return None

    def bare(line: str) -> str:
        row = split(line)
        with_unit = [j for j, unit in units.items() if len(row) > j and unit_behind(row[j]) == unit]
        for j in with_unit:
            row[j] = row[j].strip()[: -len(units[j])].strip()
        return _join(row, separator) if with_unit else line

    return [bare(line) for line in lines], units


def unit_behind(cell: str) -> str:
    """Return the unit after the number in a field; "" if there is none, or only a letter that may
    also be a prefix: "706.9m"."""
    found = _WITH_UNIT.fullmatch(cell)
    if found is None or _is_number(cell) or found[2].lower() in LETTERS:
        return ""
    return found[2] if find_unit_key(found[2]) else ""


def _split(line: str, separator: str | None) -> list[re.Match[str]]:
    """Return the fields of a line, [] if one of them is not a number, with or without name and
    unit."""
    listed = _LISTED.fullmatch(line)
    fields = [_FIELD.fullmatch(cell) for cell in (listed[1] if listed else line).split(separator)]
    found = [field for field in fields if field is not None]
    return found if len(found) == len(fields) > 1 else []


def without_words(
    lines: Sequence[str], places: Sequence[int], split: Callable[[str], list[str]], separator: str
) -> tuple[list[str], list[list[str]], list[int]] | None:
    """Return the lines of a table with its columns of words emptied, such as the status next to
    each channel, its rows as they were, and which columns these are; None if it has no such
    columns, or fewer than two columns of numbers. places: of the lines that are not empty."""
    rows = [split(lines[i]) for i in places]
    sizes = [len(row) for row in rows]
    width = max(set(sizes), key=sizes.count)
    table = [(i, row) for i, row in zip(places, rows, strict=True) if len(row) == width]
    columns = [*zip(*(row for _, row in table), strict=True)]
    numbers = [j for j, cells in enumerate(columns) if 2 * sum(map(_is_number, cells)) > len(cells)]
    words = [j for j, cells in enumerate(columns) if 2 * sum(map(_is_word, cells)) > len(cells)]
    if len(numbers) < 2 or not words or len(table) < LEAST_ROWS:
        return None
    first = next(i for i, row in table if any(_is_number(row[j]) for j in numbers))

    def emptied(line: str) -> str:
        row = split(line)
        if len(row) != width or not any(_is_number(row[j]) for j in numbers):
            return line
        return _join(["-" if j in words else cell for j, cell in enumerate(row)], separator)

    rows = [row for i, row in table if i >= first]
    return [*lines[:first], *map(emptied, lines[first:])], rows, words


def _join(cells: Sequence[str], separator: str) -> str:
    """Join fields to a line, with quotes around those that contain the separator ("": blanks)."""
    quoted = [f'"{cell}"' if separator and separator in cell else cell for cell in cells]
    return (separator or " ").join(quoted)


def _is_number(cell: str) -> bool:
    values = [number_of(cell, mark) for mark in ".,"]
    return any(value is not None and not math.isnan(value) for value in values)


def _is_word(cell: str) -> bool:
    """Return whether a field is neither empty nor a number nor a unit, and does not begin as a
    number."""
    texts = all(number_of(cell, mark) is None for mark in ".,")
    return texts and not (re.match(r"\s*[-+]?[.,]?\d", cell) or find_unit_key(cell))
