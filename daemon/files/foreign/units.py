"""Spellings of units, and the units in which recordings are kept."""

import math
import re
import unicodedata
from dataclasses import dataclass

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
    "d": (TIME, "s", 86400.0),
    "v": (VOLTAGE, "v", 1.0),
    "mv": (VOLTAGE, "v", 1e-3),
    "kv": (VOLTAGE, "v", 1e3),
    "um": (LENGTH, "um", 1.0),
    "nm": (LENGTH, "nm", 1.0),
    "mm": (LENGTH, "um", 1e3),
    "m": (LENGTH, "um", 1e6),
    "pm": (LENGTH, "nm", 1e-3),
    "angstrom": (LENGTH, "nm", 0.1),
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
TIME_UNITS = ("s", "ms", "us", "ns", "min", "h")
DRIVE_UNITS = ("v", "mv", "kv", "um", "nm", "pm", "mm", "m", "counts", "mrad", "urad")
DISPLACEMENT_UNITS = (*DRIVE_UNITS, "angstrom", "rad", "deg")
_NO_UNIT = {"", "-", "--", "none", "n/a", "na"}
SPELLED = {
    **dict.fromkeys(("sec", "secs", "second", "seconds", "sekunde", "sekunden", "sek"), "s"),
    **{
        word: key
        for key, first in (("ms", "milli"), ("us", "micro"), ("ns", "nano"))
        for word in (
            f"{key[0]}sec", f"{key[0]}secs", f"{first}sec", f"{first}secs", f"{first}second",
            f"{first}seconds", f"{first.replace('c', 'k')}sekunden",
        )
    },
    **{"millis": "ms", "micros": "us"},
    **dict.fromkeys(("minute", "minutes", "minuten"), "min"),
    **dict.fromkeys(("hour", "hours", "hr", "stunden"), "h"),
    **dict.fromkeys(("day", "days", "tag", "tage"), "d"),
    **dict.fromkeys(("volt", "volts", "vdc", "v dc", "volt dc", "volts dc"), "v"),
    **dict.fromkeys(("å", "ångström", "ångstrom", "angstroms"), "angstrom"),
    **dict.fromkeys(("millivolt", "millivolts", "mvolt", "mvolts"), "mv"),
    **dict.fromkeys(("kilovolt", "kilovolts", "kvolt", "kvolts"), "kv"),
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


CASE_DECIDES = {"ms", "ns", "mv", "mvolt", "mvolts", "mm", "nm", "pm", "mrad", "ma"}
"""Units that mean something else with a capital first letter: MV, Mm, Nm. A heading entirely in
capitals may still contain them, except for MV, because megavolts are written the same way."""


def states_no_unit(text: str) -> bool:
    """Return whether a text in the place of a unit is empty, or says that there is none."""
    return text.strip().lower() in _NO_UNIT


def find_unit_key(text: str) -> str:
    """Return the unit's key in UNITS for "µm", "Volt", "[ms]", "s since 2024-03-05" and so on; ""
    if it is not a unit."""
    given = text.strip().strip("[](){}<>").partition(" since ")[0].strip()
    for micro in _MICRO:
        given = given.replace(micro, "u")
    if not given.isascii():  # "㎛", "Ｖ"
        given = unicodedata.normalize("NFKC", given).replace("μ", "u")
    given = _OTHER_SCRIPTS.get(given, given)
    plain = given.lower()
    if len(plain) > 3 and plain.endswith("."):  # "msec."
        plain = plain[:-1]
    if plain in CASE_DECIDES and given[0].isupper() and (plain == "mv" or not given.isupper()):
        return ""
    plain = SPELLED.get(plain, plain)
    return plain if plain in UNITS else ""


_MICRO = ("\\g(m)", "$\\mu$", "\\mu ", "\\mu{}", "\\mu", "Âµ", "µ", "μ")
"""The sign for micro, in Origin, in LaTeX, and as it looks if UTF-8 was read as Latin-1."""
_WIDE = str.maketrans("（）［］，：｜", "()[],:|")
"""Marks as they are written in China and Japan."""
_OTHER_SCRIPTS = {
    "с": "s", "мс": "ms", "мкс": "us", "нс": "ns", "В": "V", "мВ": "mV", "кВ": "kV", "м": "m",
    "мм": "mm", "мкм": "um", "нм": "nm", "秒": "s", "毫秒": "ms", "微秒": "us", "伏": "V",
    "毫伏": "mV", "千伏": "kV", "毫米": "mm", "微米": "um", "纳米": "nm",
    "ミリ秒": "ms", "マイクロ秒": "us", "ナノ秒": "ns", "ボルト": "V", "マイクロメートル": "um",
    "ナノメートル": "nm", "伏特": "V", "초": "s", "밀리초": "ms", "볼트": "V", "밀리볼트": "mV",
    "마이크로미터": "um", "나노미터": "nm", "sn": "s",
}  # fmt: skip
_BRACKETS = re.compile(r"[\[({<]([^\[\](){}<>]*)(?:[\])}>]|$)")
_FACTOR = re.compile(
    r"[x×*·/÷^:]\s*\d|\d\s*[x×*·/÷^]|\de[+-]?\d|[.,]\d|^(?:div|gain|factor).*\d", re.IGNORECASE
)
_FACTOR_OF_NAME = re.compile(
    r"/\s*\d+(?:[.,]\d+)?(?=\s*(?:[\[({_]|[^\W\d_]{1,3}$|$))"  # U/10 V, HV/15 [V]
    r"|(?<=\w)\s*[*×÷·]\s*\d+(?:[.,]\d+)?|^\d+(?:[.,]\d+)?\s*[*×·]\s*(?=\w)"  # 10*U
    r"|(?<=[^\W_])[\s_]+x\s?\d{2,}(?!\w)|(?<!\w)1\s?:\s?\d{2,}(?!\w)"  # Monitor x15, 1:15
    r"|(?<![^\W_])div(?:ided)?(?:[\s_]by)?[\s_]?\d+(?![^\W_])"  # U_div10_V
    r"|(?<=[^\W_])[\s_]+\d{2,}[x×](?![^\W_])"  # Drive 15x (V)
    r"|(?<![^\W_])(?:gain|factor)[\s_:=]*\d+(?:[.,]\d+)?(?![^\W_])",  # Drive (V) gain 15
    re.IGNORECASE,
)
"""A factor next to the name of a column. One digit after an x names an axis, and a number between
two slashes a group."""
_CALLED_UNIT = re.compile(r"^(?:in |units?\s*[:=]\s*)", re.IGNORECASE)
_PER = re.compile(r"([^\W\d_]+[_\s]per[_\s][^\W\d_]+)[\])]?$", re.IGNORECASE)
"""A quotient in words at the end of a heading: "velocity_um_per_s" is not in seconds."""
_BEHIND_A_MARK = re.compile(r"(.*?\S)(\s*(?:[/,;:|='\"]|\bin\b)\s*)(\S+?)['\"]?\s*")
_CAMEL_UNIT = re.compile(
    r"(?<=[a-zäöü]{2})(?:In)?"
    r"((?<=[eptdn])(?:S|[MUN]s)|(?<!torque)(?<!oment)(?:V|Mv|[kK][vV]|[UNMP]m))$"
)
"""A unit at the end of "timeMs" or "driveInKv"."""
_LAST_WORD = re.compile(r"(.*[^\W_].*?|.*[^\W_])[_\s.-]+([^\W\d_]+|°C?|%)\s*")
LETTERS = {
    "h": re.compile(r"t|times?|zeit|elapsed"),
    "c": re.compile(r"temp\w*"),
    "k": re.compile(r"temp\w*"),
    "a": re.compile(r"current|strom"),
    "n": re.compile(r"force|kraft"),
    "m": re.compile(r"(?!)"),
    "с": re.compile(r"t|время"),
    "в": re.compile(r"u|напряжение"),
    "sn": re.compile(r"t|zaman|süre"),
}
"""Units that are also labels, as in "Channel A" and "Sensor_C", or alone ("sn", a serial number),
and the word after which they are units without brackets."""
_REPEATED = re.compile(r"\.\d{1,3}$")
_PREFIX = "(?:da|[YZEPTGMkhdcmuµμnpf])"
_LIKE_A_UNIT = re.compile(
    rf"{_PREFIX}(?:V|m|s|A|C|F|N|W|J|g|T)|{_PREFIX}?(?:bar|Pa|psi|eV|rad|Hz|Ohm|Torr)|inch|mil"
)


_NUMBERED = re.compile(
    r"[,;]\s*(?:point|channel|ch|axis|node|probe|sensor|domain|boundary|edge|run)s?:?\s*\d+\s*$",
    re.IGNORECASE,
)
"""What COMSOL writes after a unit: "Displacement (um), Point: 5" is not divided by 5."""
_RATIO = re.compile(r"(?<![^\W_])(\w+)\s*/\s*\1_?(?:0|max|nom|ref)\b", re.IGNORECASE)
_SHORT_BEHIND_A_MARK = re.compile(r"[,;|=]\s*([^\W\d_]{1,4})[.'\"]?$")
_GLUED = re.compile(r"(?:\d+ ?|(?<![^\W_])[A-Zt])([mkµun]?V|[mµun]s)(?![^\W_])")
"""A unit that nothing sets apart: "Voltage 10V", "UkV", "tms"."""


LONGEST_HEADING = 120


@dataclass(frozen=True)
class Heading:
    """name: without the unit; unit: key in UNITS, "" if no known unit is given; stated: what is
    given as the unit but is not a known one or may be a label, otherwise ""."""

    name: str
    unit: str = ""
    stated: str = ""


_OF_CHANNEL = re.compile(r"(CH\d)(m?V)")
"""A channel with its unit, as Rigol's oscilloscopes write it."""


def read_heading(text: str) -> Heading:
    """Find the unit in a heading: "Time (s)", "U / V", "t_ms", "Displacement [um]". A number that
    makes a repeated heading unique ("Voltage (mV).2") is not part of it."""
    text = text.translate(_WIDE).replace("\\g(m)", "µ").strip().strip("\"'").strip()
    if len(text) > LONGEST_HEADING:  # matching time grows with the square of the length
        return Heading(text)
    plain = _REPEATED.sub("", text)
    plain = _NUMBERED.sub("", plain)
    plain = _CAMEL_UNIT.sub(lambda found: f" {found[1].lower()}", plain)
    plain = plain.rstrip("_.") or plain  # MATLAB and R write "U_mV_" and "U..mV." for "U (mV)"
    if unit := find_unit_key(plain):
        is_unit = plain not in LETTERS if len(plain) > 1 else unit in ("v", "s")
        return Heading("", unit) if is_unit else Heading(text)
    if factor := _factor_beside(plain):
        return factor
    if per := _PER.search(plain):
        return Heading(plain[: per.start()].strip(" _([") or text, "", per[1])
    if _BRACKETS.search(plain):
        return _read_brackets(text, plain)
    if behind := _BEHIND_A_MARK.fullmatch(plain):
        name, mark, last = behind.groups()
        before, _, over = name.replace("_", " ").rpartition(" ")
        unit = find_unit_key(last)
        quotient = "/" in mark and before and unit and find_unit_key(over)
        if quotient and (mark == "/" or len(over) > 1):  # the s in "Weg s / um" is a name
            return Heading(before, "", f"{over}{mark}{last}")
        if unit and (mark.strip() in ("/", "in") or not _may_be_label(name, last)):
            return Heading(name, unit)
        if unit:
            return Heading(text, "", last)
        if _is_like_a_unit(last):
            return Heading(name, "", last)
        if mark.strip() == "/" != mark:
            return Heading(text, "", last)
    if (word := _LAST_WORD.fullmatch(plain)) and word[2].lower() != "d":  # as in "Sensor D"
        if _may_be_label(word[1], word[2]):
            return Heading(text, "", word[2])
        if unit := find_unit_key(word[2]):
            return Heading(word[1].strip(), unit)
        if _is_like_a_unit(word[2]):
            return Heading(word[1].strip(), "", word[2])
    if of_channel := _OF_CHANNEL.fullmatch(plain):
        return Heading(of_channel[1], find_unit_key(of_channel[2]))
    return Heading(text, "", _left_over(plain))


def _left_over(plain: str) -> str:
    """Return what may be a unit or a factor in a heading that gives none otherwise, "" if nothing
    does: "kV Voltage", "UkV", "U, arb", "U/U0"."""
    if factor := _RATIO.search(plain) or _FACTOR_OF_NAME.search(plain):
        return factor[0].strip(" _")
    last = plain.rpartition("/")[2]
    if short := _SHORT_BEHIND_A_MARK.search(last):
        return short[1]
    words = re.findall(r"[^\W\d_]+", f"{last} {re.sub(r'(?<=[a-zäöü])(?=[A-Z])', ' ', last)}")
    like = [word for word in words if len(word) > 1 and _is_like_a_unit(word)]
    return next((word[0] for word in _GLUED.finditer(last)), "") or "".join(like[:1])


def _factor_beside(plain: str) -> Heading | None:
    """Return the heading of numbers that were multiplied or divided before they were written, as
    "U/10 V", "10*Displacement (um)" and "Monitor x15 (V)" say; None if it says nothing of the
    kind."""
    found = _FACTOR_OF_NAME.search(plain)
    if found is None or float(re.findall(r"\d+(?:[.,]\d+)?", found[0])[-1].replace(",", ".")) == 1:
        return None
    rest = read_heading(" ".join(f"{plain[: found.start()]} {plain[found.end() :]}".split()))
    return Heading(rest.name, "", found[0].strip(" _")) if rest.unit else None


def _may_be_label(name: str, letter: str) -> bool:
    """Return whether a letter at the end of a heading may be a label rather than a unit."""
    before = re.findall(r"[^\W\d_]+", name.lower())
    after = LETTERS.get(letter.lower())
    return after is not None and not (before and after.fullmatch(before[-1]))


def _is_like_a_unit(text: str) -> bool:
    """Return whether a text is a unit that is not known, such as "dV", "MS" or "V/mm"."""
    first = re.split(r"[/*·^]", text)[0]
    known = find_unit_key(first) or first.lower() in CASE_DECIDES
    return bool(known or _LIKE_A_UNIT.fullmatch(first))


def is_other_unit(stated: str) -> bool:
    """Return whether what a heading states is a unit, but not a known one: "dV", "x100 V"."""
    like = _is_like_a_unit(stated) or bool(_FACTOR.search(stated))
    return like and not find_unit_key(stated)


def states_factor(stated: str) -> bool:
    """Return whether what a heading states as the unit holds a factor: "x100 V", "V x 0.01"."""
    return bool(_FACTOR.search(stated))


def _read_brackets(text: str, plain: str) -> Heading:
    """Find the unit in a heading with brackets: the only unit in them or after them. Any other
    content may be an unknown unit, or a factor."""
    rest = _BRACKETS.split(plain)[-1]
    behind = rest.strip(" _/,;:.-").removeprefix("in ")
    name, inside = plain, []
    while found := _BRACKETS.search(name):
        inside.append(_CALLED_UNIT.sub("", found[1].strip()))
        name = f"{name[: found.start()]} {name[found.end() :]}"
    name = " ".join(name.split())
    units = {unit for word in inside if (unit := find_unit_key(word))}
    others = [word for word in inside if word and not find_unit_key(word)]
    if len(units) > 1:
        return Heading(name, "", " and ".join(inside))
    if factor := next((word for word in (*others, rest) if _FACTOR.search(word)), ""):
        return Heading(name.removesuffix(rest.strip()).strip(), "", factor.strip())
    if units:
        return Heading(name if not others else text, units.pop())
    marked = re.match(r"\s*(?:/|in\b)", rest) or not _may_be_label("", behind)
    if others and marked and (unit := find_unit_key(behind)):
        return Heading(text, unit)
    words = all(re.fullmatch(r"[\w\s-]+", w) and not _is_like_a_unit(w) for w in others)
    return Heading(text if words else name, "", others[0] if others else "")


def split_heading(text: str) -> tuple[str, str]:
    """Split a heading into (name, unit's key); the unit is "" if no known one is given."""
    found = read_heading(text)
    if found.unit:
        return found.name, found.unit
    return text.strip().strip("\"'").strip(), ""
