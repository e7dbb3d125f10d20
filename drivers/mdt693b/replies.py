"""The form of the reply to each MDT693B command: the codec's only table.

The dialect defines the framing around a payload (see codec.py). This table defines what the payload
looks like, and what ends it in the legacy dialect, whose framing is irregular.
"""

import re
from dataclasses import dataclass
from enum import Enum


class Ends(Enum):
    """What ends a reply in the legacy dialect (in the modern one it is always the prompt)."""

    ACK = "ack"  # a set: the acknowledging byte itself
    LINE = "line"  # the first complete bracket line
    SILENCE = "silence"  # nothing marks the end


@dataclass(frozen=True)
class Form:
    """The form of a command's reply. pattern: of the payload, None for a set, whose reply is an
    acknowledgement; blank: an empty payload is a valid answer."""

    ends: Ends
    pattern: re.Pattern[bytes] | None = None
    blank: bool = False


_BRACKET = re.compile(rb"\[ *(?P<value>[^\[\]]*?) *\]")
_NUMBER = re.compile(rb"\[? *(?P<value>-?\d+(?:\.\d+)?) *\]?")
_DECIMAL = re.compile(rb"\[? *(?P<value>-?\d+\.\d+) *\]?")
_WHOLE = re.compile(rb"\[ *(?P<value>\d+) *\]")
_TEXT = re.compile(rb"(?P<value>.*)", re.DOTALL)
_SET = Form(Ends.ACK)
_VALUE = Form(Ends.SILENCE, _NUMBER)
_VOLTS = Form(Ends.LINE, _DECIMAL)
_LIMIT = Form(Ends.SILENCE, _WHOLE)  # cannot be mistaken for a voltage: used to get in step
_FLAG = Form(Ends.SILENCE, _BRACKET)
_LINES = Form(Ends.SILENCE, _TEXT, blank=True)

FORMS: dict[str, Form] = {
    # Reply forms, keyed by the command without its axis letter.
    "": _SET,  # an empty line: answered by an error
    "voltage?": _VOLTS,
    "r?": _VOLTS,
    "xyzvoltage?": Form(Ends.LINE, _BRACKET),
    "voltage=": _SET,
    "xyzvoltage=": _SET,
    "min?": _VALUE,
    "max?": _VALUE,
    "l?": _VALUE,
    "h?": _VALUE,
    "vlimit?": _LIMIT,
    "%": _LIMIT,
    "sysmin?": _VALUE,
    "sysmax?": _VALUE,
    "msvoltage?": _LINES,  # not recorded from a real unit yet: parsed leniently
    "msenable?": _LINES,
    "dacstep?": _VALUE,
    "intensity?": _VALUE,
    "rotarymode?": _LINES,
    "pushdisable?": _LINES,
    "cm?": _FLAG,
    "echo?": _FLAG,
    "echo=": _FLAG,  # unlike every other setter it is answered by a bracket line
    "e": _SET,
    "id?": _LINES,
    "serial?": _LINES,
    "friendly?": _LINES,
    "?": _LINES,
}

_COMPATIBLE_SET = re.compile(r"[xyz][vlh]-?[\d.]+")


def form_of(command: str) -> Form:
    """Return the reply form of a command line; that of a set if the command is not in the table."""
    key = command.strip().lower()
    if "=" in key:
        key = key[: key.index("=") + 1]
    if key in FORMS:
        return FORMS[key]
    if key[:1] in ("x", "y", "z") and not _COMPATIBLE_SET.fullmatch(key):
        return FORMS.get(key[1:], _SET)
    return _SET
