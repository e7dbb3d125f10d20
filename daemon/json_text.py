"""JSON for programs and terminals: NaN and infinity become null, and all of it is ASCII."""

import re
import sys
from typing import Any

import msgspec
import numpy as np

from dehyst.daemon.printable import in_utf8


def json_text(value: Any, indent: int = -1) -> str:
    """Return the JSON text of a message, or of nested maps, lists, texts and numbers: on one line
    unless `indent` is given."""
    try:
        encoded = msgspec.json.encode(value, enc_hook=_number)
    except UnicodeEncodeError:  # the name of a file that is not UTF-8
        encoded = msgspec.json.encode(_in_utf8(msgspec.to_builtins(value, enc_hook=_number)))
    text = msgspec.json.format(encoded, indent=indent).decode()
    # JSON escapes characters below the space; terminals also interpret others
    return re.sub("[^ -~\n]", _escape, text)


def print_json(value: Any) -> None:
    """Print one JSON value on stdout."""
    print_json_line(value, indent=2)


def print_json_line(value: Any, indent: int = -1) -> None:
    """Print one JSON value on stdout, on one line unless `indent` is given."""
    sys.stdout.write(json_text(value, indent) + "\n")


def _in_utf8(value: Any) -> Any:
    """Return nested maps, lists and texts with all texts in UTF-8."""
    if isinstance(value, dict):
        return {_in_utf8(key): _in_utf8(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_in_utf8(one) for one in value]
    return in_utf8(value) if isinstance(value, str) else value


def _number(value: Any) -> Any:
    """Return a numpy number as a Python number."""
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{type(value).__name__} has no JSON form")


def _escape(mark: re.Match[str]) -> str:
    units = mark.group().encode("utf-16-be")
    return "".join(f"\\u{units[i]:02x}{units[i + 1]:02x}" for i in range(0, len(units), 2))
