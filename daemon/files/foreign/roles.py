"""Find the role of a column from its heading."""

import re

from dehyst.daemon.files.foreign.units import (
    ANGLE,
    COUNTS,
    LENGTH,
    LONGEST_HEADING,
    OTHER,
    TIME,
    UNITS,
    VOLTAGE,
    read_heading,
    split_heading,
)
from dehyst.models.modelfile import UNIT_NAMES

NAMES = {"t": "time", "u": "drive", "y": "displacement", "target": "target"}
PLAIN, BY_WORD, BY_UNIT = 3, 2, 1
"""Confidence in a role: dehyst's own name, a known word, the unit alone."""

_TIME = {
    "t",
    "time",
    "times",
    "timestamp",
    "zeit",
    "temps",
    "tempo",
    "tiempo",
    "elapsed",
    "seconds",
}
_TARGET = {
    "target", "setpoint", "soll", "sollwert", "reference", "desired", "commanded", "ref", "setpos",
}  # fmt: skip
_DRIVE = {
    "u", "drive", "input", "driving", "applied", "excitation", "actuation", "ansteuerung", "hv",
    "command", "control", "vin", "uin", "actuator", "amplifier", "eingang", "stimulus",
}  # fmt: skip
_VOLTAGE = {"voltage", "volt", "volts", "spannung", "tension", "v"}
_DISPLACEMENT = {
    "y", "displacement", "displ", "disp", "position", "pos", "weg", "auslenkung", "verschiebung",
    "stellweg", "sensor", "gauge", "elongation", "extension", "deflection", "stroke", "measured",
    "interferometer", "strain", "sgs", "capacitive", "vibrometer", "lvdt", "encoder", "deformation",
    "tilt", "angle", "output", "response", "ausgang", "dehnung", "position_measured", "travel",
}  # fmt: skip
_EITHER = {"measured", "output", "response", "ausgang"}
"""Words that stand for a displacement, unless a voltage is named beside them."""
_ROW = {"", "index", "idx", "no", "nr", "n", "row", "sample", "samples", "point", "sequence", "seq"}
_PLAIN = re.compile(rf"(?:(t)_s|(u|y|target)_(?:{'|'.join(UNIT_NAMES)}))")


def words_of(name: str) -> set[str]:
    """Return the words of a heading in lower case: "driveVoltage" gives "drive", "voltage"."""
    apart = re.sub(r"(?<=[a-zäöü])(?=[A-Z])", " ", name.rpartition("/")[2] or name)
    words = set(re.findall(r"[^\W\d_]+", apart.lower()))
    return words | {"spannung" for w in words if w.endswith("spannung")}


def _words(heading: str) -> set[str]:
    return words_of(read_heading(heading[: LONGEST_HEADING + 1]).name)


def role_of(heading: str, unit: str) -> tuple[str, int]:
    """Return (t, u, y, target or "", confidence). unit: its key in UNITS if the file gives the unit
    apart from the heading."""
    last = heading.rpartition("/")[2][:LONGEST_HEADING]
    if plain := _PLAIN.fullmatch(last.rpartition(".")[2]):
        return plain[1] or plain[2], PLAIN
    words, kind = _words(heading), kind_of(heading, unit)
    sensed = bool(words & _DISPLACEMENT)
    driven = bool(words & _DRIVE)
    if kind == OTHER or "model" in words:  # a model's prediction is not a measurement
        return "", 0
    if words & _TARGET and kind in (LENGTH, ANGLE, ""):
        return "target", BY_WORD
    if (words & _TIME and kind in (TIME, "")) or {"x", "value"} <= words or {"x", "axis"} <= words:
        return "t", BY_WORD
    if kind == TIME:
        return "t", BY_UNIT
    if sensed and not driven:
        return "y", BY_WORD
    if driven and not sensed:
        return "u", BY_WORD
    if driven and sensed:
        return {VOLTAGE: "u", LENGTH: "y", ANGLE: "y"}.get(kind, ""), BY_UNIT
    if words & _VOLTAGE and kind in (VOLTAGE, ""):
        return "u", BY_WORD
    by_unit = {VOLTAGE: "u", LENGTH: "y", ANGLE: "y", COUNTS: ""}.get(kind, "")
    return by_unit, BY_UNIT if by_unit else 0


def kind_of(heading: str, unit: str) -> str:
    """Return the quantity that a column's unit measures, "" if no unit that is known is given."""
    key = read_heading(heading[: LONGEST_HEADING + 1]).unit or unit
    return UNITS[key][0] if key else ""


def may_be_drive(heading: str, unit: str) -> bool:
    """Return whether a heading such as "Output voltage (V)" or "Voltage measured (V)" may name the
    drive, although one of its words also stands for a displacement."""
    words = _words(heading)
    either = bool(words & _EITHER) and not words & (_DISPLACEMENT - _EITHER)
    return either and bool(words & _VOLTAGE) and kind_of(heading, unit) in (VOLTAGE, "")


def counts_rows(heading: str) -> bool:
    """Return whether a heading is that of row numbers: "", "Unnamed: 0", "index", "Sample"."""
    name, unit = split_heading(heading)
    plain = re.sub(r"unnamed:?|\d|[^\w]", "", name.lower()).strip("_ ")
    return not unit and plain in _ROW
