"""Find the lines of numbers in a text or a sheet, and their decimal mark."""

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from dehyst.daemon.files.foreign.fields import GROUPED, GROUPED_BY_POINTS, number_of
from dehyst.daemon.files.foreign.headings import Row, texts_of, without_mark
from dehyst.daemon.files.foreign.roles import role_of
from dehyst.models.errors import BadRecording
from dehyst.models.units import how_many

NUMBER, MISSING, TEXT = 1, 0, -1
MOST_BELOW = 60
"""Lines at the end of a file among which sums and notes are looked for."""
UNEVEN_ROWS = 0.02
"""Share of the lines above which their number of fields is no mistake in one of them."""
_WORDS_BELOW = {
    "comment",
    "comments",
    "note",
    "notes",
    "remark",
    "remarks",
    "kommentar",
    "bemerkung",
}
"""Headings of fields that hold words."""
_OF_LINE = re.compile(r"slope|intercept|r ?(?:2|²|squared)|steigung|achsenabschnitt", re.I)
"""Words in the first field of lines below the numbers that describe a straight-line fit to them."""
MOST_NOTES = 200
"""Lines of text that are kept."""
_SUM = re.compile(
    r"(?:(?:grand|sub) ?total|totals?|sum|means?|avg|averages?|arithmetic mean|median|min|max"
    r"|minimum|maximum|st(?:andar)?d ?dev(?:iation)?|st ?dev|std|sd|sigma|variance|var|rms|range"
    r"|span|counts?|peak(?: ?to ?| )peak|pk ?pk|p ?p|summe|gesamt|(?:mittel|durchschnitts)?wert"
    r"|mittel|durchschnitt|standardabweichung|anzahl|spannweite|moyenne|somme|écart type|media"
    r"|suma|promedio|desviación|среднее|сумма|итого|максимум|минимум|平均値?|平均值|合计|总计|合計"
    r"|最大[值値]?|最小[值値]?|標準偏差|标准差|평균|합계|최대|최소)"
    r"(?: (?:values?|wert|of .*|over .*))?",
    re.IGNORECASE,
)
"""What the first field of a line of sums or statistics says, once all marks are single blanks."""


def kinds_of(row: Row, decimal: str) -> list[int]:
    """Return what each field of a row is: NUMBER, TEXT or MISSING."""
    values = [number_of(cell, decimal) for cell in row]
    return [TEXT if v is None else MISSING if math.isnan(v) else NUMBER for v in values]


def length_of(row: Row) -> int:
    size = len(row)
    while size and (row[size - 1] is None or not str(row[size - 1]).strip()):
        size -= 1
    return size


def is_sum(row: Row) -> bool:
    """Return whether a row begins with the word of a sum or another figure of a column: "Mean:"."""
    plain = re.sub(r"[\W_]+", " ", re.split(r"[(\[=:]", str(_first_of(row))[:60])[0])
    return bool(_SUM.fullmatch(plain.strip()))


def rows_below(rows: Sequence[Row], decimal: str) -> int:
    """Return how many of the last rows (up to MOST_BELOW, some of which may be empty) are not
    samples: sums and other figures of the columns, which begin with a word, at least one with that
    of a sum; or notes, which begin with words and have fewer fields than the samples."""
    last = rows[-MOST_BELOW:]

    def walk(belongs: Callable[[Row], bool]) -> int:
        back = enumerate(reversed(last))
        return next((i for i, row in back if not (_is_blank(row) or belongs(row))), len(last))

    below = walk(lambda row: _begins_with_word(row, decimal) or _begins_empty(row))
    if below == len(last):  # a column of words is the first
        below = walk(is_sum)
        below = 0 if any(map(is_sum, last[: len(last) - below])) else below
    while below and (_is_blank(last[-below]) or not _begins_with_word(last[-below], decimal)):
        below -= 1
    here = [row for row in last[len(last) - below :] if not _is_blank(row)]
    if not here or below == len(last):
        return 0
    width = length_of(next(row for row in reversed(last[:-below]) if length_of(row)))
    notes = max(map(length_of, here)) < width
    notes = notes and any(NUMBER in kinds_of(row, decimal) for row in here)
    return below if notes or any(map(is_sum, here)) else 0


def note_below(rows: Sequence[Row], place: str) -> str:
    """Return the remark on rows below the numbers that are left out. place: of the first."""
    lines = [row for row in rows if not _is_blank(row)]
    count = how_many(len(lines), "line")
    what = "sums or means" if any(map(is_sum, lines)) else "notes"
    first = str(_first_of(lines[0])).strip()
    return f"{count} of {what} below the numbers left out, the first ({first[:20]!r}) in {place}"


def keep_note(notes: dict[str, str], row: Row, place: str) -> None:
    """Add a line of text to the notes, under its first field, unless there are many already."""
    cells = [str(cell).strip() for cell in without_mark(row) if cell is not None]
    if not any(cells) or len(notes) >= MOST_NOTES:
        return
    key = cells[0].rstrip(":=").strip()[:60] or f"note of {place}"
    notes[f"{key} ({place})" if key in notes else key] = " ".join(cells[1:])[:200]


def notes_in(rows: Sequence[Row]) -> dict[str, str]:
    """Return the notes in rows below the numbers, without what was calculated from these."""
    notes: dict[str, str] = {}
    for k, row in enumerate(rows):
        if length_of(row) and not (is_sum(row) or _OF_LINE.match(str(_first_of(row)).strip())):
            keep_note(notes, row, f"below, {k + 1}")
    return notes


def _first_of(row: Row) -> Any:
    return next((cell for cell in row if cell is not None and str(cell).strip()), None)


def _is_blank(row: Row) -> bool:
    return str(_first_of(row) or "").lstrip()[:1] in ("", "#", "%", "!")


def _begins_with_word(row: Row, decimal: str) -> bool:
    return kinds_of([_first_of(row)], decimal) == [TEXT]


def _begins_empty(row: Row) -> bool:
    return row[0] is None or not str(row[0]).strip()


@dataclass
class _Run:
    """Lines of numbers one after another: how much they explain, the first and the last, and the
    numbers of fields that they can have, without and with the empty ones at the end of a line."""

    gain: int
    first: int
    last: int
    least: int
    most: int


def _find_run(rows: Sequence[Row], kinds: Sequence[Sequence[int]]) -> _Run:
    """Return the lines of numbers that explain most. Empty fields cost nothing: a column may hold
    few numbers, or begin late."""
    runs = [_Run(0, 0, 0, 0, 0)]
    open_run = False
    for i, (row, kind) in enumerate(zip(rows, kinds, strict=True)):
        numbers, texts, size = kind.count(NUMBER), kind.count(TEXT), length_of(row)
        if not numbers and not texts:
            continue
        if not numbers or numbers < texts:
            open_run = False
            continue
        run = runs[-1]
        least, most = max(run.least, size), min(run.most, len(row))
        if not open_run or least > most:
            run = _Run(0, i, i, size, len(row))
            runs.append(run)
            least, most, open_run = size, len(row), True
        run.gain, run.last = run.gain + numbers - texts, i
        run.least, run.most = least, most
    return max(runs, key=lambda run: run.gain)


def score(rows: Sequence[Row], decimal: str) -> tuple[int, int, int]:
    """Return (how much a layout explains of these rows, first row of numbers, number of
    columns)."""
    kinds = [kinds_of(row, decimal) for row in rows]
    run = _find_run(rows, kinds)
    width, first = run.least, run.first
    if run.gain <= 0:
        return 0, 0, 0
    named = any(len(kind) >= width and NUMBER not in kind for kind in kinds[:first])
    firsts = [kind[0] for kind in kinds[first : run.last + 1] if kind]
    labels = firsts.count(TEXT)
    unnamed = not named or NUMBER not in firsts  # Yokogawa leaves the first field empty
    if unnamed and 2 * labels < run.last + 1 - first:
        while kinds[first][0] == TEXT:  # "Samples,400" above two columns without names
            first += 1
    # rows before the longest run belong to it if they have numbers in the same columns
    share = [sum(k[j] == NUMBER for k in kinds[first:] if len(k) > j) for j in range(width)]
    sure = [j for j in range(width) if 2 * share[j] > max(share)]
    noted = [any(k[j] == TEXT for k in kinds[first:] if len(k) > j) for j in range(width)]
    for i in range(first):
        size = length_of(rows[i])
        other = any(  # a label in front of numbers, not in columns of its own as at Tektronix
            k == TEXT and not noted[j] and j + 1 in sure for j, k in enumerate(kinds[i][:width])
        )
        if len(kinds[i]) <= max(sure) or other or any(kinds[i][j] == TEXT for j in sure):
            continue
        if 2 * sum(kinds[i][j] == NUMBER for j in sure) < len(sure):
            continue
        whole = all(TEXT not in kind for kind in kinds[i:first])
        if size <= width + 1 or whole:  # or lines that were joined
            return run.gain, i, width
    begin = first
    while first > 0 and _is_short_row(kinds[first - 1]):
        first -= 1
    over = kinds[first - 1] if 0 < first < begin else []
    return run.gain, first if len(over) >= width and TEXT in over else begin, width


def _is_short_row(kind: Sequence[int]) -> bool:
    return TEXT not in kind and kind.count(NUMBER) > 1


def find_decimal(rows: Sequence[Row], habit: str = "") -> tuple[str, str]:
    """Return (decimal mark, a field that leaves it open or ""). habit: the mark to take where all
    numbers leave it open ("12,586" is one number with a decimal comma and another with thousands
    apart), unless some have a point."""
    if not any(isinstance(cell, str) and "," in cell for row in rows for cell in row):
        return ".", ""
    gain, first, width = score(rows, ".")
    other = score(rows, ",")
    if other[0] > gain:
        return ",", _unclear_point(rows[other[1] :], other[2])
    if gain > other[0] or not gain:
        return ".", ""
    unclear = ""
    for cells in _columns_of(rows[first:], width):
        grouped = next((cell for cell in cells if GROUPED.fullmatch(cell)), "")
        if grouped and any(re.fullmatch(r"[+-]?\d{1,3}", cell) for cell in cells):
            return ".", ""  # only numbers from 1000 on have a comma
        unclear = unclear or grouped
        habit = "" if any(map(GROUPED_BY_POINTS.fullmatch, cells)) else habit
    if not unclear and any(":" in c and "," in c for row in rows[first:] for c in map(str, row)):
        unclear = _unclear_point(rows[first:], width)  # a clock's comma does not decide
        habit = ""
    return (habit, "") if unclear and habit else (".", unclear)


def _columns_of(rows: Sequence[Row], width: int) -> list[list[str]]:
    return [[str(row[j]).strip(" \"'") for row in rows if len(row) > j] for j in range(width)]


def _unclear_point(rows: Sequence[Row], width: int) -> str:
    """Return a field such as "50.123" of a column in which nothing shows whether the points are
    decimal or set thousands apart, next to decimal commas in other columns; "" if there is none. A
    field with both marks ("12.865,4") shows that points set thousands apart in the whole file."""
    columns = _columns_of(rows, width)
    if any(
        "," in cell and GROUPED_BY_POINTS.fullmatch(cell) for cells in columns for cell in cells
    ):
        return ""
    for cells in columns:
        grouped = next((cell for cell in cells if GROUPED_BY_POINTS.fullmatch(cell)), "")
        if grouped and not any(re.fullmatch(r"[+-]?\d{1,3}|[^:]*,.*", cell) for cell in cells):
            return grouped
    return ""


def doubt_commas(name: str, rows: Sequence[Row], first: int, headings: Sequence[str]) -> list[str]:
    """Return a remark on numbers without decimal points and without names, between whose digits
    commas stand. Raises BadRecording if the commas may be decimal marks as well as separators, as
    in "23,42,12". first: row of the first numbers; headings: of the columns."""
    body = [texts_of(row)[: length_of(row)] for row in rows[first:] if length_of(row)]
    if any("," in cell for cells in body for cell in cells):  # in quotes
        return []
    sizes = [len(cells) for cells in body]
    over_them = rows[first - 1] if first else []
    above, most = texts_of(over_them)[: length_of(over_them)], max(sizes)
    over = sum(size > len(above) for size in sizes)
    named = len(above) > 1 and NUMBER not in kinds_of(above, ".")
    known = any(role_of(cell, "")[0] for cell in above) or most == 2 * len(above)
    uneven = [size for size in set(sizes) if sizes.count(size) > UNEVEN_ROWS * len(sizes)]
    whole = all(re.fullmatch(r"[-+]?\d*", cell) for cells in body for cell in cells)
    noted = [(j, h) for j, h in enumerate(headings) if h.lower() in _WORDS_BELOW]
    noted = [(j, h) for j, h in noted if NUMBER in kinds_of(_column(body, j), ".")]
    why = ""
    if named and known and 2 * over > len(sizes):
        why = f"{len(above)} headings over {most} fields"
    elif whole and len(uneven) > 1:
        why = f"lines of {' and of '.join(map(str, sorted(uneven)[:3]))} fields"
    elif whole and (padded := _padded(body, most)):
        why = f"fields such as '{padded}'"
    elif whole and noted:
        why = f"numbers below '{noted[0][1][:20]}'"
    shown = ",".join(next(cells for cells in body if len(cells) == most))[:40]
    if why:
        raise BadRecording(
            f"{name}: {why}: the commas in '{shown}' may be decimal marks and separators at once: "
            "write it with decimal points, or with semicolons between the fields; if all are "
            "separators, give each field a heading, and no zeros in front"
        )
    if any(headings) or not whole or most < 3:
        return []
    return [
        f"the commas in '{shown}' are taken for separators (if some are decimal marks, write it "
        "with decimal points, or with semicolons between the fields)"
    ]


def _padded(body: Sequence[Sequence[str]], width: int) -> str:
    """Return a field with zeros in front, as behind a decimal mark, of a column that is not the
    first and has no signs; "" if there is none."""
    for j in range(1, width):
        cells = _column(body, j)
        padded = [cell for cell in cells if re.fullmatch(r"0\d+", cell)]
        if padded and all(re.fullmatch(r"\d*", cell) for cell in cells):
            return padded[0]
    return ""


def _column(body: Sequence[Sequence[str]], j: int) -> list[str]:
    return [cells[j] for cells in body if len(cells) > j]
