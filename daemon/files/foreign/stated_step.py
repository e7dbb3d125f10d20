"""Find the sampling period that the preamble of a file states, in time or as a rate."""

import math
import re
from collections.abc import Sequence

import numpy as np

from dehyst.daemon.files.foreign.fields import number_of
from dehyst.daemon.files.foreign.units import TIME, UNITS, find_unit_key
from dehyst.models.arrays import Ints
from dehyst.models.recording import Floats

_UNIT_BEHIND = r"(?:(?:\s*[\[(/]|\s)\s*([^\])]*?)\s*[\])]?)?"
_STEP = re.compile(
    r"(?:sampl(?:e|ing) ?(?:interval|period|time)|time ?step|t ?interval|x ?inc(?:rement)?"
    r"|delta [xt]|increment|dt|ts|abtastintervall|abtastzeit|采样(?:间隔|周期)"
    r"|サンプリング(?:間隔|周期)"
    r"|(?:период|интервал) дискретизации)" + _UNIT_BEHIND,
    re.IGNORECASE,
)
_RATE = re.compile(
    r"(?:(?:sampl(?:e|ing)|scan|acquisition|data) ?(?:rate|freq(?:uency)?)|samples/s|fs"
    r"|abtastrate|abtastfrequenz|采样(?:频率|率)|サンプリング(?:周波数|レート)"
    r"|частота дискретизации)" + _UNIT_BEHIND,
    re.IGNORECASE,
)
SAME_STEP = 0.01
"""Share by which two periods that one file states may differ, as they are rounded."""
SURELY_SECONDS = 0.02
"""A period without a unit that is shorter than this [s] is one in seconds: as milliseconds it would
be more than 50 kHz, which no recording of a stage needs. A "scan rate" of fewer rows per second may
be the lines of a microscope."""
UNEVEN = 1e-3
"""Last digit of the times, in periods, above which their rounding makes the steps uneven."""
MOST_LOOKED_AT, MOST_DIGITS, LEAST_ROWS = 100, 15, 10
"""LEAST_ROWS: on average between two pauses; times of another period pause all the time."""
_REST_OF_A_NUMBER = re.compile(r"\d{3}(?!\d)(?:[.,]\d*)?\s*[^\d\s]*")
_STATED = re.compile(r"([-+]?\d[\d.,']*(?:e[-+]?\d+)?)\s*(.*)", re.IGNORECASE)
_RATE_UNIT = re.compile(r"([kMGк]?)(?:Hz|Гц|Sa?/s|Samples?/s|Hertz|1/s)", re.IGNORECASE)


def stated_step(cells: Sequence[str], decimal: str) -> float:
    """Return the sampling period [s] that a line of the preamble states, as fields or as one text
    ("fs = 1 kHz"), 0 if it states none, in a unit that is not known or may not be that of time
    ("Increment,0.5", which may be volts), as a slow "scan rate", or in a number that the separator
    may have cut ("1,000 Hz")."""
    line = " ".join(cells).replace("：", ":")
    name, mark, value = line.partition("=" if "=" in line else ":")
    return _step_of(cells, decimal) or (_step_of([name, value.strip()], decimal) if mark else 0.0)


def _step_of(cells: Sequence[str], decimal: str) -> float:
    name = cells[0].rstrip(":=").strip() if len(cells) > 1 else ""
    first, blank, unit = name.replace("_", " ").partition(" ")  # "sampleRate [kS/s]"
    name = re.sub(r"(?<=[a-z])(?=[A-Z][a-z])", " ", first) + blank + unit
    step, rate = _STEP.fullmatch(name), _RATE.fullmatch(name)
    named, stated = step or rate, _STATED.fullmatch(cells[1]) if name else None
    if named is None or stated is None or _may_be_cut(cells[1:], decimal):
        return 0.0
    value = _value(stated[1], decimal)
    beside = "".join(cells[2:3])
    if not (find_unit_key(beside) or _RATE_UNIT.fullmatch(beside)):
        beside = ""
    units = {unit for unit in (named[1], stated[2].strip(" []()") or beside) if unit}
    factors = {_factor(unit, step is not None) for unit in units or {"s" if step else "Hz"}}
    if not value or not 0.0 < value < math.inf or len(factors) > 1:
        return 0.0
    if step and not units and (value >= SURELY_SECONDS or name.lower() == "increment"):
        return 0.0
    scaled = value * factors.pop()
    if rate and name.lower().startswith("scan") and scaled * SURELY_SECONDS < 1.0:
        return 0.0
    return scaled if step or not scaled else 1.0 / scaled


def _value(text: str, decimal: str) -> float | None:
    value = number_of(text, decimal)
    return number_of(text, "," if decimal == "." else ".") if value is None else value


def _may_be_cut(cells: Sequence[str], decimal: str) -> bool:
    """Return whether the fields are parts of one number, or different numbers."""
    first, further = _value(cells[0], decimal), cells[1:]
    if further and _REST_OF_A_NUMBER.fullmatch(further[0]):
        return True
    numbers = [value for cell in further if cell and (value := _value(cell, decimal)) is not None]
    return first is not None and any(value != first for value in numbers)


def _factor(unit: str, is_time: bool) -> float:
    """Return the factor to seconds or to hertz, 0 for another unit."""
    if is_time:
        kind, _, factor = UNITS.get(find_unit_key(unit), ("", "", 0.0))
        return factor if kind == TIME else 0.0
    found = _RATE_UNIT.fullmatch(unit)
    if found is None or unit.startswith("mH"):  # millihertz
        return 0.0
    return {"": 1.0, "k": 1e3, "к": 1e3, "m": 1e6, "g": 1e9}[found[1].lower()]


def on_stated_step(times: Floats, rows: Ints, step: float, unit: float) -> tuple[Floats, float]:
    """Return (N,) times [s] that have too few digits for their even steps, counted from the stated
    period instead, and their last digit [s]; (times, 0.0) if they have enough digits, or are not
    those of this period to within the last digit. rows: (N,) numbers of the rows; unit: of the
    numbers in the file [s]. Where the times pause, they are counted anew."""
    if times.size < 2 or not np.all(np.isfinite(times)):
        return times, 0.0
    digit = _last_digit(times / unit) * unit
    off = np.abs(np.diff(times) - step * np.diff(rows))
    if digit <= UNEVEN * step or not np.any(off > UNEVEN * step):
        return times, 0.0
    cuts = np.flatnonzero(off > digit * (1.0 + UNEVEN)) + 1
    if times.size < LEAST_ROWS * (cuts.size + 1):
        return times, 0.0
    out = times.copy()
    for part in np.split(np.arange(times.size), cuts):
        begins = times[part] - step * (rows[part] - rows[part[0]])
        least, most = float(np.max(begins)) - digit / 2.0, float(np.min(begins)) + digit / 2.0
        if least > most + UNEVEN * digit:
            return times, 0.0
        begin = min(max(float(begins[0]), least), most)
        out[part] = begin + step * (rows[part] - rows[part[0]])
    return out, digit


def _last_digit(values: Floats) -> float:
    """Return the value of the last digit with which the largest numbers were written; smaller ones
    may have finer digits. 0 if there are none."""
    largest = np.sort(np.abs(values))[-MOST_LOOKED_AT:]
    texts = [f"{value:.{MOST_DIGITS - 1}e}".partition("e") for value in largest.tolist() if value]
    places = [int(power) + 2 - len(text.rstrip("0")) for text, _, power in texts]
    return 10.0 ** min(places) if places else 0.0
