"""Raw content of a foreign file, and the recording that is made of it. Pure data."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from dehyst.models.recording import Floats


@dataclass
class Column:
    """One column: its heading, or ""; its unit if the file gives it apart from the heading, or "";
    (N,) values; clock: the file gave timestamps, which were converted to seconds; number: in the
    file, from 0, where columns without numbers count as well (-1: as in its Sheet); wave:
    (beginning, period or 0) [s] that the file states for it alone, or None."""

    heading: str
    values: Any
    unit: str = ""
    clock: bool = False
    number: int = -1
    wave: tuple[float, float] | None = None


@dataclass(frozen=True)
class Given:
    """An array of a file: its name with its path; (N,) or (N, M) values, or texts; unit, label:
    stated for the whole of it; names, units: for each of its columns, or (); wave: as of a
    Column."""

    name: str
    values: Any
    unit: str = ""
    label: str = ""
    names: Sequence[str] = ()
    units: Sequence[str] = ()
    wave: tuple[float, float] | None = None


@dataclass
class Sheet:
    """Columns in the file's order; notes: by name; step_s: sampling period that the file states;
    start_s: time of its first row; said: further remarks on the format; where: describes the place
    of a row in the file; factor: words of its preamble that state one, or ""; blank: by heading of
    the columns that hold no number, the first field if it begins like one; of_some: step_s is
    stated for some of the columns only; empty: for each row of empty fields between the numbers,
    how many rows of numbers precede it; blank_lines: between the numbers; stacked: why each row has
    the value of one channel only, or ""."""

    columns: list[Column]
    notes: dict[str, str] = field(default_factory=dict)
    step_s: float = 0.0
    start_s: float = 0.0
    said: list[str] = field(default_factory=list)
    where: Callable[[int], str] = field(default=lambda row: f"row {row + 1}")
    factor: str = ""
    blank: dict[str, str] = field(default_factory=dict)
    of_some: bool = False
    empty: list[int] = field(default_factory=list)
    blank_lines: int = 0
    stacked: str = ""

    def __post_init__(self) -> None:
        for i, column in enumerate(self.columns):
            column.number = i if column.number < 0 else column.number


@dataclass
class Draft:
    """A recording as far as a file was understood. columns: (N,) each, named as in a recording;
    said: what each was made of; asked: what the user has to supply; offered: how to name a drive or
    a displacement that is not required, ""."""

    columns: dict[str, Floats] = field(default_factory=dict)
    said: list[str] = field(default_factory=list)
    asked: list[str] = field(default_factory=list)
    offered: str = ""


def text_of(given: str | bytes) -> str:
    """Return text of a file in a form that can be written: UTF-8, or Latin-1 if it is not UTF-8, as
    older programs wrote. A str holds such bytes as lone surrogates if a library did not decode
    them."""
    try:
        raw = given if isinstance(given, bytes) else given.encode("utf-8", "surrogateescape")
    except UnicodeEncodeError:  # an unpaired UTF-16 surrogate
        return str(given).encode("utf-8", "replace").decode()
    try:
        return raw.decode()
    except UnicodeDecodeError:
        return raw.decode("latin-1")
