"""Name options as the caller knows them: `--force` on the command line, `force=True` in Python.

Messages are written for the command line. The functions and results of `import dehyst` pass theirs
through `in_callers_words`, which names the parameters instead, unless a command is running.
"""

import re
from collections.abc import Iterator
from contextlib import contextmanager

PARAMETERS = {
    "force": "force=True",
    "static": "rate=False",
    "take-over": "take_over()",
    "rate": "rate_hz",
    "min": "low",
    "max": "high",
    **{name: name for name in ("columns", "unit", "order", "saturation", "bias", "preview")},
    **{name: name for name in ("mode", "slew", "start", "period", "model")},
    **{name: name.replace("-", "_") for name in ("rate-hz", "time-unit", "drive-unit")},
}
"""The parameter of dehyst's functions that an option of a command sets."""
OF_READING = {"columns", "rate", "rate-hz", "time-unit", "drive-unit", "unit"}
"""Options that only `load_recording` has in Python."""
_NUMBER = r"-?(?:\d[\d.e+-]*\d|\d|nan|inf)(?![\w])"
_CHOICES = r"\w+(?:(?:,\ (?:or\ )?|\ or\ )\w{1,6}\b)*"
_COLUMNS = r"""(?:\w+=(?:"[^"]*"|[\w.]+))(?:,\w+=(?:"[^"]*"|[\w.]+))*"""
_OPTION = re.compile(
    rf"""
      --(?P<units>time-unit|drive-unit|unit)\ (?!and\b)(?P<choices>{_CHOICES})
    | --(?P<columns>columns)\ (?P<pairs>{_COLUMNS})
    | --(?P<name>[a-z]+(?:-[a-z]+)*)(?:[ =](?P<value>{_NUMBER}|[A-Z]+\b))?
    """,
    re.VERBOSE,
)
_commands = 0


@contextmanager
def at_command_line() -> Iterator[None]:
    """Within the block a command is running, in any thread, so messages keep its options."""
    global _commands
    _commands += 1
    try:
        yield
    finally:
        _commands -= 1


def in_callers_words(text: str, function: str = "") -> str:
    """Return a message with every option under the name that the caller uses. function: the one
    that was called, which matters for the options of reading: only `load_recording` has them."""
    return text if _commands else in_python_words(text, function)


def in_python_words(text: str, function: str = "") -> str:
    """Return a message with the parameters of dehyst's functions for the options of commands."""
    of_reading = False

    def named(found: re.Match[str]) -> str:
        nonlocal of_reading
        option = found["units"] or found["columns"] or found["name"]
        if option not in PARAMETERS:  # of a command that has no function
            return found[0]
        of_reading = of_reading or (option in OF_READING and function != "invert")
        name = PARAMETERS[option]
        if found["choices"]:
            return f"{name}=" + re.sub(r"\b(?!or\b)(\w+)", r'"\1"', found["choices"])
        if found["pairs"]:
            return f"{name}='{found['pairs']}'"
        return f"{name}={found['value']}" if found["value"] else name

    said = _OPTION.sub(named, text)
    if of_reading and function not in ("", "load_recording"):
        return f"{said} (of dehyst.load_recording)"
    return said
