"""Choose which column of a foreign file is the time, which the drive, which the displacement.

What the headings leave open is asked for, with the option that decides it.
"""

import re
from collections.abc import Mapping, Sequence

import numpy as np

from dehyst.daemon.files.foreign.epochs import (
    apart_as_times,
    counts_up,
    never_falls,
    rises_evenly,
)
from dehyst.daemon.files.foreign.found import Column, Draft
from dehyst.daemon.files.foreign.reading import ReadOptions
from dehyst.daemon.files.foreign.roles import (
    BY_UNIT,
    BY_WORD,
    NAMES,
    daq_side,
    is_real,
    kind_of,
    may_be_drive,
    named_axis,
    names_drive,
    role_of,
    says_neither,
    says_role,
    shows_another,
)
from dehyst.daemon.files.foreign.units import ANGLE, LENGTH, VOLTAGE, find_unit_key, split_heading
from dehyst.models.errors import BadRecording


def choose_columns(
    name: str,
    columns: Sequence[Column],
    reading: ReadOptions,
    wants: Sequence[str],
    draft: Draft,
) -> dict[str, int]:
    """Return the column number for each role."""
    chosen: dict[str, int] = {}
    asked = draft.asked
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
    steady = [i for i in free if _may_be_time(columns[i], roles[i])]
    several: dict[str, list[int]] = {}
    alike: dict[str, list[int]] = {}  # the same values in each run
    which: list[str] = []
    unnamed: list[str] = []  # roles that no heading names
    both = False  # drive and displacement are requested together
    advised: dict[str, int] = {}
    if steady and not (_holds(roles, "t") or "t" in chosen or reading.rate_hz):
        advised["t"] = steady[0]
    for role in NAMES:
        if role in chosen or (role == "t" and (reading.rate_hz or "t" in advised)):
            continue
        best = max((sure for r, sure in roles.values() if r == role), default=0)
        found = [i for i, (r, sure) in roles.items() if r == role and sure == best]
        found = [i for i in found if i != advised.get("t")]
        if len(found) > 1 and _all_the_same(columns, found):
            alike[role], found = found, found[:1]
        if len(found) == 1:
            chosen[role] = found[0]
        elif found and (role in wants or role in "tuy"):
            names = ", ".join(describe_column(columns[i]) for i in found[:4])
            both = both or (role == "u" and not _holds(roles, "y") and "y" not in chosen)
            moving = [i for i in found if _moves(columns[i])]
            found = moving if len(moving) > both else found
            advised |= {"u": found[0], "y": found[-1]} if both else {}
            if not both:
                others = [i for i in found if i not in advised.values()]
                advised[role] = _most_like(columns, others or found, role, chosen | advised)
            option = _option(columns, {r: i for r, i in advised.items() if r == role or both})
            asks = f"the {NAMES[role]}" + ", which the displacement" * both
            doubt = apart_as_times([columns[i].values for i in found]) if role == "t" else ""
            which.append(f"{names}: which is {asks}? add {option}{doubt}")
            several[role] = found
        elif role in wants and role != "t" and not (role == "y" and both):
            left = [i for i in free if i not in (*chosen.values(), *advised.values(), *steady)]
            left = _without_role(columns, left, roles, role)
            if left and role == "y" and "u" in advised and "u" not in several:
                advised[role] = left[-1]  # drive and displacement are asked for of one list
            elif left:
                advised[role] = _most_like(columns, left, role, chosen | advised)
            names = ", ".join(describe_column(column) for column in columns[:6])
            unnamed.append(
                f"no heading names the {NAMES[role]} (there are {names}): add "
                + (_option(columns, {role: advised[role]}) if left else f"--columns {role}=...")
            )
    offered: dict[str, int] = {}  # for drive and displacement where they are not required
    for role in "uy" if "target" not in (*wants, *chosen) else "":
        if role in (*wants, *chosen, *several, *advised):
            continue
        taken = {*chosen.values(), *advised.values(), *offered.values(), *steady}
        left = _without_role(columns, [i for i in free if i not in taken], roles, role)
        if left:
            offered[role] = _most_like(columns, left, role, chosen | advised | offered)
    if "t" in advised and "t" not in several:
        option = _option(columns, {"t": advised["t"]} | offered)
        asked.append(
            f"{describe_column(columns[advised['t']])} rises evenly, as times do: add {option}"
        )
    elif offered:
        names = " and ".join(f"the {NAMES[role]}" for role in offered)
        draft.offered = (
            f"no heading names {names}: add {_option(columns, offered)} if that is right"
        )
    taken = {i for role, i in chosen.items() if role in wants or role in reading.columns}
    left = [i for i in free if i not in taken and i != advised.get("t") and roles[i][0] != "t"]
    lacking = _lacking(columns, left, [r for r in wants if r != "t" and r not in chosen])
    asked += [lacking] if lacking else unnamed
    run = several and _of_one_run(columns, alike | several, chosen)
    run = run or _of_one_run(columns, several, chosen)
    taken = {i for role, i in advised.items() if role not in several}
    run = {} if any(taken & set(of) for of in run.values()) else run
    if run and not (both and len(run["u"]) < 2):
        one: dict[str, int] = {}
        for role in sorted(run):
            one[role] = _most_like(columns, run[role], role, chosen | one)
        one |= {"u": run["u"][0], "y": run["u"][-1]} if both else {}
        option = _option(columns, dict(sorted(one.items())))
        which = [f"it holds several runs: name one, such as {option}"]
    asked += which
    _refuse_missing_roles(name, columns, chosen, several, reading)
    return chosen


def _lacking(columns: Sequence[Column], left: Sequence[int], roles: Sequence[str]) -> str:
    """Return what to do if fewer columns are left than roles are required, "" if there are enough.
    left: columns that may have one of these roles."""
    if len(left) >= len(roles):
        return ""
    names = ", ".join(describe_column(column) for column in columns[:6])
    return (
        f"no heading names the {NAMES[roles[-1]]} (there are {names}), and no column is left for "
        "it: write drive and displacement to one file, a column each"
    )


def describe_column(column: Column) -> str:
    text = f"'{column.heading[:40]}'" if column.heading else f"column {column.number}"
    return text + (f" ({column.unit.strip('[](){}')[:24]})" if column.unit else "")


def path_of(heading: str) -> list[str]:
    """Return groups and name of a column: "Run 1/U (V)", but not "U / V" or "Velocity (um/s)"."""
    path = re.split(r"/(?![^\[({<]*[\])}>])", heading)
    return [heading] if path[-1][:1] in ("", " ") or find_unit_key(path[-1]) else path


def groups_of(heading: str) -> list[str]:
    """Return the groups of a column, and the structures of MATLAB: "run1.data.u" has two."""
    path = path_of(heading)
    fields = path[-1].split(".") if re.fullmatch(r"[^\W\d]\w*(\.\w+)+", path[-1]) else path[-1:]
    return [*path[:-1], *fields[:-1]]


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
                f"{name}: --columns {channel}=... takes {describe_column(columns[i])}, and no "
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
    if any(daq_side(c.heading, find_unit_key(c.unit)) == "out" for c in columns):
        for i in free:  # what the analog output drives is measured by the analog input
            heading = columns[i].heading
            if daq_side(heading, units[i]) == "in" and not names_drive(heading):
                roles[i] = roles[i] if roles[i][0] == "y" else ("y", BY_UNIT)
    times = [i for i in free if roles[i][0] == "t" and not columns[i].clock]
    falling = [i for i in times if not never_falls(columns[i].values)]
    if len(falling) < len(times):  # "s" of "t, U, s" is no time if it falls
        roles |= dict.fromkeys(falling, ("", 0))
    roles |= _roles_of_axes(columns, units)
    roles |= dict.fromkeys(_velocities(columns, free), ("", 0))
    kinds = {i: kind_of(columns[i].heading, units[i]) for i in free}
    for role in "uy":  # a word without a unit does not win over a column whose unit fits
        if any(roles[i][0] == role and kinds[i] for i in free):
            for i in free:
                if roles[i] == (role, BY_WORD) and not kinds[i]:
                    roles[i] = role, BY_UNIT
    return roles


def _velocities(columns: Sequence[Column], free: Sequence[int]) -> list[int]:
    """Return the columns that are named only v next to one that is named only x or a: volts, or a
    velocity."""
    if not any(column.heading in ("x", "a") for column in columns):
        return []
    return [i for i in free if columns[i].heading == "v" and not columns[i].unit]


def _roles_of_axes(
    columns: Sequence[Column], units: Mapping[int, str]
) -> dict[int, tuple[str, int]]:
    """Return the roles of columns that are named x, y, z: where there is y and another, y is an
    axis rather than the displacement. units: of the columns that are free."""
    axes = {i: named_axis(columns[i].heading, unit) for i, unit in units.items()}
    if "y" not in axes.values() or not {"x", "z"} & set(axes.values()):
        return {}
    kinds = {i: kind_of(columns[i].heading, units[i]) for i, axis in axes.items() if axis}
    volts = [i for i, kind in kinds.items() if kind == VOLTAGE]
    drives = [i for i in volts if len(volts) > 1 or axes[i] != "y"]
    return {i: ("u" if i in drives else "y", BY_UNIT) for i in kinds}


def _of_one_run(
    columns: Sequence[Column], several: Mapping[str, list[int]], chosen: Mapping[str, int]
) -> dict[str, list[int]]:
    """Return the candidates for each role that are in one group or sheet, that of a chosen column
    if possible; {} if the candidates are not in different ones."""
    groups = [groups_of(column.heading) for column in columns]
    for found in [*several.values()][:1]:
        for depth in range(1, 1 + min(len(groups[i]) for i in found)):
            for run in [groups[i][:depth] for i in (*chosen.values(), found[0])]:
                inside = {
                    r: [i for i in of if groups[i][:depth] == run] for r, of in several.items()
                }
                if all(0 < len(inside[role]) < len(of) for role, of in several.items()):
                    return inside
    return {}


def _option(columns: Sequence[Column], of: Mapping[str, int]) -> str:
    """Return the option that names a column for each role."""
    return "--columns " + ",".join(f"{role}={_name(columns, i)}" for role, i in of.items())


def _name(columns: Sequence[Column], i: int) -> str:
    heading = columns[i].heading
    unique = sum(column.heading.lower() == heading.lower() for column in columns) == 1
    short = 0 < len(heading) <= 40
    typed = heading.isprintable() and not re.search(r"[\"$`\\!,]", heading)  # in a shell's quotes
    if not (unique and short and typed):
        return str(columns[i].number)
    plain = re.fullmatch(r"[\w.]+", heading) and not heading.isdecimal()
    return heading if plain else f'"{heading}"'


def _most_like(
    columns: Sequence[Column], of: Sequence[int], role: str, others: Mapping[str, int]
) -> int:
    """Return the candidate to advise: the one of the same axis or number as the other column of
    drive and displacement, a length for the displacement, what was measured."""
    other = others.get("y" if role == "u" else "u")
    beside = _marks(columns[other].heading) if other is not None else set()

    def fits(i: int) -> tuple[int, bool, bool, bool]:
        heading = columns[i].heading
        kind = kind_of(heading, find_unit_key(columns[i].unit))
        moves = role == "y" and kind in (LENGTH, ANGLE)
        return len(_marks(heading) & beside), moves, is_real(heading), not shows_another(heading)

    return max(of, key=fits)


def _marks(heading: str) -> set[str]:
    """Return words and numbers of a heading, and the axis of "Vx"."""
    words = set(re.findall(r"\d+|[^\W\d_]+", split_heading(heading)[0].lower()))
    return words | {word[1] for word in words if len(word) == 2 and word[1] in "xyz"}


def _holds(roles: Mapping[int, tuple[str, int]], role: str) -> bool:
    return any(one == role for one, _ in roles.values())


def _without_role(
    columns: Sequence[Column],
    of: Sequence[int],
    roles: Mapping[int, tuple[str, int]],
    role: str,
) -> list[int]:
    """Return the columns that may be named for a role that no heading names: those without a role
    if there are any; the only displacement is not to become the drive."""
    units = {i: find_unit_key(columns[i].unit) for i in of}
    may = [i for i in of if not says_neither(columns[i].heading, units[i]) and roles[i][0] != "t"]
    may = [i for i in may if _moves(columns[i]) and not counts_up(columns[i].values)] or may
    measured = [i for i in may if roles[i][0] == "y"]
    if role == "u" and len(measured) == 1:
        may.remove(measured[0])
    named = [i for i in of if says_role(columns[i].heading, role)]  # "Drive (%)"
    return [i for i in may if not roles[i][0]] or may or named


def _may_be_time(column: Column, role: tuple[str, int]) -> bool:
    """Return whether a column rises as times do, and neither its heading nor its unit says what it
    is: the name of an axis does not, as "x" of a curve may be the time."""
    axis = role[1] == BY_UNIT and not kind_of(column.heading, find_unit_key(column.unit))
    return (not role[0] or axis) and rises_evenly(column.values) and not counts_up(column.values)


def _moves(column: Column) -> bool:
    values = np.asarray(column.values, dtype=np.float64)
    return np.unique(values[np.isfinite(values)]).size > 1


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
    if lacking := _lacking(columns, free, [role for role in roles if role != "t"]):
        asked.append(lacking)
    elif roles:
        first = ", ".join(
            f"column {columns[i].number}: {columns[i].values[0]:.6g}" for i in free[:6]
        )
        also = [r for r in "uy" if r not in (*wants, *chosen) and "target" not in wants]
        which, untimed = _advised_without_headings(columns, free, roles, also)
        option = _option(columns, which) + (" --rate HZ (no column holds times)" if untimed else "")
        asked.append(
            f"{len(columns)} columns of numbers without headings (the first row is {first}): say "
            f"which is which: {option}"
        )


def _advised_without_headings(
    columns: Sequence[Column], free: Sequence[int], roles: Sequence[str], also: Sequence[str]
) -> tuple[dict[str, int], bool]:
    """Return (column to advise for each role, whether none of them holds times): the times rise,
    row numbers are no times, and what stands still or is there twice is only advised where nothing
    else is left for a role. also: roles to advise columns for if there are any left."""
    steady = [i for i in free if rises_evenly(columns[i].values)]
    rising = [i for i in steady if not counts_up(columns[i].values)]
    rising += [i for i in free if i not in steady and never_falls(columns[i].values)]
    times = rising[:1] if "t" in roles else []
    moving = [i for i in free if i not in (*steady, *times) and _moves(columns[i])]
    others = [i for i in moving if not any(_all_the_same(columns, [j, i]) for j in moving if j < i)]
    further = [role for role in (*roles, *also) if role != "t"]
    needed = len(further) - len(also)
    others += [i for i in free if i not in (*others, *times)][: max(0, needed - len(others))]
    advised = {"t": times[0]} if times else {}
    return advised | dict(zip(further, others, strict=False)), "t" in roles and not times


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
                f"the number: {role}={columns[found[0]].number}"
            )
    for i, column in enumerate(columns):
        if isinstance(wanted, int) and column.number == wanted:
            return i
    there = ", ".join(describe_column(c) for c in columns[:8])
    raise BadRecording(
        f"{name}: --columns {role}={text}: there is no such column; there are {there}"
    )
