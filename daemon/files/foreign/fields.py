"""Read one field of a text or a sheet: a number with either decimal mark, with thousands set apart,
a time or a date, or a word for no value."""

import math
import re
from datetime import date, datetime, time
from typing import Any

from dehyst.daemon.files.csv_table import is_missing

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?", re.IGNORECASE)
GROUPED = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+(\.\d*)?")
GROUPED_BY_POINTS = re.compile(r"[+-]?[1-9]\d{0,2}(\.\d{3})+(,\d*)?")
GROUPED_APART = re.compile(r"[+-]?[1-9]\d{0,2}(['\u2019\xa0\u2009\u202f]\d{3})+(\.\d*)?")
"""With apostrophes, as in Switzerland, or with no-break spaces, as in France."""
_CLOCK = re.compile(r"(\d{1,2}):(\d\d):(\d\d(?:[.,]\d*)?)")
_HALF_DAY = re.compile(
    r"(?:(\d{1,2})/(\d{1,2})/(\d{4})\s+)?(1[0-2]|0?[1-9])(:.*\d)\s*([ap])\.?m\.?", re.I
)
_DAYS = re.compile(r"(\d+) days?,? (.*)", re.I)
_GERMAN_DATE = re.compile(r"(\d\d)\.(\d\d)\.(\d{4})[ T](.*)")


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
    if is_missing(text):
        return math.nan
    if decimal == ",":
        text = text.replace(".", "") if GROUPED_BY_POINTS.fullmatch(text) else text
        if "." in text and ":" not in text:
            return None
        text = text.replace(",", ".")
    elif GROUPED.fullmatch(text):
        text = text.replace(",", "")
    if _NUMBER.fullmatch(text):
        return float(text)
    if GROUPED_APART.fullmatch(text):
        return float(re.sub(r"[^-+.\d]", "", text))
    if text.lower() in ("inf", "+inf", "-inf", "infinity", "-infinity"):
        return float(text)
    return moment_of(text)


def moment_of(text: str) -> float | None:
    """Return the seconds of "12:00:01.25", "2024-03-05 12:00:01.25", "05.03.2024 12:00:01.25",
    "3/5/2024 1:00:01.25 PM" or "0 days 12:00:01.25", with either decimal mark."""
    if ":" not in text or len(text) > 40:
        return None
    if clock := _CLOCK.fullmatch(text):
        return int(clock[1]) * 3600.0 + int(clock[2]) * 60.0 + float(clock[3].replace(",", "."))
    if days := _DAYS.fullmatch(text):
        rest = moment_of(days[2])
        return None if rest is None else int(days[1]) * 86400.0 + rest
    if half := _HALF_DAY.fullmatch(text):
        date_of = f"{half[3]}-{int(half[1]):02d}-{int(half[2]):02d} " if half[3] else ""
        return moment_of(f"{date_of}{int(half[4]) % 12 + 12 * (half[6] in 'pP'):02d}{half[5]}")
    if german := _GERMAN_DATE.fullmatch(text):
        text = f"{german[3]}-{german[2]}-{german[1]} {german[4]}"
    try:
        moment = datetime.fromisoformat(text.replace("/", "-"))
    except ValueError:
        return None
    return number_of(moment)
