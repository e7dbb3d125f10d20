"""What a reader finds in somebody else's file, before it is understood. Pure data."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any


@dataclass
class Column:
    """One column: its heading, "" where there is none; its unit where the file gives one beside
    the heading, "" otherwise; (N,) values; clock: the file gave moments, now seconds."""

    heading: str
    values: Any
    unit: str = ""
    clock: bool = False


@dataclass
class Sheet:
    """Columns in the file's order; notes: by name; step_s: the sampling period that the file
    states; start_s: the time of its first row; said: what else was understood of the form.
    where: a place of the file in words, from a row."""

    columns: list[Column]
    notes: dict[str, str] = field(default_factory=dict)
    step_s: float = 0.0
    start_s: float = 0.0
    said: list[str] = field(default_factory=list)
    where: Callable[[int], str] = field(default=lambda row: f"row {row + 1}")


def text_of(given: str | bytes) -> str:
    """Text of a file as it can be written: UTF-8, or Latin-1 where it is none, as older programs
    wrote. A str holds such bytes as lone surrogates where a library did not decode them."""
    try:
        raw = given if isinstance(given, bytes) else given.encode("utf-8", "surrogateescape")
    except UnicodeEncodeError:  # half a pair of UTF-16
        return str(given).encode("utf-8", "replace").decode()
    try:
        return raw.decode()
    except UnicodeDecodeError:
        return raw.decode("latin-1")
