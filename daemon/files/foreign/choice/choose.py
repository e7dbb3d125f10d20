"""Choose which column of a foreign file is the time, which the drive, which the displacement.

What the headings leave open is asked for, with the option that decides it.
"""

import re
from collections.abc import Mapping, Sequence

from dehyst.daemon.files.foreign.choice.advice import (
    all_the_same,
    ask_by_number,
    describe_column,
    lacking_columns,
    may_be_named,
    most_like,
    moves,
    note_counters,
    option_for,
)
from dehyst.daemon.files.foreign.choice.table_roles import roles_together
from dehyst.daemon.files.foreign.epochs import (
    apart_as_times,
    counts_samples,
    counts_up,
    rises_evenly,
    same_time,
)
from dehyst.daemon.files.foreign.found import Column, Draft
from dehyst.daemon.files.foreign.grid import TURNED
from dehyst.daemon.files.foreign.reading import ReadOptions
from dehyst.daemon.files.foreign.roles import (
    BY_UNIT,
    BY_WORD,
    NAMES,
    kind_of,
    role_of,
    unit_of_column,
)
from dehyst.daemon.files.foreign.units import UNITS, find_unit_key, split_heading
from dehyst.models.errors import BadRecording

SAMPLES_OF = 8
"""A file with more than this many columns per row has a sample in each column, not in each row."""


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
        _refuse_turned(name, columns)
        ask_by_number(columns, free, chosen, reading, wants, asked)
        return chosen
    roles = roles_together(columns, free, "y" in chosen)
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
        if len(found) > 1 and all_the_same(columns, found):
            alike[role], found = found, found[:1]
        if role == "t" and len(found) > 1 and (one := _one_time(columns, found)) is not None:
            shown = " and ".join(describe_column(columns[i]) for i in found)
            draft.said.append(f"one time in {shown}")
            found = [one]
        if len(found) == 1:
            chosen[role] = found[0]
        elif found and (role in wants or role in "tuy"):
            names = ", ".join(describe_column(columns[i]) for i in found[:4])
            both = both or (role == "u" and not _holds(roles, "y") and "y" not in chosen)
            moving = [i for i in found if moves(columns[i])]
            if role != "t":
                moving = [i for i in moving if not counts_samples(columns[i].values)]
            counted = found
            found = moving if len(moving) > both else found
            advised |= {"u": found[0], "y": found[-1]} if both else {}
            if not both:
                others = [i for i in found if i not in advised.values()]
                advised[role] = most_like(columns, others or found, role, chosen | advised)
            option = option_for(columns, {r: i for r, i in advised.items() if r == role or both})
            asks = f"the {NAMES[role]}" + ", which the displacement" * both
            doubt = apart_as_times([columns[i].values for i in found]) if role == "t" else ""
            doubt += note_counters(columns, counted) if role != "t" else ""
            which.append(f"{names}: which is {asks}? add {option}{doubt}")
            several[role] = found
        elif role in wants and role != "t" and not (role == "y" and both):
            left = [i for i in free if i not in (*chosen.values(), *advised.values(), *steady)]
            left = may_be_named(columns, left, roles, role)
            if left and role == "y" and "u" in advised and "u" not in several:
                advised[role] = left[-1]  # drive and displacement are asked for of one list
            elif left:
                advised[role] = most_like(columns, left, role, chosen | advised)
            names = ", ".join(describe_column(column) for column in columns[:6])
            others = [i for i in free if i not in chosen.values()]
            counting = "" if unnamed else note_counters(columns, others)
            unnamed.append(
                f"no heading names the {NAMES[role]} (there are {names}{counting}): add "
                + (option_for(columns, {role: advised[role]}) if left else f"--columns {role}=...")
            )
    offered: dict[str, int] = {}
    if "target" not in (*wants, *chosen):
        open_roles = [r for r in "uy" if r not in (*wants, *chosen, *several, *advised)]
        offered = _offer(columns, free, roles, open_roles, chosen | advised, steady)
    if "t" in advised and "t" not in several:
        option = option_for(columns, {"t": advised["t"]} | offered)
        asked.append(
            f"{describe_column(columns[advised['t']])} rises evenly, as times do: add {option}"
        )
    elif offered:
        names = " and ".join(f"the {NAMES[role]}" for role in offered)
        draft.offered = (
            f"no heading names {names}: add {option_for(columns, offered)} if that is right"
        )
    taken = {i for role, i in chosen.items() if role in wants or role in reading.columns}
    left = [i for i in free if i not in taken and i != advised.get("t") and roles[i][0] != "t"]
    lacking = lacking_columns(columns, left, [r for r in wants if r != "t" and r not in chosen])
    asked += [lacking] if lacking else unnamed
    if option := _name_one_run(columns, several, alike, chosen, advised, both):
        which = [f"it holds several runs: name one, such as {option}"]
    asked += which
    _refuse_missing_roles(name, columns, chosen, several, reading)
    return chosen


def _refuse_turned(name: str, columns: Sequence[Column]) -> None:
    """Raise BadRecording if there are so many and so short columns that each must be a sample."""
    rows = len(columns[0].values)
    if len(columns) > SAMPLES_OF * rows:
        raise BadRecording(f"{name}: it holds {rows} rows of {len(columns)} numbers each{TURNED}")


def _offer(
    columns: Sequence[Column],
    free: Sequence[int],
    roles: Mapping[int, tuple[str, int]],
    open_roles: Sequence[str],
    others: Mapping[str, int],
    steady: Sequence[int],
) -> dict[str, int]:
    """Return a column for each of these roles, which no heading names and nobody requires. others:
    columns that have a role, or are advised for one; steady: those that may be times."""
    offered: dict[str, int] = {}
    for role in open_roles:
        taken = {*others.values(), *offered.values(), *steady}
        left = may_be_named(columns, [i for i in free if i not in taken], roles, role)
        if left:
            offered[role] = most_like(columns, left, role, {**others, **offered})
    return offered


def _name_one_run(
    columns: Sequence[Column],
    several: Mapping[str, list[int]],
    alike: Mapping[str, list[int]],
    chosen: Mapping[str, int],
    advised: Mapping[str, int],
    both: bool,
) -> str:
    """Return the option that names one of several runs; "" if there are not several. several:
    candidates for each role; alike: those that hold the same; both: drive and displacement are
    asked for of one list."""
    run = several and _of_one_run(columns, {**alike, **several}, chosen)
    run = run or _of_one_run(columns, several, chosen)
    taken = {i for role, i in advised.items() if role not in several}
    if not run or any(taken & set(of) for of in run.values()) or (both and len(run["u"]) < 2):
        return ""
    one: dict[str, int] = {}
    for role in sorted(run):
        one[role] = most_like(columns, run[role], role, {**chosen, **one})
    one |= {"u": run["u"][0], "y": run["u"][-1]} if both else {}
    return option_for(columns, dict(sorted(one.items())))


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


def _holds(roles: Mapping[int, tuple[str, int]], role: str) -> bool:
    return any(one == role for one, _ in roles.values())


def _may_be_time(column: Column, role: tuple[str, int]) -> bool:
    """Return whether a column rises as times do, and neither its heading nor its unit says what it
    is: the name of an axis does not, as "x" of a curve may be the time."""
    axis = role[1] == BY_UNIT and not kind_of(column.heading, find_unit_key(column.unit))
    return (not role[0] or axis) and rises_evenly(column.values) and not counts_up(column.values)


def _one_time(columns: Sequence[Column], found: Sequence[int]) -> int | None:
    """Return which of several columns of times to take if all give the same time, in units that the
    file gives, such as a date next to the elapsed seconds; None if they do not, or if others are
    between them, each of which may have a time of its own."""
    scales = [
        1.0 if columns[i].clock else UNITS.get(unit_of_column(columns[i]), ("", "", 0.0))[2]
        for i in found
    ]
    values = [columns[i].values for i in found]
    together = list(found) == [*range(found[0], found[0] + len(found))]
    if not (together and all(scales)) or len({len(v) for v in values}) > 1:
        return None
    at = same_time([*zip(values, scales, strict=True)])
    return None if at < 0 else found[at]


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
