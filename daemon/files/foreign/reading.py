"""Options for reading a file of another program where the file itself lacks information."""

import argparse
import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from dehyst.daemon.files.foreign.units import (
    DISPLACEMENT_UNITS,
    DRIVE_UNITS,
    TIME_UNITS,
    find_unit_key,
)
from dehyst.models.errors import BadInput

_PAIR = re.compile(r"""\s*([A-Za-z_]\w*)\s*=\s*(?:"([^"]*)"|'([^']*)'|([^,]*?))\s*(?:,|$)""")


@dataclass(frozen=True)
class ReadOptions:
    """columns: heading or number (from 0) by role: t, u, y, target, or a channel's own name;
    rate_hz: rows per second, 0: the file has times; time_unit, drive_unit, unit: of the numbers,
    "": as the headings say."""

    columns: Mapping[str, str | int] = field(default_factory=dict)
    rate_hz: float = 0.0
    time_unit: str = ""
    drive_unit: str = ""
    unit: str = ""

    def __post_init__(self) -> None:
        if not 0.0 <= self.rate_hz < 1e12:
            raise BadInput(f"--rate {self.rate_hz:g}: give the rows per second, above 0")
        for option, given, known in (
            ("--time-unit", self.time_unit, TIME_UNITS),
            ("--drive-unit", self.drive_unit, DRIVE_UNITS),
            ("--unit", self.unit, DISPLACEMENT_UNITS),
        ):
            if given and find_unit_key(given) not in {find_unit_key(name) for name in known}:
                raise BadInput(f"{option} {given}: is not known; known are {', '.join(known)}")

    def __bool__(self) -> bool:
        return self != AS_IT_IS


AS_IT_IS = ReadOptions()


def add_reading(parser: argparse.ArgumentParser) -> None:
    """Add the options for reading files of other programs, except those whose names the command
    already uses."""
    group = parser.add_argument_group(
        "files of other programs",
        "Text (comma, semicolon, tab, blanks; decimal commas; any preamble), .xlsx, .npy, .npz, "
        ".h5, .mat, .tdms, .parquet. One line reports how the file was interpreted.",
    )

    def add(*options: str, **more: Any) -> None:
        for names in (options, options[1:]):  # drops the first name if the command uses it
            with suppress(argparse.ArgumentError):
                if names:
                    group.add_argument(*names, **more)
                return

    add(
        "--columns",
        dest="reading_columns",
        action="append",
        metavar="t=0,u=Voltage,y=...",
        help='the columns, by heading or number (from 0): t=0,u=Voltage,y="Weg (um)"',
    )
    add(
        "--rate",
        "--rate-hz",
        dest="reading_rate_hz",
        type=float,
        metavar="HZ",
        help="rows per second, if there are no times (identify: --rate HZ as well)",
    )
    add("--time-unit", dest="reading_time_unit", choices=TIME_UNITS, help="unit of the times")
    units = ", ".join(DRIVE_UNITS)
    add("--drive-unit", dest="reading_drive_unit", metavar="UNIT", help=f"of the drive: {units}")
    also = "of the displacement: one of these, angstrom, rad or deg"
    add("--unit", dest="reading_unit", metavar="UNIT", help=also)


def parse_columns(text: str) -> dict[str, str | int]:
    """Parse the value of `--columns`. Raises BadInput."""
    out: dict[str, str | int] = {}
    at = 0
    while at < len(text):
        found = _PAIR.match(text, at)
        value = next((v for v in found.groups()[1:] if v is not None), "") if found else ""
        if found is None or not value or found[1] in out:
            raise BadInput(
                f'--columns {text}: write what is which, once each: t=0,u=Voltage,y="Weg (um)"'
            )
        out[found[1]] = int(value) if value.isdecimal() and found[4] is not None else value
        at = found.end()
    return out


def reading_of(args: argparse.Namespace) -> ReadOptions:
    """Return the reading options of the command line. Raises BadInput."""

    def given(name: str) -> Any:
        return getattr(args, f"reading_{name}", None)

    rate_hz = given("rate_hz")
    if rate_hz is not None and not rate_hz > 0.0:
        raise BadInput(f"--rate {rate_hz:g}: give the rows per second, above 0")
    return ReadOptions(
        parse_columns(",".join(given("columns") or [])),
        rate_hz or 0.0,
        given("time_unit") or "",
        given("drive_unit") or "",
        given("unit") or "",
    )
