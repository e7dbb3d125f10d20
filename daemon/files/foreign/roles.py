"""Find the role of a column from its heading."""

import re

from dehyst.daemon.files.foreign.found import Column
from dehyst.daemon.files.foreign.units import (
    ANGLE,
    COUNTS,
    LENGTH,
    LONGEST_HEADING,
    OTHER,
    TIME,
    UNITS,
    VOLTAGE,
    find_unit_key,
    read_heading,
    split_heading,
)
from dehyst.models.units import UNIT_NAMES

NAMES = {"t": "time", "u": "drive", "y": "displacement", "target": "target"}
PLAIN, BY_WORD, BY_UNIT = 3, 2, 1
"""Confidence in a role: dehyst's own name, a known word, the unit alone."""

_TIME = {
    "t",
    "time",
    "times",
    "timestamp",
    "timestamps",
    "zeit",
    "temps",
    "tempo",
    "tiempo",
    "elapsed",
    "seconds",
    "время",
    "χρόνος",
    "čas",
    "czas",
    "zaman",
    "tijd",
    "tid",
    "aika",
    "unixtime",
    "epoch",
    "时间",
    "時間",
    "시간",
}
_TARGET = {
    "target", "setpoint", "soll", "sollwert", "reference", "desired", "commanded", "ref", "setpos",
    "demand", "demanded", "ziel", "consigne",
}  # fmt: skip
_DRIVE = {
    "u", "drive", "input", "driving", "applied", "excitation", "actuation", "ansteuerung", "hv",
    "command", "control", "vin", "uin", "vout", "uout", "actuator", "amplifier", "eingang",
    "stimulus", "generator", "awg", "source",
}  # fmt: skip
_DRIVES = {"u", "drive", "hv", "vin", "uin", "vout", "uout"}
"""Words of a drive that are not those of a controller, whose set points are displacements."""
_MEASURES = {
    "charge", "photodiode", "lock", "lockin", "measuring", "transimpedance", "bridge", "preamp",
    "preamplifier", "messverstärker",
}  # fmt: skip
"""Words of amplifiers that do not drive: "Charge amplifier (V)"."""
_VOLTAGE = {
    "voltage", "volt", "volts", "spannung", "tension", "v", "напряжение", "τάση", "napětí",
    "napięcie", "gerilim", "spanning", "tensione", "voltaje", "tensión", "tensão", "spänning",
    "spænding", "spenning", "jännite", "电压", "電壓", "電圧", "전압",
}  # fmt: skip
_DISPLACEMENT = {
    "y", "displacement", "displ", "disp", "position", "pos", "weg", "auslenkung", "verschiebung",
    "stellweg", "sensor", "gauge", "elongation", "extension", "deflection", "stroke", "measured",
    "interferometer", "strain", "sgs", "capacitive", "vibrometer", "lvdt", "encoder", "deformation",
    "tilt", "angle", "output", "response", "reading", "ausgang", "dehnung", "position_measured",
    "travel",
    "déplacement", "spostamento", "desplazamiento", "deslocamento", "verplaatsing", "förskjutning",
    "forskydning", "forskyvning", "siirtymä", "posizione", "posición", "posição", "positie",
    "смещение", "перемещение", "μετατόπιση", "výchylka", "przemieszczenie", "位移", "変位", "변위",
}  # fmt: skip
_EITHER = {"measured", "output", "response", "ausgang", "reading"}
"""Words that stand for a displacement unless a voltage is named next to them."""
_IN = {"input", "inputs", "in", "eingang", "vin", "uin"}
_OUT = {"output", "outputs", "out", "ausgang", "vout", "uout"}
"""Of the stage or of the instrument: where the column is in volts they do not say which."""
_ANALOG = {"analog", "analogue", "daq"}
_DAQ_IN = {"ai", "adc", "analogeingang", "acquired", "acquisition"}
_DAQ_OUT = {"ao", "dac", "analogausgang", "generated", "generation"}
"""Of a data acquisition device, whose output drives and whose input measures."""
_MONITOR = {"monitor", "mon", "monitored"}
"""Words of an output that shows another voltage divided, which may have a column of its own."""
_NEITHER = {
    "model", "status", "state", "mode", "temp", "temperature", "temperatur", "error", "flag", "std",
    "noise", "wavelength", "thickness", "battery", "supply", "alarm", "expected", "nominal",
    "simulated", "simulation", "sim", "predicted", "prediction", "hat", "fit", "fitted", "residual",
    "residuals",
}  # fmt: skip
"""Words of what is neither drive nor displacement, such as the prediction of a model."""
_OF_EVERY_CHANNEL = {"value", "values", "val", "data"}
_ROW = {
    "", "index", "idx", "no", "nr", "n", "row", "sample", "samples", "point", "sequence", "seq",
    "scan",
}  # fmt: skip
_REAL = {"actual", "measured", "ist", "mesure", "mesuré", "mesurée", "gemessen", "readback"}
"""Words of what was measured, next to what was wanted or calculated."""
_COMPOUND = re.compile(r"(soll|ziel|ist)?\w*?(spannung|position|auslenkung)")
"""A German compound word: "Istposition"."""
_STRESS = re.compile(r"(?:zug|druck|biege|schub|scher|streck|normal|eigen)spannung(?:en)?")
"""Mechanical stress, for which German has the same word as for voltage."""
_PLAIN = re.compile(rf"(?:(t)_s|(u|y|target)_(?:{'|'.join(UNIT_NAMES)}))")


def words_of(name: str) -> set[str]:
    """Return the words of a heading in lower case: "driveVoltage" gives "drive", "voltage". The
    name of a list says nothing about its members: "exp.Y.0.Data" gives "exp", "data"."""
    last = (name.rpartition("/")[2] or name)[: LONGEST_HEADING + 1]  # matching takes its square
    single = re.sub(r"[^./]+\.\d+\.", "", last)
    apart = re.sub(r"(?<=[a-zäöü])(?=[A-Z])", " ", single)
    words = set(re.findall(r"[^\W\d_]+", apart.lower()))
    electrical = [word for word in words if not _STRESS.fullmatch(word)]
    made = [found for word in electrical if (found := _COMPOUND.fullmatch(word))]
    return words | {part for found in made for part in found.groups("")} - {""}


def _words(heading: str) -> set[str]:
    return words_of(read_heading(heading[: LONGEST_HEADING + 1]).name)


def role_of_column(column: Column) -> str:
    """Return t, u, y, target or "" for a column."""
    return role_of(column.heading, find_unit_key(column.unit))[0]


def unit_of_column(column: Column) -> str:
    """Return the key of the unit that the file gives, "" if it gives none."""
    return find_unit_key(column.unit) or split_heading(column.heading)[1]


def own_part(heading: str) -> str:
    """Return a path without a last name that every channel has: "PIEZO:POS-RB/value"."""
    before, mark, last = heading.rpartition("/")
    return before if mark and last.lower() in _OF_EVERY_CHANNEL else heading


def role_of(heading: str, unit: str) -> tuple[str, int]:
    """Return (t, u, y, target or "", confidence). unit: its key in UNITS if the file gives the unit
    apart from the heading."""
    heading = own_part(heading)
    last = heading.rpartition("/")[2][:LONGEST_HEADING]
    if plain := _PLAIN.fullmatch(last.rpartition(".")[2]):
        return plain[1] or plain[2], PLAIN
    words, kind = _words(heading), kind_of(heading, unit)
    if says_neither(heading, unit):
        return "", 0
    side = daq_side(heading, unit)
    if side or kind == VOLTAGE:
        words = words - _IN - _OUT
    words = words - {"amplifier", "lock"} | {"sensor"} if words & _MEASURES else words
    voltage = bool(words & _VOLTAGE) and kind in (VOLTAGE, "")
    of_output = voltage and "voltage of output" in heading.lower()  # "Voltage of output chan1"
    driven = bool(words & _DRIVE) or side == "out" or of_output
    if driven and voltage:  # "Control Voltage of OutputSignal1", as PI's controllers name it
        words = words - _OUT
    sensed = bool(words & _DISPLACEMENT - ({"y"} if driven or voltage else set()))  # axis y
    of_drive = not kind and words & (_VOLTAGE | _DRIVES)  # "pzt_drive_setpoint", in volts
    if words & _TARGET and kind in (LENGTH, ANGLE, "") and not of_drive:
        return "target", BY_WORD
    if (words & _TIME and kind in (TIME, "")) or {"x", "value"} <= words or {"x", "axis"} <= words:
        return "t", BY_WORD
    if kind == TIME:
        return "t", BY_UNIT
    if sensed and not driven:
        return "y", BY_WORD
    if words & _MONITOR and (driven or voltage) and not sensed:
        return "u", BY_UNIT
    if driven and not sensed:
        return "u", BY_WORD
    if driven and sensed:
        return {VOLTAGE: "u", LENGTH: "y", ANGLE: "y"}.get(kind, ""), BY_UNIT
    if voltage:
        return "u", BY_WORD
    by_unit = {VOLTAGE: "u", LENGTH: "y", ANGLE: "y", COUNTS: ""}.get(kind, "")
    return by_unit, BY_UNIT if by_unit else 0


def kind_of(heading: str, unit: str) -> str:
    """Return the quantity that a column's unit measures, "" if no known unit is given."""
    key = unit or read_heading(heading[: LONGEST_HEADING + 1]).unit
    return UNITS[key][0] if key else ""


def says_neither(heading: str, unit: str) -> bool:
    """Return whether a heading is that of neither drive nor displacement: "Amplifier status"."""
    return kind_of(heading, unit) == OTHER or bool(_words(heading) & _NEITHER)


def says_role(heading: str, role: str) -> bool:
    """Return whether a word of a heading names the drive or the displacement, whatever its unit."""
    words = _words(heading)
    return not words & _NEITHER and bool(
        words & (_DRIVE | _VOLTAGE if role == "u" else _DISPLACEMENT)
    )


def names_signal(text: str) -> bool:
    """Return whether a word of a text names the drive, its amplifier or the displacement."""
    words = set(re.findall(r"[^\W\d_]+", text.lower()))
    return bool(words & (_DRIVE | _VOLTAGE | _DISPLACEMENT | {"amp", "piezo"}) - {"v"})


def daq_side(heading: str, unit: str) -> str:
    """Return "out" for "Analog Output (V)" or "AO0", "in" for "Analog Input/CH1", "" for others."""
    if kind_of(heading, unit) not in (VOLTAGE, ""):
        return ""
    words = set[str]().union(*(words_of(part) for part in heading.split("/")))
    analog = bool(words & _ANALOG)
    out = bool(words & _DAQ_OUT) or (analog and bool(words & _OUT))
    measured = bool(words & _DAQ_IN) or (analog and bool(words & _IN))
    return "" if out == measured else "out" if out else "in"


def named_axis(heading: str, unit: str) -> str:
    """Return x, y or z if a heading names only that axis, "" otherwise: "X (um)", but not "X drive
    (V)", "X_Value" or dehyst's own "y_um"."""
    role, sure = role_of(heading, unit)
    words = _words(heading)
    said = words & (_DISPLACEMENT | _DRIVE | _VOLTAGE) - {"y"}
    if sure == PLAIN or role in ("t", "target") or said or says_neither(heading, unit):
        return ""
    return next((axis for axis in "xyz" if axis in words), "")


def names_drive(heading: str) -> bool:
    """Return whether a word other than those of inputs and outputs names the drive."""
    return bool(_words(heading) & _DRIVE - _IN - _OUT)


def may_be_drive(heading: str, unit: str) -> bool:
    """Return whether a heading such as "Output voltage (V)" or "Voltage measured (V)" may name the
    drive, although one of its words also stands for a displacement."""
    words = _words(heading)
    either = bool(words & _EITHER) and not words & (_DISPLACEMENT - _EITHER)
    return either and bool(words & _VOLTAGE) and kind_of(heading, unit) in (VOLTAGE, "")


def shows_another(heading: str) -> bool:
    """Return whether a heading is that of a monitor, which shows another voltage divided."""
    return bool(_words(heading) & _MONITOR)


def is_real(heading: str) -> bool:
    """Return whether a heading says that its numbers were measured: "Actual position"."""
    return bool(_words(heading) & _REAL)


def counts_rows(heading: str) -> bool:
    """Return whether a heading is that of row numbers: "", "Unnamed: 0", "index", "Sample"."""
    name, unit = split_heading(heading)
    plain = re.sub(r"unnamed:?|\d|[^\w]", "", name.lower()).strip("_ ")
    return not unit and plain in _ROW
