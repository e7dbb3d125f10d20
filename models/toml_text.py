"""Parse untrusted TOML: the size is limited before parsing, and every number must be usable.

tomllib itself needs quadratic time for keys of many parts, and accepts integers of any length.
"""

import math
import re
import tomllib
from typing import Any

from dehyst.models.errors import BadInput

LONGEST = 2 << 20
"""Characters of the longest text that is parsed."""
DEEPEST = 32
"""Largest number of parts of a dotted key, for which tomllib needs quadratic time."""
LARGEST = 1e15
"""Numbers above this are damage, not measurements. The square of this still fits a float."""
_PART = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+"""
_DEEP_KEY = re.compile(rf"(?<![\w-]){_PART}(?:{_PART}){{{DEEPEST}}}")


def parse_toml(text: str) -> dict[str, Any]:
    """Return the tables of a TOML text. Raises BadInput, which names the key or line."""
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
    """Raise BadInput if a number is not finite or its magnitude exceeds LARGEST."""
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
