"""Find what a file states in addition to its arrays: names and units of their columns, and the
period."""

import math
import re
from collections.abc import Iterable, Mapping, Sequence

from dehyst.daemon.files.foreign.fields import number_of
from dehyst.daemon.files.foreign.found import Column
from dehyst.daemon.files.foreign.headings import apart
from dehyst.daemon.files.foreign.roles import names_signal, role_of
from dehyst.daemon.files.foreign.stated_step import SAME_STEP, stated_step
from dehyst.daemon.files.foreign.units import (
    TIME,
    UNITS,
    find_unit_key,
    read_heading,
    split_heading,
    states_no_unit,
)

UNIT_FIELDS = ("unit", "units", "unit_string")
UNITS_OF_Y = ("yunit", "yunits")  # oscilloscopes' structures of one channel; x is the time
FACTOR_FIELDS = {
    "scale", "scaling", "scalingfactor", "scalefactor", "factor", "gain", "multiplier",
    "conversion", "conversionfactor", "calibration", "calibrationfactor", "cal", "sensitivity",
    "slope", "lsb", "yinc", "yincrement",
}  # fmt: skip
"""Names, without "_", of a factor by which the numbers next to it may still have to be
multiplied."""
APPLIED = ("scale_factor", "add_offset")
"""Attributes of the CF conventions, which the reader applies."""
_FACTOR_IN_WORDS = re.compile(
    r"(?P<of>(?:[^\W\d_]+ ){0,3}?)(?:gain|scal(?:e|ing)(?:[ _-]?factor)?|multiplier|sensitivity"
    r"|conversion(?:[ _]factor)?|calibration(?:[ _]factor)?|factor|faktor|slope|divider|teiler"
    r"|amplification|verstärkung|attenuation)(?![^\W\d_])(?!\W*(?:dat(?:e|um)|due|file|cert|no\b))",
    re.IGNORECASE,
)
_N = r"\d+(?:\.\d+)?"
_VOLTS, _LENGTH = r"[mkuµμ]?V\b", r"(?:[nuµμ]m|microns?)\b"
_SIGNAL = rf"(?:{_VOLTS}|{_LENGTH})"
_IS = r"\s*(?:=>?|≙|corresponds? to|equals?|entspr\w+)\s*"
_LOW = r"(?<![\d.])(?:10|\d)(?:\.\d+)? ?"
"""Volts of a gauge's output or an amplifier's input; "12 um / 100 V" is the stroke of a stage."""
_BY = re.compile(
    rf"(?:multipl|divid|scal|amplif|attenuat)\w+ (?:by|with) {_N}(?: ?/ ?{_N})?"
    rf"|factor of {_N}|(?<!\d )\bV/\d+"
    r"|(?<=[,;:(|] )(?:gain|factor|slope|sensitivity)\b\s*[:=]?\s*\d+(?:\.\d+)?"
    rf"|{_N} ?{_VOLTS} ?(?:/|per) ?(?:{_N} ?)?[mk]?V\b"
    rf"|{_N} ?{_LENGTH} ?(?:/|per) ?(?:{_LOW})?[mk]?V\b"
    rf"|\b{_SIGNAL} ?(?:/|per) ?[mk]?V\b\s*[:=]?\s*{_N}"
    rf"|{_N} ?{_VOLTS}{_IS}(?:{_N} ?- ?)?{_N} ?{_VOLTS}"
    rf"|{_LOW}{_VOLTS}{_IS}(?:{_N} ?- ?)?{_N} ?{_LENGTH}"
    rf"|{_N} ?{_LENGTH}{_IS}{_LOW}{_VOLTS}"
    rf"|\A(?:(?:[x×*÷] ?{_N}|{_N} ?[x×])(?:[\s,;]+|\Z))+\Z",
    re.IGNORECASE,
)
"""A factor inside a line: "multiply by 10", "channel 1: Voltage, slope 10, offset 0", "2 um/V",
"1 V = 15 V", or a line of factors, "x1,x15"."""
_OF_SIGNAL = re.compile(
    rf"(?<![\w.])(?:x{_N}|[×*÷] ?{_N}|{_N} ?x(?! ?\w)|{_N} ?[×*](?! ?\d|[\w*]))(?![\w.])"
    rf"|(?<=[^\W\d])\s?/ ?{_N}(?![\w./-])(?! {_SIGNAL})"
    rf"|(?<![\w:.])1 ?: ?\d{{2,}}(?![\w:.])|(?:times|reduced by) {_N}",
    re.IGNORECASE,
)
"""A factor after the name of the drive, its amplifier or the displacement: "HV amp: 15x"."""
_BEGINS_WITH = re.compile(r"\s*[x×]?\s*([-+]?\d+(?:\.\d*)?(?:e[-+]?\d+)?)", re.IGNORECASE)
_NUMBERS = re.compile(r"\d+(?:[.,]\d+)?(?:e[-+]?\d+)?", re.IGNORECASE)
_PER_COUNT = re.compile(r"(?:[^\W\d_]{1,3}_?)?per_?(?:count|lsb|bit|v|volts?)", re.IGNORECASE)
_MARKS = ("", *"._/")
_REPEATED = re.compile(
    r"averag|cycl|repe|sampl|decim|zykl|mittel|sweep|runs|pass|loops|ramp|triang|sine|wave|burst|step",
    re.IGNORECASE,
)
"""Words for what is done several times; a number next to one is a count, not a factor."""
_OF_DISPLAY = re.compile(r"[mkuµμ]?V(?:olts?)? ?(?:/|per) ?div", re.IGNORECASE)
"""The scale of an oscilloscope's screen, which is not the unit of the numbers."""
_NUMBERS_OF = re.compile(r"_?(?:data|values?)\Z", re.IGNORECASE)
"""The end of the name of a signal's numbers, next to "OutputUnit" or "Channel_2_Header"."""
_HEADER = re.compile(r"_(?:header|info)[./](\w+)\Z", re.IGNORECASE)
LABEL_FIELDS = ("label", "name", "title", "long_name", "signalname")
LONGEST_LABEL = 60
_LISTS_NAMES = re.compile(
    r"(?!dim)(?:.*(?:name|column|head|label|field|channel|variable|item))", re.I
)
"""What a list of names is called. Other lists, such as "plots", may be in another order; those of
HDF5's dimensions name no columns."""
_BEGINS = re.compile(
    r"[tx]_?0|t_?start|(?:start|begin)_?time|time_?(?:start|offset)|x_?org|x_?origin", re.I
)
"""Names of the time at which an array begins."""
_OF_TIME = re.compile(
    rf"{_BEGINS.pattern}|rate|freq|period|interval|time|inc|delta|d[tx]|[ft]s|abtast|samples|unit",
    re.IGNORECASE,
)
"""Parts of the names of notes that may state a period or a beginning, or its unit."""
_PORT = re.compile(r"(?:In|Out)\d*")
"""The last part of a signal's name in a block diagram, if that part says nothing."""


def group_of(heading: str) -> str:
    """Return the path in front of the last name, with its separator: "rec.drive." of
    "rec.drive.x"."""
    return re.sub(r"[^/.]+$", "", heading)


def names_beside(
    stem: str, width: int, lists: Mapping[str, Sequence[str]]
) -> tuple[Sequence[str], Sequence[str]]:
    """Return (names, units) of an array's columns, from the lists of texts next to it: a list that
    is called one of names and has one text per column, and a list of units; () if there is none, or
    if there are several that differ and none belongs to the array by its name. stem: the array's
    name."""
    fitting = {key: list(texts) for key, texts in lists.items() if len(texts) == width > 1}
    units = {key: texts for key, texts in fitting.items() if _lists_units(texts)}
    names = {key: texts for key, texts in fitting.items() if key not in units}
    names = {k: v for k, v in names.items() if _LISTS_NAMES.match(k) and len(set(v)) == width}
    return _one_of(stem, names), _one_of(stem, units)


def unit_in_lists(heading: str, lists: Mapping[str, Sequence[str]]) -> str:
    """Return the unit of a column from a list of units next to a list of names that contains the
    column's name, in its group or one within it, as MATLAB stores those of a table; "" if there is
    none."""
    group = group_of(heading)
    found = {
        units[names.index(heading[len(group) :])]
        for key, names in lists.items()
        if key.startswith(group) and heading[len(group) :] in names and _LISTS_NAMES.match(key)
        for other, units in lists.items()
        if group_of(other) == group_of(key) and len(units) == len(names) and _lists_units(units)
    }
    unit = found.pop() if len(found) == 1 else ""
    return "" if states_no_unit(unit) else unit


def _lists_units(texts: Sequence[str]) -> bool:
    """Return whether each text is a unit or says that there is none."""
    stated = [text for text in texts if not states_no_unit(text)]
    return bool(stated) and all(map(find_unit_key, stated))


def _one_of(stem: str, lists: Mapping[str, Sequence[str]]) -> Sequence[str]:
    """Return the list to use: the only one, or the one whose name begins like the array's."""
    alike = {key: _alike(key.lower(), stem.lower()) for key in lists}
    best = [texts for key, texts in lists.items() if alike[key] == max(alike.values())]
    return best[0] if best and all(texts == best[0] for texts in best) else ()


def _alike(one: str, other: str) -> int:
    """Return how many letters two names have in common at their beginning."""
    pairs = zip(one, other, strict=False)
    return next((i for i, (a, b) in enumerate(pairs) if a != b), min(len(one), len(other)))


def name_columns(columns: Sequence[Column], names: Sequence[str], units: Sequence[str]) -> None:
    """Give the columns of one array their names and units. () leaves them as they are."""
    for column, name in zip(columns, apart([" ".join(n.split()) for n in names]), strict=False):
        array = column.heading.rpartition(".")[0]
        column.heading = f"{array}/{name}" if array and name else name or column.heading
    for column, unit in zip(columns, units, strict=False):
        column.unit = column.unit or ("" if states_no_unit(unit) else unit)


def unit_beside(heading: str, notes: Mapping[str, str]) -> str:
    """Return the unit that a file states for an array, "" if it states none: "units.drive" or
    "drive_unit" for "drive", "rec.drive.unit" or "signals.0.label" ("Drive [mV]") for
    "rec.drive.data". The unit of a structure is not that of the times in it."""
    if unit := _own_unit(heading, notes):
        return unit
    beside = _notes_beside(heading, notes)
    stated = [beside[key] for key in (*UNIT_FIELDS, *UNITS_OF_Y) if key in beside]
    stated += [split_heading(beside[key])[1] for key in LABEL_FIELDS if key in beside]
    if role_of(heading[len(group_of(heading)) :], "")[0] == "t":
        stated = [unit for unit in stated if UNITS.get(find_unit_key(unit), ("",))[0] == TIME]
    return next(filter(None, stated), "")


def notes_of_time(notes: Mapping[str, str]) -> dict[str, str]:
    """Return the notes that `wave_beside` has to look through for each of many arrays."""
    return {k: v for k, v in notes.items() if _OF_TIME.search(k[len(group_of(k)) :])}


def wave_beside(name: str, notes: Mapping[str, str]) -> tuple[float, float] | None:
    """Return (beginning, period or 0) [s] that a file states for one array or its group, None if it
    states neither."""
    step, begins = 0.0, list[float]()
    for front in _fronts(name):
        own = {k[len(front) :]: text for k, text in notes.items() if k.startswith(front)}
        own = {key: text for key, text in own.items() if not re.search(r"[/.]", key)}
        step = step or period_in(own)
        begins += [at for key, text in own.items() if (at := _beginning(key, text)) is not None]
    return (begins[0] if begins else 0.0, step) if step or begins else None


def period_of_all(notes: Mapping[str, str], names: Sequence[str]) -> tuple[float, bool]:
    """Return the sampling period [s] that a file states for all arrays, or else for any of them, 0
    if none is stated, or if two contradict each other; and whether it holds for some of them
    only."""
    fronts = tuple({front for name in names for front in _fronts(name)})
    general = {key: text for key, text in notes.items() if not key.startswith(fronts)}
    period = period_in(general)
    return period or period_in(notes), not period


def _fronts(name: str) -> list[str]:
    """Return the prefixes of the notes that belong to one array, its own name first."""
    group = group_of(name).rstrip("/.")  # of which HDF5 has attributes: "group.rate"
    fronts = (f"{name}.", f"{name}/", f"{name}_", f"{group}.", f"{group}/")
    return [front for front in fronts if front[1:]]


def _beginning(key: str, text: str) -> float | None:
    """Return the time [s] of "t0" or "start_time", None for another note."""
    heading = read_heading(key)
    kind, _, factor = UNITS.get(heading.unit or "s", ("", "", 0.0))
    if kind != TIME or not _BEGINS.fullmatch(heading.name or key):
        return None
    at = number_of(text)
    return None if at is None or not math.isfinite(at) else factor * at


def _own_unit(heading: str, notes: Mapping[str, str]) -> str:
    """Return the unit that is stated for an array or a number by its own name."""
    group = group_of(heading)
    own = heading[len(group) :]
    names = [
        name
        for field in UNIT_FIELDS
        for name in (f"{field}.{own}", f"{field}/{own}", f"{own}_{field}", f"{own}.{field}")
    ]
    signals = (own, _NUMBERS_OF.sub("", own))  # "OutputUnit" for "OutputData"
    names += [f"{signal}{field}" for signal in signals if signal for field in ("Unit", "Units")]
    while True:  # "units.drive" or "drive_unit", in its group or one around it
        for name in names:
            if unit := notes.get(group + name, ""):
                return unit
        if not group:
            return ""
        group = group_of(group.rstrip("/."))


def factor_beside(heading: str, notes: Mapping[str, str], is_alone: bool) -> str:
    """Return the factor, and the offset, that a file states beside an array without saying whether
    its numbers were multiplied, as part of a unit that is then asked for: " x 15", "" where it
    states none. is_alone: whether no other array is in its structure."""
    group = group_of(heading)
    own = heading[len(group) :]
    stems = [own, *{split_heading(own)[0]} - {own, ""}]  # "pos_scale" next to "pos_um"
    factor, offset = 1.0, 0.0
    for name, text in notes.items():
        applied = name in (f"{heading}.{used}" for used in APPLIED)
        if not name.startswith(group) or (applied and number_of(text) is not None):
            continue
        rest = name[len(group) :]
        stem = next((s for s in stems if rest.startswith(s) and rest[len(s) :][:1] in _MARKS), "")
        if stem:
            rest = rest[len(stem) + 1 :]
        elif not (is_alone and group):
            continue
        field = rest.lower().replace("_", "")
        is_factor = field in FACTOR_FIELDS or _PER_COUNT.fullmatch(rest)
        factor = _number(text, factor) if is_factor else factor
        offset = _number(text, offset) if field in ("offset", "yorg", "yorigin") else offset
    if (factor, offset) == (1.0, 0.0):
        return ""
    return f" x {factor:g}" + (f" + {offset:g}" if offset else "")


def factor_in_words(notes: Mapping[str, str]) -> str:
    """Return the line of a preamble that states a factor other than 1 of drive or displacement, ""
    if none does: "Scale factor,10,2", "HV amplifier gain = 10 V/V", "multiply by 10"."""
    for text in (f"{name} {value}".strip() for name, value in notes.items()):
        if _OF_DISPLAY.search(text):
            continue
        stated = _FACTOR_IN_WORDS.match(text)
        if stated and stated["of"] and not names_signal(stated["of"]):
            stated = None
        found = _BY.search(text)
        if not found and not _REPEATED.search(text):
            behind = _OF_SIGNAL.search(text)
            found = behind if behind and names_signal(text[: behind.start()]) else None
        rest = text[stated.end() :] if stated else found[0] if found else ""
        if any(float(number.replace(",", ".")) != 1.0 for number in _NUMBERS.findall(rest)):
            return text[:60]
    return ""


def factor_of_all(notes: Mapping[str, str], groups: Iterable[str]) -> str:
    """Return the number next to arrays that is called a factor and is not 1, "" if there is none:
    "gain", "amplifier_gain". groups: of the arrays."""
    own = {"", *groups}
    numbers = {
        name[len(group) :].replace("_", " "): text
        for name, text in notes.items()
        if (group := group_of(name)) in own and number_of(text) is not None
    }
    return factor_in_words(numbers)


def _number(text: str, otherwise: float) -> float:
    """Return the number with which a text begins: "20 V/V", "x20"."""
    found = _BEGINS_WITH.match(text)
    return float(found[1]) if found else otherwise


def label_beside(heading: str, notes: Mapping[str, str], is_alone: bool) -> str:
    """Return the name that a file states for an array in the header next to it, or in its structure
    if no other array is there: "signals.0.label" for "signals.0.values"; "" if it states none."""
    beside = _notes_beside(heading, notes) if is_alone else _header_of(heading, notes)
    return next((beside[key] for key in LABEL_FIELDS if beside.get(key)), "")


def _notes_beside(heading: str, notes: Mapping[str, str]) -> dict[str, str]:
    """Return the texts in the header next to an array, or in its structure, by their own names; {}
    for one that is itself a unit, or has neither."""
    group = group_of(heading)
    if heading[len(group) :].lower() in UNIT_FIELDS:
        return {}
    header = _header_of(heading, notes)
    if not group or header:
        return header
    return {
        name[len(group) :].lower(): text for name, text in notes.items() if name.startswith(group)
    }


def _header_of(heading: str, notes: Mapping[str, str]) -> dict[str, str]:
    """Return the texts of the header next to an array, by their own names: those of
    "Channel_2_Header" for "Channel_2_Data"."""
    signal = _NUMBERS_OF.sub("", heading)
    if signal in (heading, group_of(heading)):
        return {}
    own = (name for name in notes if name.startswith(signal))
    found = {name: _HEADER.fullmatch(name, len(signal)) for name in own}
    return {field[1].lower(): notes[name] for name, field in found.items() if field}


def labelled(heading: str, label: str) -> str:
    """Return the heading of an array to which the file gives a label: its group, and the last part
    of the label that says something ("Root/Drive [V]/Out1" is "Drive [V]"). An array whose own name
    says what it is keeps it."""
    if role_of(heading, "")[0]:
        return heading
    parts = [part.strip() for part in re.split(r"/(?![^\[({]*[\])}])(?=\S)", label)]
    said = [part for part in parts if part and not _PORT.fullmatch(part)]
    if not said or len(said[-1]) > LONGEST_LABEL:
        return heading
    return f"{group_of(heading).rstrip('/.')}/{said[-1]}".lstrip("/")


def _own_name(name: str) -> str:
    """Return the last part of a path; the rate next to NWB's starting time is that of the rows."""
    *_, before, last = ["", *re.split(r"[/.]", name)]
    return "sampling rate" if (before, last) == ("starting_time", "rate") else last


def period_in(notes: Mapping[str, str]) -> float:
    """Return the sampling period [s] in values by name such as {"rec.Fs": "1", "rec.Fs_unit":
    "kHz"}, 0 if none states one, or if two contradict each other."""
    cells = (
        [_own_name(name), value, *filter(None, [_own_unit(name, notes)])]
        for name, value in notes.items()
    )
    steps = [step for pair in cells if (step := stated_step(pair, "."))]
    return steps[0] if steps and max(steps) <= (1.0 + SAME_STEP) * min(steps) else 0.0
