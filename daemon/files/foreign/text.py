"""Read numbers from text in any common form: encoding, separator, decimal mark, preamble."""

import csv
import gzip
import re
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from itertools import islice
from pathlib import Path

import numpy as np

from dehyst.daemon.files.csv_table import (
    END_OF_FILE,
    LARGEST,
    LONGEST_LINE,
    MOST_PACKED,
    TRUSTED_BYTES,
    is_missing,
)
from dehyst.daemon.files.foreign.affixes import (
    bare_numbers,
    split_off_times,
    without_units,
    without_words,
)
from dehyst.daemon.files.foreign.encoding import decode_text
from dehyst.daemon.files.foreign.fields import GROUPED_APART, marks_in, number_of
from dehyst.daemon.files.foreign.found import Sheet
from dehyst.daemon.files.foreign.grid import (
    LOOKED_AT,
    TURNED,
    GridLayout,
    fill,
    lay_out,
    note_text,
    sheet_of,
)
from dehyst.daemon.files.foreign.headings import ways_to_split
from dehyst.daemon.files.foreign.long import refuse_long, refuse_next_variable
from dehyst.daemon.files.foreign.lvm import is_lvm, read_lvm
from dehyst.daemon.files.foreign.paired import name_pairs
from dehyst.daemon.files.foreign.roles import role_of
from dehyst.daemon.files.foreign.runs import (
    MOST_BELOW,
    NUMBER,
    doubt_commas,
    find_decimal,
    kinds_of,
    note_below,
    notes_in,
    rows_below,
    score,
)
from dehyst.daemon.files.number_text import MOST_OTHERS, ends_inside_number
from dehyst.daemon.printable import printable
from dehyst.models.errors import BadRecording
from dehyst.models.units import how_many

MOST_TEXT = 256 << 20
NO_UNITS: Mapping[int, str] = {}
HEAD, MOST_BROKEN = 100, 12
"""Lines that are searched for quoted headings broken into several lines, and the most lines of
one."""
FEW_FIELDS = 0.05
"""Fields a line below which a boot message, not the samples, may have been taken for numbers."""
SEPARATORS = (
    ("\t", "tabs"),
    (";", "semicolons"),
    (",", "commas"),
    ("", "blanks"),
    ("|", "bars"),
)


def read_bytes(path: Path) -> bytes:
    """Return all bytes of a text file, unpacked. Raises BadRecording."""
    try:
        packed = path.stat().st_size
        if path.suffix.lower() == ".gz":
            most = min(MOST_TEXT, max(TRUSTED_BYTES, MOST_PACKED * packed))
            with gzip.open(path, "rb") as handle:
                data = handle.read(most + 1)
        else:
            most = MOST_TEXT
            with path.open("rb") as plain:
                data = plain.read(most + 1)
    except (OSError, EOFError, zlib.error) as error:
        reason = getattr(error, "strerror", None) or error
        raise BadRecording(f"{path}: cannot be read: {reason}") from None
    if len(data) > most:
        raise BadRecording(f"{path.name}: more than {most >> 20} MB of text; cut it into pieces")
    return data


def read_text_table(path: Path) -> Sheet:
    """Return the columns of a text file. Raises BadRecording naming the line."""
    text, remark = decode_text(path.name, read_bytes(path))
    found = understand_text(path.name, text)
    found.said += [remark] if remark else []
    return found


def ends_in_other_rows(path: Path) -> bool:
    """Return whether sums or notes follow the numbers of a comma-separated text."""
    try:
        end = read_bytes(path)[-LONGEST_LINE:].decode("utf-8", errors="replace")
    except BadRecording:
        return False
    return bool(rows_below([line.split(",") for line in end.splitlines()], "."))


def understand_text(
    name: str,
    text: str,
    above: int = 0,
    separator: str | None = None,
    decimal: str = "",
    units: Mapping[int, str] = NO_UNITS,
) -> Sheet:
    """Return the columns of a text in memory. above: lines of the file above it; separator,
    decimal: as the file states them; units: by column, as its fields repeated them."""
    text = text.removesuffix(END_OF_FILE).replace("\ufeff", "")  # files joined with their marks
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    _join_quoted(lines)
    _join_labelled(lines)
    name_pairs(lines)
    split_off_times(lines)
    cut = above + len(lines) if lines[-1].strip() else 0  # without an end, so possibly not whole
    if is_lvm(lines):
        return read_lvm(name, lines, partial(understand_text, name))
    places = [i for i, line in enumerate(lines[: 3 * LOOKED_AT]) if line.strip()][:LOOKED_AT]
    if not places:
        raise BadRecording(f"{name}: the file is empty")
    if max(len(lines[i]) for i in places) > LONGEST_LINE:
        raise BadRecording(f"{name}: a line is too long for a recording{TURNED}")
    if max(len(lines[i]) for i in places) > 8192:
        places = places[:50]
    sample = [lines[i] for i in places]
    best: tuple[int, str, str] = (0, "", "")
    best_rows: list[list[str]] = []
    for one, word in SEPARATORS:
        if separator not in (None, one):
            continue
        split = splitter(one)
        rows = [split(line) for line in sample]
        if max(map(len, rows)) < 2:
            continue
        gain = max(score(rows, decimal)[0] for decimal in (".", ","))
        if gain > best[0] and not (best[1] == "\t" and not one and _only_groups(best_rows)):
            best, best_rows = (gain, one, word), rows
    if best[0] < FEW_FIELDS * len(sample) and (bare := bare_numbers(lines, places)) is not None:
        return understand_text(name, "\n".join(bare), above - 2)
    if not best[0]:
        return _understand_words(name, lines, places, above, separator, decimal)
    plain = without_units(lines, places, splitter(best[1]), best[1])
    if plain is not None:
        return understand_text(name, "\n".join(plain[0]), above, best[1], decimal, plain[1])
    gain, separator, word = best
    split = splitter(separator)
    rows = [split(line) for line in sample]
    rest = lines[places[-1] + 1 :] if separator != "," else []
    later = [split(line) for line in islice((line for line in rest if "," in line), LOOKED_AT)]
    unclear = ""
    if decimal not in (".", ",") or not score(rows, decimal)[0]:
        decimal, unclear = find_decimal(rows + later, habit="," if separator == ";" else "")
    left, below = _cut_rows_below(lines, split, decimal, above)
    if left:
        rows, cut = rows[: sum(place < len(lines) for place in places)], 0
    names = partial(_ways_to_name, sample, separator)
    layout = lay_out(name, rows, decimal, names)
    layout.unclear, layout.remarks = unclear, below
    layout.take_units(units)
    layout.form = [f"separated by {word}"] if separator != "," else []
    if separator == "," and not any("." in line for line in lines[places[layout.first] :]):
        layout.form += doubt_commas(name, rows, layout.first, layout.headings)
    first = places[layout.first]
    before = lines[max(first, len(lines) - 1 - MOST_OTHERS) : -1] if cut else []
    cut = cut if before and _is_cut(split(lines[-1]), [*map(split, before)], decimal) else 0
    if cut:
        lines.pop()
    found = _quickly(lines, first, layout, separator, decimal, split, above)
    if found is None:
        marked: list[int] = []
        rows_of = _without_notes(name, lines, first, layout, split, above, marked)
        found = fill(name, layout, rows_of, lambda place: f"line {above + place + 1}")
        if marked:
            found.said.append(
                f"{how_many(len(marked), 'line')} of numbers after a comment mark left out, the "
                f"first in line {above + marked[0] + 1}"
            )
    last = max(i for i, line in enumerate(lines) if line.strip())
    found.blank_lines = sum(not line.strip(" \n\r") for line in lines[first:last])
    found.said += [left] if left else []
    if cut:
        found.said.append(f"line {cut}, the last, is cut short and left out")
    return found


def _understand_words(
    name: str,
    lines: Sequence[str],
    places: Sequence[int],
    above: int,
    separator: str | None,
    decimal: str,
) -> Sheet:
    """Return the columns of a text whose fields hold more than numbers, or are mostly words. Raises
    BadRecording if it is not a table at all."""
    for one, _ in SEPARATORS:
        if separator in (None, one):
            plain = without_units(lines, places, splitter(one), one)
            if plain is not None:
                return understand_text(name, "\n".join(plain[0]), above, one, decimal, plain[1])
            emptied = without_words(lines, places, splitter(one), one)
            if emptied is not None:
                whole, rows, words = emptied
                numeric = [j not in words for j in range(len(rows[0]))]
                refuse_long(name, rows, numeric, [""] * len(numeric))
                return understand_text(name, "\n".join(whole), above, one, decimal)
    shown = places[len(places) // 2]
    if number_of(lines[shown].strip(), decimal) is not None:
        raise BadRecording(
            f"{name}: holds one column of numbers (line {above + shown + 1} is "
            f"{printable(lines[shown].strip()[:20])!r}): write drive and displacement as one each"
        )
    raise BadRecording(
        f"{name}: holds no rows of numbers separated by commas, semicolons, tabs or blanks; "
        f"line {above + shown + 1} is {printable(lines[shown].strip()[:60])!r}"
        + marks_in(lines[shown])
    )


def _cut_rows_below(
    lines: list[str], split: Callable[[str], list[str]], decimal: str, above: int
) -> tuple[str, dict[str, str]]:
    """Remove sums and notes below the numbers. Return (a remark on them, "" if there are none; the
    notes)."""
    last = [split(line) for line in lines[-MOST_BELOW:]]
    if not (below := rows_below(last, decimal)):
        return "", {}
    del lines[-below:]
    return note_below(last[-below:], f"line {above + len(lines) + 1}"), notes_in(last[-below:])


def _join_quoted(lines: list[str]) -> None:
    """Join lines of the head that a quoted heading breaks; empty lines take their places."""
    for i in range(min(len(lines), HEAD)):
        for j in range(i + 1, min(len(lines), i + MOST_BROKEN)):
            if lines[i].count('"') % 2 == 0:
                break
            if sum(line.count('"') for line in lines[i : i + MOST_BROKEN]) % 2:
                return  # a quote that nothing closes
            lines[i], lines[j] = f"{lines[i]} {lines[j]}", ""


def _join_labelled(lines: list[str]) -> None:
    """Join lines of the head of which one is a label ("dt:") and the next its values, as
    SignalExpress writes them; empty lines take their places. Numbers after the last label are the
    samples."""
    for i in range(min(len(lines) - 2, HEAD)):
        label, values, after = (line.strip() for line in lines[i : i + 3])
        mark = next((mark for mark in "\t;," if mark in values), "\t")
        ends = [text.endswith(":") for text in (label, values, after)]
        if ends == [True, False, True] and values and mark not in label:
            lines[i], lines[i + 1] = f"{label[:-1]}{mark}{values}", ""


def _is_cut(last: Sequence[str], before: Sequence[Sequence[str]], decimal: str) -> bool:
    """Return whether a last line begins like a row and has fewer fields than the one before it, or
    fewer digits in the last of them than others."""
    if kinds_of(last, decimal)[:1] != [NUMBER]:
        return False
    ends = [row[-1] for row in before if len(row) == len(last)]
    numbers = 2 * kinds_of(ends, decimal).count(NUMBER) > len(ends)
    short = numbers and ends_inside_number(last[-1], ends, decimal)
    return len(last) < len(before[-1]) or short


def _ways_to_name(sample: Sequence[str], separator: str, i: int) -> list[list[str]]:
    """Return the ways to read a line of names. If the numbers are not separated by blanks, only a
    line with another separator between its names or units has any."""
    line = sample[i]
    if not separator:
        return ways_to_split(line)
    if separator in line:
        return []
    forms = [re.split(form, line.strip()) for form in (r"\s*;\s*", r"\s*,\s*", r"\t|\s{2,}")]
    return [form for form in forms if sum(bool(role_of(cell, "")[0]) for cell in form) > 1]


def _only_groups(rows: Sequence[Sequence[str]]) -> bool:
    """Return whether blanks inside the fields only set thousands apart ("7 875.4"): then they do
    not separate fields. A field with letters does not count."""
    fields = (cell.strip().replace(",", ".") for row in rows for cell in row)
    inside = [field for field in fields if re.fullmatch(r"[-+.\d]+( +[-+.\d]+)+", field)]
    return bool(inside) and all(map(GROUPED_APART.fullmatch, inside))


def splitter(separator: str) -> Callable[[str], list[str]]:
    """Return a function that splits a line into its fields."""
    if not separator:
        return re.compile(r"[^ \t\f\v]+").findall  # a no-break space may be in a number

    def split(line: str) -> list[str]:
        if separator == "|":  # as in a table of Markdown, whose lines begin and end with one
            line = line.strip().removeprefix("|").removesuffix("|")
        if '"' in line:
            try:
                return next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
            except csv.Error:
                return line.split(separator)
        return line.split(separator)

    return split


def _without_notes(
    name: str,
    lines: Sequence[str],
    first: int,
    layout: GridLayout,
    split: Callable[[str], list[str]],
    above: int,
    marked: list[int],
) -> Iterator[tuple[int, list[str]]]:
    """Yield (place, fields) of the lines from the first row on, except notes. marked: filled with
    the places of notes that are rows of numbers after a comment mark."""
    for i in range(first, len(lines)):
        row = split(lines[i])
        if len(row) > layout.width and " #" in lines[i].strip():  # a remark after the numbers
            row = split(lines[i].strip().partition(" #")[0])
        if lines[i].lstrip()[:1] in ("#", "%", "!") and not is_missing(row[0].strip()):
            refuse_next_variable(name, lines[i], f"line {above + i + 1}")
            cells = split(lines[i].lstrip("#%! \t"))
            if len(cells) > 1 and kinds_of(cells, layout.decimal).count(NUMBER) == len(cells):
                marked.append(i)
            else:
                note_text(name, layout, row, f"line {above + i + 1}")
        else:
            yield i, row


def _quickly(
    lines: Sequence[str],
    first: int,
    layout: GridLayout,
    separator: str,
    decimal: str,
    split: Callable[[str], list[str]],
    above: int,
) -> Sheet | None:
    """Read with numpy's own reader; return None if a row is not plain enough for it."""
    if layout.unclear or layout.unit_texts or any(":" in cell for cell in split(lines[first])):
        return None
    kept = [j for j in range(layout.width) if layout.numeric[j]]
    filled = 1 + max((j for j in kept if not layout.late[j]), default=0)
    kept = kept[: sum(j < filled for j in kept)]  # not those that are late, if no line has them
    body = _plain(lines[first:], filled, separator, decimal)
    if decimal == ",":
        body = (line.replace(",", ".") for line in body)
    try:
        table = np.loadtxt(body, delimiter=separator or None, usecols=kept, comments=None, ndmin=2)
    except (ValueError, OverflowError, IndexError):
        return None
    if np.any(np.abs(table[np.isfinite(table)]) > LARGEST):
        return None
    full = all(line.strip() for line in lines[first : first + table.shape[0]])
    return sheet_of(
        layout,
        {j: np.ascontiguousarray(table[:, i]) for i, j in enumerate(kept)},
        [False] * layout.width,
        lambda row: f"line {above + first + row + 1}" if full else f"row {row + 1}",
        0,
    )


def _plain(lines: Sequence[str], most: int, separator: str, decimal: str) -> Iterator[str]:
    """Yield the lines. Raises ValueError at one that has to be read field by field, because numpy
    would overlook an additional field or a mark for thousands."""
    for line in lines:
        if separator:
            size = line.rstrip(separator + " \t").count(separator) + 1
        else:
            size = len(line.split())
        marked = decimal == "," and ("." in line or separator == ",")
        if size > most or marked or not line.isascii():
            raise ValueError
        yield line
