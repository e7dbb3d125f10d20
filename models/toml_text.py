"""TOML from anybody: bounded before it is parsed, and every number one that can be computed with.

tomllib itself takes quadratic time for keys of many parts, and takes integers of any length.
"""

import math
import re
import tomllib
from typing import Any

from dehyst.models.errors import BadInput

LONGEST = 2 << 20
DEEPEST = 32
LARGEST = 1e15
"""Beyond this a number is damage, not a measurement; its square still fits a float."""
_PART = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+"""
_DEEP_KEY = re.compile(rf"(?<![\w-]){_PART}(?:{_PART}){{{DEEPEST}}}")


def parse_toml(text: str) -> dict[str, Any]:
    """The tables of a TOML text. Raises BadInput, with the key where one is wrong."""
    if len(text) > LONGEST:
        raise BadInput(f"{len(text)} characters; at most {LONGEST} are read")
    deep = _DEEP_KEY.search(text)
    if deep:
        line = text.count("\n", 0, deep.start()) + 1
        raise BadInput(f"line {line}: a key of more than {DEEPEST} parts")
    try:
        data = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise BadInput(f"not a TOML file: {str(error)[:200]}") from None
    _check_numbers(data, "")
    return data


def _check_numbers(value: Any, name: str) -> None:
    """BadInput where a number is not finite or beyond what can be computed with."""
    if isinstance(value, dict):
        for key, inner in value.items():
            _check_numbers(inner, f"{name}.{key}" if name else key)
    elif isinstance(value, list):
        for i, inner in enumerate(value):
            _check_numbers(inner, f"{name}[{i}]")
    elif isinstance(value, float) and not math.isfinite(value):
        raise BadInput(f"{name}: must be a finite number, not {value}")
    elif isinstance(value, int | float) and abs(value) > LARGEST:
        raise BadInput(f"{name}: a number beyond {LARGEST:g}")
