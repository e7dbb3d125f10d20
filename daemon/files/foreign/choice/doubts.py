"""What a file says about the unit of a column that gives none: where it may be another than usual,
the unit is asked for, and never taken as seconds or volts."""

import re
from collections.abc import Mapping, Sequence

from dehyst.daemon.files.foreign.found import Column, Sheet
from dehyst.daemon.files.foreign.roles import unit_of_column, words_of
from dehyst.daemon.files.foreign.units import find_unit_key

DATES, DATE_STEP = ((0.01, 1.0), (30_000.0, 80_000.0), (700_000.0, 750_000.0)), 2e-5
"""DATES: ranges of times of day as spreadsheets store them, and of serial dates of spreadsheets and
of MATLAB in this century [days]; DATE_STEP: more than their step at one row per second. In seconds
it would mean 50 kHz."""
LEAST_STEP_S = 2e-7
"""Times without a unit that step by less than this are days rather than seconds."""
_OTHER_VOLTS = re.compile(r"(?<![^\W\d])(?:[mk]V|(?:milli|kilo)volts?)(?!\w)")
_UNITS_LINE = re.compile(r"(?:(?:vertical|channel|y)[ _]?)?units?(?: ?label)?", re.IGNORECASE)
"""The name of a line that gives the units of the channels, not that of the times."""
_OTHER_TIMES = re.compile(
    r"(?<![^\W_])(?<!\d)(?<!\d )(?:[mnµμ]s|us(?=\s*(?:$|[\])},;/|]))|[mnuµμ]sec"
    r"|(?:milli|micro|nano)sec(?:ond)?s?)(?![^\W_])"
)
"""A unit of time that is not that of a number in front of it, as in "pause of 5 ms"."""
_NOT_VOLTS = {
    "code", "codes", "raw", "norm", "normalized", "normalised", "normiert", "rel", "relative",
    "relativ", "pct", "percent", "prozent", "bit", "bits", "steps", "pwm", "duty",
}  # fmt: skip
"""Words of a drive that may be in the numbers of a converter, or in parts of its range."""


def other_volts(notes: Mapping[str, str], columns: Sequence[Column], drive: Column) -> str:
    """Return a text of the file that names millivolts or kilovolts if no column has such a unit, or
    a heading of the drive that may mean no volts; "" otherwise."""
    if words_of(drive.heading) & _NOT_VOLTS:
        return drive.heading[:60]
    if any(unit_of_column(column) in ("mv", "kv") for column in columns):
        return ""
    return _text_with(_OTHER_VOLTS, notes) or _units_of_channels(notes)


def _units_of_channels(notes: Mapping[str, str]) -> str:
    """Return the line of a preamble that gives a unit for each channel, one of which is not a volt,
    as oscilloscopes write for a current probe: "Vertical Units,V,A"; "" if there is none."""
    for key, text in notes.items():
        units = [unit.strip() for unit in re.split(r"[,;\t]| +", text) if unit.strip()]
        if _UNITS_LINE.fullmatch(key.strip(' "')) and any(find_unit_key(u) != "v" for u in units):
            return f"{key} {text}"[:60]
    return ""


def other_times(found: Sheet, columns: Sequence[Column]) -> str:
    """Return a text of the file that names milliseconds or the like as a unit if no column has such
    a unit, and the file states no period, by which the times can be checked; "" otherwise."""
    units = [unit_of_column(column) for column in columns]
    if found.step_s or {"ms", "us", "ns"} & {*units}:
        return ""
    return _text_with(_OTHER_TIMES, found.notes)


def _text_with(unit: re.Pattern[str], notes: Mapping[str, str]) -> str:
    texts = (f"{key} {text}".strip() for key, text in notes.items())
    return next((text[:60] for text in texts if unit.search(text)), "")
