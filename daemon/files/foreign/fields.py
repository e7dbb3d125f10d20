"""Read one field of a text or a sheet: a number with either decimal mark, with thousands set apart,
a time or a date, or a word for no value."""

import math
import re
from datetime import date, datetime, time
from typing import Any

from dehyst.daemon.files.csv_table import is_missing
from dehyst.daemon.files.foreign.units import UNITS, find_unit_key

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([ed][+-]?\d+)?", re.IGNORECASE)
GROUPED = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+(\.\d*)?")
GROUPED_BY_POINTS = re.compile(r"[+-]?[1-9]\d{0,2}(\.\d{3})+(,\d*)?")
GROUPED_APART = re.compile(r"[+-]?[1-9]\d{0,2}(['\u2019 \xa0\u2009\u202f]\d{3})+(\.\d*)?")
"""With apostrophes, as in Switzerland, or with spaces, as in France; a field holds a plain space
only where something else separates the fields."""
_PLAIN = re.compile(r"[+-]?\d+(\.\d+)?([eE][+-]?0?\d)?")
"""What most fields hold; with a decimal point it has one meaning, which is found quickly."""
_SIGN = re.compile("([-+\u2212\u2010\u2011\u2013\ufe63\uff0d]) *(?=[\\d.])")
"""A sign, or a typographic minus or dash in its place; blanks may follow it."""
TRUTHS = {"true": 1.0, "false": 0.0}
"""As pandas and R write truth values, which a spreadsheet keeps as such."""
_CLOCK = re.compile(r"(\d{1,2}):(\d\d):(\d\d(?:[.,]\d*)?)")
_DURATION = re.compile(r"(\d+(?:[.,]\d*)?) (secs?|m?s|[uµ]s|min|hr)")
"""As MATLAB writes durations."""
_MINUTES = re.compile(r"(\d{1,3}):(\d\d[.,]\d+)")
"""As Excel shows times of fractions of a second; without a fraction it may be hours."""
_MILLISECONDS = re.compile(r"(:\d\d:\d\d):(\d{3})(?!\d)")
"""After a colon, as Keysight's data loggers write them."""
_HALF_DAY = re.compile(r"(?:(.*)\s)?\s*(1[0-2]|0?[1-9])(:.*\d)\s*([ap])\.?m\.?", re.I)
_DAYS = re.compile(r"(\d+) days?,? (.*)", re.I)
_SLASHED = re.compile(r"(\d{1,2})([/-])(\d{1,2})\2(\d{4}|(?<=/)\d\d)[ T,]\s*(.*)")
"""With dashes, two digits at the end may also be the day: "25-03-14"."""
_GERMAN_DATE = re.compile(r"(\d\d?)\.(\d\d?)\.(\d{4}|\d\d)[ T,]\s*(.*)")
_POINTED_DATE = re.compile(r"(\d{4})\.(\d\d)\.(\d\d)[ T](.*)")
_NAMED_MONTH = re.compile(
    r"(?:[A-Z][a-z]+,? )?(\d{1,2})[- ]([A-Za-z]{3})[a-z]*[- ](\d{4})[ T,]\s*(.*)"
)
_MONTH_FIRST = re.compile(
    r"(?:[A-Z][a-z]+,? )?([A-Z][a-z]{2})[a-z]* +(\d{1,2})(?:, ?(\d{4}))? (\d\d?:[\d:.]+)"
    r"(?: (\d{4}))?"
)
"""As C writes dates ("Fri Mar 14 14:07:58.9 2025"), and in the American form."""
_UNMARKED = re.compile(r"(\d{4})(\d\d)(\d\d)T(\d\d)(\d\d)(\d\d(?:[.,]\d+)?.*)")
"""As ISO 8601 allows: "20250314T140758.9Z"."""
_ZONE_APART = re.compile(r"(:\d\d(?:[.,]\d+)?) +(?:([-+]\d\d:?\d\d)|[A-Z]{3,5})(?!\w)")
"""A time zone after the time: its offset from UTC, or its name, which is the same in all rows."""
_CJK_DATE = re.compile(r"(\d{4})年(\d{1,2})月(\d{1,2})日\s*(.*)")
_SEVERAL_MARKS = re.compile(r"[+-]?\d+([.,])\d+(?:\1\d+)+")
_MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")


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
    text = str(cell).strip().removeprefix('="').strip("\"'").strip()  # a spreadsheet's ="0.5"
    if decimal != "," and _PLAIN.fullmatch(text):
        return float(text)
    if is_missing(text):
        return math.nan
    if text.lower() in TRUTHS:
        return TRUTHS[text.lower()]
    if decimal == ",":
        text = text.replace(".", "") if GROUPED_BY_POINTS.fullmatch(text) else text
        if "." in text and ":" not in text:
            return None
        text = text.replace(",", ".")
    elif GROUPED.fullmatch(text):
        text = text.replace(",", "")
    text = _SIGN.sub(lambda found: "+" if found[1] == "+" else "-", text)
    if _NUMBER.fullmatch(text):
        return float(text.lower().replace("d", "e"))
    if GROUPED_APART.fullmatch(text):
        return float(re.sub(r"[^-+.\d]", "", text))
    if text.lower() in ("inf", "+inf", "-inf", "infinity", "-infinity"):
        return float(text)
    return moment_of(text)


def marks_in(cell: Any) -> str:
    """Return what a field that is no number may be: one with several decimal marks ("23.42.12"), a
    hexadecimal one, one with underscores; "" for another one."""
    text = str(cell).strip()
    if re.fullmatch(r"[+-]?(0x[\da-f]+|[\da-f]*\d[a-f][\da-f]*)", text, re.IGNORECASE):
        return "; it may be hexadecimal: write it in decimal digits"
    found = _SEVERAL_MARKS.fullmatch(text)
    if found is None:
        return "; leave out its underscores" if re.fullmatch(r"[+-]?\d+(_\d+)+.*", text) else ""
    marks = "points" if found[1] == "." else "commas"
    return f"; its {marks} may separate numbers, thousands or the parts of a date"


def moment_of(text: str) -> float | None:
    """Return the seconds of "12:00:01.25", "2024-03-05 12:00:01.25", "05.03.2024 12:00:01.25",
    "3/5/2024 1:00:01.25 PM", "05-Mar-2024 12:00:01.25", "Mar 5, 2024 12:00:01.25", "2024年3月5日
    12:00:01.25", "20240305T120001.25Z", "0 days 12:00:01.25", "00:01.25" or "1.25 s", with either
    decimal mark, and with a time zone. In a date with slashes the first number is the month if it
    can be one."""
    if duration := _DURATION.fullmatch(text):
        return float(duration[1].replace(",", ".")) * UNITS[find_unit_key(duration[2])][2]
    if len(text) > 40:
        return None
    if unmarked := _UNMARKED.fullmatch(text):
        text = "{}-{}-{}T{}:{}:{}".format(*unmarked.groups())
    if ":" not in text:
        return None
    text = _MILLISECONDS.sub(r"\1.\2", _ZONE_APART.sub(r"\1\2", text))
    if clock := _CLOCK.fullmatch(text):
        return int(clock[1]) * 3600.0 + int(clock[2]) * 60.0 + float(clock[3].replace(",", "."))
    if minutes := _MINUTES.fullmatch(text):
        return int(minutes[1]) * 60.0 + float(minutes[2].replace(",", "."))
    if days := _DAYS.fullmatch(text):
        rest = moment_of(days[2])
        return None if rest is None else int(days[1]) * 86400.0 + rest
    if half := _HALF_DAY.fullmatch(text):
        hour = f"{int(half[2]) % 12 + 12 * (half[4] in 'pP'):02d}"
        return moment_of(f"{half[1] or ''} {hour}{half[3]}".strip())
    if slashed := _SLASHED.fullmatch(text):
        month, day = sorted((int(slashed[1]), int(slashed[3])), key=lambda n: n > 12)
        text = f"{_year(slashed[4])}-{month:02d}-{day:02d} {slashed[5]}"
    elif german := _GERMAN_DATE.fullmatch(text):
        text = f"{_year(german[3])}-{int(german[2]):02d}-{int(german[1]):02d} {german[4]}"
    elif pointed := _POINTED_DATE.fullmatch(text):
        text = "{}-{}-{} {}".format(*pointed.groups())
    elif (named := _NAMED_MONTH.fullmatch(text)) and named[2].lower() in _MONTHS:
        month = 1 + _MONTHS.index(named[2].lower())
        text = f"{named[3]}-{month:02d}-{int(named[1]):02d} {named[4]}"
    elif (named := _MONTH_FIRST.fullmatch(text)) and named[1].lower() in _MONTHS:
        month = 1 + _MONTHS.index(named[1].lower())
        text = f"{named[3] or named[5]}-{month:02d}-{int(named[2]):02d} {named[4]}"
    elif cjk := _CJK_DATE.fullmatch(text):
        text = f"{cjk[1]}-{int(cjk[2]):02d}-{int(cjk[3]):02d} {cjk[4]}"
    try:
        moment = datetime.fromisoformat(text.replace("/", "-"))
    except ValueError:
        return None
    return number_of(moment)


def _year(text: str) -> str:
    """Return a year in four digits."""
    return text if len(text) == 4 else f"20{text}"
