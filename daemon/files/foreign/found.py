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
