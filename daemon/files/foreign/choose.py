"""Choose which column of a foreign file is the time, which the drive, which the displacement.

What the headings leave open is asked for, with the option that decides it.
"""

import re
from collections.abc import Mapping, Sequence

import numpy as np

from dehyst.daemon.files.foreign.found import Column
from dehyst.daemon.files.foreign.reading import ReadOptions
from dehyst.daemon.files.foreign.roles import (
    BY_UNIT,
    BY_WORD,
    NAMES,
    kind_of,
    may_be_drive,
    role_of,
)
from dehyst.daemon.files.foreign.units import ANGLE, LENGTH, find_unit_key, split_heading
from dehyst.models.errors import BadRecording


def choose_columns(
    name: str,
    columns: Sequence[Column],
    reading: ReadOptions,
    wants: Sequence[str],
    asked: list[str],
) -> dict[str, int]:
    """Return the column number for each role."""
    chosen: dict[str, int] = {}
    for role, wanted in reading.columns.items():
        chosen[role] = _named(name, columns, role, wanted)
    if len(set(chosen.values())) < len(chosen):
        raise BadRecording(f"{name}: --columns names a column twice")
    free = [i for i in range(len(columns)) if i not in chosen.values()]
    if free and not any(columns[i].heading or columns[i].unit or columns[i].clock for i in free):
        _ask_by_number(columns, free, chosen, reading, wants, asked)
        return chosen
    roles = _roles(columns, free, "y" in chosen)
    if "target" in wants and not any(role == "target" for role, _ in roles.values()):
        roles = {i: ("target", sure) if r == "y" else (r, sure) for i, (r, sure) in roles.items()}
    several: dict[str, list[int]] = {}
    alike: dict[str, list[int]] = {}  # the same values in each run
    which: list[str] = []
    both = False  # drive and displacement are requested together
    for role in NAMES:
        if role in chosen or (role == "t" and reading.rate_hz):
            continue
        best = max((sure for r, sure in roles.values() if r == role), default=0)
        found = [i for i, (r, sure) in roles.items() if r == role and sure == best]
        if len(found) > 1 and _all_the_same(columns, found):
            alike[role], found = found, found[:1]
        if len(found) == 1:
            chosen[role] = found[0]
        elif found and (role in wants or role in "tuy"):
            names = ", ".join(describe_column(columns[i], i) for i in found[:4])
            option = _option(role, columns, found)
            if role == "u" and not any(r == "y" for r, _ in roles.values()) and "y" not in chosen:
                option += "," + _option("y", columns, found).removeprefix("--columns ")
                both = True
            which.append(f"{names}: which is the {NAMES[role]}? add {option}")
            several[role] = found
        elif role in wants and role != "t" and not (role == "y" and both):
            left = [i for i in free if not roles[i][0]]
            names = ", ".join(describe_column(columns[i], i) for i in range(min(len(columns), 6)))
            asked.append(
                f"no heading names the {NAMES[role]} (there are {names}): add "
                + (_option(role, columns, left) if left else f"--columns {role}=...")
            )
    run = several and _of_one_run(columns, alike | several, chosen)
    if run := run or _of_one_run(columns, several, chosen):
        if both:
            run["y"] = run["u"]
        options = [
            _option(r, columns, of).removeprefix("--columns ") for r, of in sorted(run.items())
        ]
        which = [f"it holds several runs: name one, such as --columns {','.join(options)}"]
    asked += which
    _refuse_missing_roles(name, columns, chosen, several, reading)
    return chosen


def describe_column(column: Column, number: int) -> str:
    text = f"'{column.heading[:40]}'" if column.heading else f"column {number}"
    return text + (f" ({column.unit})" if column.unit else "")


def path_of(heading: str) -> list[str]:
    """Return groups and name of a column: "Run 1/U (V)", but not "U / V" or "Velocity (um/s)"."""
    path = re.split(r"/(?![^\[({<]*[\])}>])", heading)
    return [heading] if path[-1][:1] in ("", " ") or find_unit_key(path[-1]) else path


def _refuse_missing_roles(
    name: str,
    columns: Sequence[Column],
    chosen: Mapping[str, int],
    several: Mapping[str, Sequence[int]],
    reading: ReadOptions,
) -> None:
    """Raise BadRecording if --columns makes a further channel of the only column for a role."""
    for channel, i in chosen.items():
        role, sure = role_of(columns[i].heading, find_unit_key(columns[i].unit))
        free = role not in chosen and role not in several and not (role == "t" and reading.rate_hz)
        if channel not in NAMES and role and sure >= BY_WORD and free:
            raise BadRecording(
                f"{name}: --columns {channel}=... takes {describe_column(columns[i], i)}, and no "
                f"{NAMES[role]} is left: name another column with {role}=..., or "
                f"leave out {channel}"
            )


def _roles(
    columns: Sequence[Column], free: Sequence[int], displacement: bool
) -> dict[int, tuple[str, int]]:
    """Return role and confidence of each free column. displacement: it was named already."""
    units = {i: find_unit_key(columns[i].unit) for i in free}
    roles = {i: role_of(columns[i].heading, units[i]) for i in free}
    roles |= {i: ("t", BY_UNIT) for i in free if columns[i].clock and roles[i][0] != "t"}
    moves = [i for i in free if kind_of(columns[i].heading, units[i]) in (LENGTH, ANGLE)]
    if displacement or any(roles[i][0] == "y" for i in moves):
        for i in free:
            if roles[i] == ("y", BY_WORD) and may_be_drive(columns[i].heading, units[i]):
                roles[i] = "u", BY_UNIT
    return roles


def _of_one_run(
    columns: Sequence[Column], several: Mapping[str, list[int]], chosen: Mapping[str, int]
) -> dict[str, list[int]]:
    """Return the candidates for each role that are in one group or sheet, that of a chosen column
    if possible; {} if the candidates are not in different ones."""
    groups = [path_of(column.heading)[:-1] for column in columns]
    for found in [*several.values()][:1]:
        for depth in range(1, 1 + min(len(groups[i]) for i in found)):
            for run in [groups[i][:depth] for i in (*chosen.values(), found[0])]:
                inside = {
                    r: [i for i in of if groups[i][:depth] == run] for r, of in several.items()
                }
                if all(0 < len(inside[role]) < len(of) for role, of in several.items()):
                    return inside
    return {}


def _option(role: str, columns: Sequence[Column], of: Sequence[int]) -> str:
    one = of[0] if role != "y" else of[-1]
    heading = columns[one].heading
    plain = bool(re.fullmatch(r"[\w.]+", heading)) and not heading.isdecimal()
    if not heading or len(heading) > 40 or not heading.isprintable():
        return f"--columns {role}={one}"
    return f"--columns {role}=" + (heading if plain else f'"{heading}"')


def _all_the_same(columns: Sequence[Column], which: Sequence[int]) -> bool:
    first = columns[which[0]].values
    return all(np.array_equal(first, columns[i].values, equal_nan=True) for i in which[1:])


def _ask_by_number(
    columns: Sequence[Column],
    free: Sequence[int],
    chosen: Mapping[str, int],
    reading: ReadOptions,
    wants: Sequence[str],
    asked: list[str],
) -> None:
    """Ask for the required columns by number, because no column has a heading."""
    roles = [r for r in wants if r not in chosen and not (r == "t" and reading.rate_hz)]
    if roles:
        first = ", ".join(f"{columns[i].values[0]:.6g}" for i in free[:6])
        numbers = ",".join(f"{role}={i}" for i, role in zip(free, roles, strict=False))
        asked.append(
            f"{len(columns)} columns of numbers without headings (the first row is {first}): say "
            f"which is which: --columns {numbers}"
        )


def _named(name: str, columns: Sequence[Column], role: str, wanted: str | int) -> int:
    """Return the number of the column named by --columns."""
    text = str(wanted)
    for same in (
        lambda c: c.heading == text,
        lambda c: c.heading.lower() == text.lower(),
        lambda c: split_heading(c.heading)[0].lower() == text.lower(),
        lambda c: c.heading.rpartition("/")[2].lower() == text.lower(),
    ):
        found = [i for i, column in enumerate(columns) if same(column)]
        if len(found) == 1:
            return found[0]
        if found:
            raise BadRecording(
                f"{name}: --columns {role}={text}: {len(found)} columns have this heading; give "
                f"the number: {role}={found[0]}"
            )
    if isinstance(wanted, int) and 0 <= wanted < len(columns):
        return wanted
    there = ", ".join(describe_column(c, i) for i, c in enumerate(columns[:8]))
    raise BadRecording(
        f"{name}: --columns {role}={text}: there is no such column; there are {there}"
    )
