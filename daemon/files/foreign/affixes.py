"""Read text whose fields repeat their names or units, or are written as lists: "t:0.005,u:50.1 V",
"0.005 s; 50.1 V", "[0.005, 50.1]", "np.float64(50.1)"."""

import re
from collections.abc import Sequence

_FIELD = re.compile(
    r"\s*(?:(?P<name>[^\W\d][\w \[\]()/.]*?)\s*[:=]\s*)?"
    r"(?:\[|(?:np|numpy)\.\w+\()?"
    r"(?P<number>[-+]?(?:\d+[.,]?\d*|[.,]\d+)(?:e[-+]?\d+)?)"
    r"[\])]?\s*(?P<unit>[^\W\d]{1,8}|°C?|%)?\s*",
    re.IGNORECASE,
)
_LISTED = re.compile(r"\s*[\[(](?=[^\])]*[,;])(.*)[\])],?\s*")
"""A line that is a list of Python."""
LEAST_ROWS = 3


def bare_numbers(lines: Sequence[str], places: Sequence[int]) -> list[str] | None:
    """Return the lines of a text with the names and units that its fields repeat in two lines above
    the rows, each in place of nothing; None if its fields are none of that kind, or differ from row
    to row, as in "999 mV" and "1.2 V". places: of the lines that are not empty."""
    for separator in (";", "\t", ",", None):
        first = next((k for k in range(len(places)) if _split(lines[places[k]], separator)), None)
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


def _split(line: str, separator: str | None) -> list[re.Match[str]]:
    """Return the fields of a line, [] if one is no number with a name or a unit."""
    listed = _LISTED.fullmatch(line)
    fields = [_FIELD.fullmatch(cell) for cell in (listed[1] if listed else line).split(separator)]
    found = [field for field in fields if field is not None]
    return found if len(found) == len(fields) > 1 else []
