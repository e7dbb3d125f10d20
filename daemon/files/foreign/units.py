"""Spellings of units, and the units in which recordings are kept."""

import math
import re

TIME, VOLTAGE, LENGTH, ANGLE, COUNTS, OTHER = (
    "time",
    "voltage",
    "length",
    "angle",
    "counts",
    "other",
)

UNITS: dict[str, tuple[str, str, float]] = {
    # spelling: (quantity, unit used in recordings, factor)
    "s": (TIME, "s", 1.0),
    "ms": (TIME, "s", 1e-3),
    "us": (TIME, "s", 1e-6),
    "ns": (TIME, "s", 1e-9),
    "min": (TIME, "s", 60.0),
    "h": (TIME, "s", 3600.0),
    "v": (VOLTAGE, "v", 1.0),
    "mv": (VOLTAGE, "v", 1e-3),
    "kv": (VOLTAGE, "v", 1e3),
    "um": (LENGTH, "um", 1.0),
    "nm": (LENGTH, "nm", 1.0),
    "mm": (LENGTH, "um", 1e3),
    "m": (LENGTH, "um", 1e6),
    "pm": (LENGTH, "nm", 1e-3),
    "counts": (COUNTS, "counts", 1.0),
    "mrad": (ANGLE, "mrad", 1.0),
    "urad": (ANGLE, "urad", 1.0),
    "rad": (ANGLE, "mrad", 1e3),
    "deg": (ANGLE, "mrad", 1e3 * math.pi / 180),
    "arcsec": (ANGLE, "urad", 1e6 * math.pi / 648000),
    "n": (OTHER, "n", 1.0),
    "a": (OTHER, "a", 1.0),
    "ma": (OTHER, "ma", 1.0),
    "ua": (OTHER, "ua", 1.0),
    "hz": (OTHER, "hz", 1.0),
    "c": (OTHER, "c", 1.0),
    "k": (OTHER, "k", 1.0),
    "%": (OTHER, "percent", 1.0),
}
TIME_UNITS = ("s", "ms", "us")
DRIVE_UNITS = ("v", "mv", "kv", "um", "nm", "mm", "counts", "mrad", "urad")
SPELLED = {
    **dict.fromkeys(("sec", "secs", "second", "seconds", "sekunde", "sekunden", "sek"), "s"),
    **dict.fromkeys(("msec", "millisecond", "milliseconds", "millisekunden"), "ms"),
    **dict.fromkeys(("usec", "microsecond", "microseconds", "mikrosekunden"), "us"),
    **dict.fromkeys(("minute", "minutes", "minuten"), "min"),
    **dict.fromkeys(("hour", "hours", "hr", "stunden"), "h"),
    **dict.fromkeys(("volt", "volts"), "v"),
    **dict.fromkeys(("millivolt", "millivolts"), "mv"),
    **dict.fromkeys(("kilovolt", "kilovolts"), "kv"),
    **dict.fromkeys(
        (
            "micron", "microns", "micrometer", "micrometers", "micrometre", "micrometres",
            "mikrometer",
        ),
        "um",
    ),
    **dict.fromkeys(("nanometer", "nanometers", "nanometre", "nanometres"), "nm"),
    **dict.fromkeys(("millimeter", "millimetre", "millimeters", "millimetres"), "mm"),
    **dict.fromkeys(("meter", "metre", "meters", "metres"), "m"),
    **dict.fromkeys(("count", "cnt", "cnts", "lsb", "digit", "digits"), "counts"),
    **dict.fromkeys(("microradian", "microradians"), "urad"),
    **dict.fromkeys(("degree", "degrees", "°"), "deg"),
    **dict.fromkeys(("°c", "degc", "deg c", "celsius"), "c"),
    **dict.fromkeys(("newton",), "n"),
    **dict.fromkeys(("ampere", "amps", "amp"), "a"),
    **dict.fromkeys(("percent",), "%"),
}  # fmt: skip


def find_unit_key(text: str) -> str:
    """Return the unit's key in UNITS for "µm", "Volt", "[ms]" and so on; "" if it is not a unit."""
    plain = text.strip().strip("[](){}<>").strip().lower().replace("µ", "u").replace("μ", "u")
    plain = SPELLED.get(plain, plain)
    return plain if plain in UNITS else ""


_IN_BRACKETS = re.compile(r"(.*?)\s*[\[({<]\s*([^\[\](){}<>]*?)\s*[\])}>]\s*")
_BEHIND_A_MARK = re.compile(r"(.*?\S)\s*(?:/|,|;|:|\bin\b)\s*(\S+)\s*")
_LAST_WORD = re.compile(r"(.*[^\W_].*?|.*[^\W_])[_\s.-]+([^\W\d_]+|°C?|%)\s*")


LONGEST_HEADING = 120


def split_heading(text: str) -> tuple[str, str]:
    """Split a heading into (name, unit's key): "Time (s)", "U / V", "t_ms", "Displacement [um]";
    the unit is "" if none is given."""
    text = text.strip().strip("\"'").strip()
    if len(text) > LONGEST_HEADING:  # matching time grows with the square of the length
        return text, ""
    if unit := find_unit_key(text):
        return ("", unit) if len(text) > 1 or unit in ("v", "s") else (text, "")
    for form in (_IN_BRACKETS, _BEHIND_A_MARK, _LAST_WORD):
        found = form.fullmatch(text)
        if found and (unit := find_unit_key(found[2])):
            return found[1].strip(), unit
    return text, ""
