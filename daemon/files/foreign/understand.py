"""Convert the columns of a foreign file to those of a recording, in the units of recordings, and
describe in one line how the file was understood.

Missing information is requested all at once, with the option that supplies it; every assumption is
stated in that line.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dehyst.daemon.files.foreign.blank import refuse_blank
from dehyst.daemon.files.foreign.choice.advice import describe_column
from dehyst.daemon.files.foreign.choice.choose import choose_columns, groups_of, path_of
from dehyst.daemon.files.foreign.choice.doubts import (
    DATE_STEP,
    DATES,
    LEAST_STEP_S,
    other_times,
    other_volts,
)
from dehyst.daemon.files.foreign.counted import count_rounded, count_time, note_contradictions
from dehyst.daemon.files.foreign.epochs import (
    continued,
    doubt_of_digits,
    join_clocks,
    unit_since_1970,
)
from dehyst.daemon.files.foreign.found import Column, Draft, Sheet
from dehyst.daemon.files.foreign.reading import ReadOptions
from dehyst.daemon.files.foreign.roles import (
    NAMES,
    PLAIN,
    counts_rows,
    role_of,
    role_of_column,
    unit_of_column,
)
from dehyst.daemon.files.foreign.rows_apart import (
    on_common_rows,
    refuse_envelope,
    refuse_no_common_row,
    with_own_times,
)
from dehyst.daemon.files.foreign.stated_step import SAME_STEP, SURELY_SECONDS
from dehyst.daemon.files.foreign.units import (
    DRIVE_UNITS,
    LENGTH,
    TIME,
    UNITS,
    VOLTAGE,
    find_unit_key,
    is_other_unit,
    read_heading,
    split_heading,
    states_factor,
    states_no_unit,
)
from dehyst.models.errors import BadRecording
from dehyst.models.recording import Floats
from dehyst.models.units import UNIT_NAMES

ROLE_NAMES = r"(t|u|y|target)(_.*)?"
MOST_VOLTS = 2000.0
"""A drive without a unit that goes beyond this is more likely one in millivolts or counts [V]:
amplifiers for stages end at 1000 or 1500 V."""
LONGEST_PAUSE_S = 10 * 86400.0
"""A clock that jumps by more [s] has its days and months exchanged, or belongs to two
recordings."""


@dataclass
class Understood:
    """columns: named as in a recording; said: the interpretation, "" if all names were dehyst's
    own; seconds: whether the times are certainly in seconds."""

    columns: dict[str, Floats]
    said: str
    seconds: bool


def understand(name: str, found: Sheet, reading: ReadOptions, wants: Sequence[str]) -> Understood:
    """Return the recording in a file. wants: which of t, u, y, target are required; the others are
    optional. Raises BadRecording listing what is unknown, and the options that supply it."""
    if not found.columns or not len(found.columns[0].values):
        raise BadRecording(
            f"{name}: holds no column of numbers: write times, drive and displacement as one each"
        )
    if found.stacked:
        raise BadRecording(f"{name}: {found.stacked}")
    columns = _without_row_numbers(found.columns, reading)
    if not (reading.rate_hz or "t" in reading.columns):
        columns = join_clocks(columns)
    draft = Draft()
    chosen = choose_columns(name, columns, reading, wants, draft)
    if own_times := with_own_times(name, columns, chosen, reading):
        named = {role: wanted for role, wanted in reading.columns.items() if role != "t"}
        columns, reading, draft = own_times, replace(reading, columns=named), Draft()
        chosen = choose_columns(name, columns, reading, wants, draft)
    refuse_blank(name, found, columns, chosen, reading)
    columns, chosen = on_common_rows(name, columns, chosen, found, reading)
    refuse_no_common_row(name, columns, chosen)
    refuse_envelope(name, columns, chosen, reading)
    if reading.rate_hz or "t" not in chosen:
        count_time(columns, [*chosen.values()], found, reading, draft)
    else:
        _take_time(columns[chosen["t"]], found, reading, other_times(found, columns), draft)
    for role in ("u", "y", "target"):
        if role in chosen:
            given = reading.drive_unit if role == "u" else reading.unit
            column = columns[chosen[role]]
            elsewhere = other_volts(found.notes, columns, column) if role == "u" else ""
            _take(role, column, given, elsewhere, draft)
    for channel in [name for name in chosen if name not in NAMES]:
        _keep_as(channel, columns[chosen[channel]], draft)
    if found.factor:
        _ask_of_factor(found.factor, chosen, reading, draft.asked)
    note_contradictions(columns, chosen, found, reading, draft)
    if draft.asked:
        raise BadRecording(f"{name}: {'; '.join(draft.asked)}")
    others = _other_runs(columns, [*chosen.values()])
    for i, column in enumerate(columns):
        if i not in chosen.values() and groups_of(column.heading) not in others:
            _keep(column, draft.columns)
    if others:
        found.said.append(
            f"of other runs and left out: {', '.join('/'.join(run)[:40] for run in others[:5])}"
            + ", ..." * (len(others) > 5)
        )
    own = not reading and all(_has_own_name(columns[i]) for i in chosen.values()) and "t" in chosen
    offered = [draft.offered] if draft.offered and not own else []
    time = columns[chosen["t"]] if "t" in chosen and not reading.rate_hz else None
    return Understood(
        draft.columns,
        "; ".join([*([] if own else [", ".join(draft.said)]), *offered, *found.said]),
        time is None
        or bool(reading.time_unit)
        or time.clock
        or unit_of_column(time) not in ("", "s"),
    )


def _other_runs(columns: Sequence[Column], taken: Sequence[int]) -> list[list[str]]:
    """Return the groups that hold times, a drive and a displacement of their own, and no column
    that is taken: nothing in them belongs to the rows of the recording."""
    groups = [groups_of(column.heading) for column in columns]
    of_recording = [groups[i] for i in taken]
    roles: dict[tuple[str, ...], set[str]] = {}
    for group, column in zip(groups, columns, strict=True):
        roles.setdefault(tuple(group), set()).add(role_of_column(column))
    runs = [list(run) for run, has in roles.items() if {"t", "u", "y"} <= has]
    return [run for run in runs if run and run not in of_recording]


def _has_own_name(column: Column) -> bool:
    return role_of(column.heading, "")[1] == PLAIN and not column.unit


def _without_row_numbers(columns: Sequence[Column], reading: ReadOptions) -> list[Column]:
    """Return all columns except one that counts the rows and is not named by --columns."""
    wanted = reading.columns.values()
    out = []
    for column in columns:
        v = np.asarray(column.values)
        first = float(v[0])
        counting = first in (0.0, 1.0) and bool(np.all(v == first + np.arange(v.size)))
        numbers = any(c.heading for c in columns) and counting and counts_rows(column.heading)
        if not numbers or len(columns) < 3 or column.number in wanted or column.heading in wanted:
            out.append(column)
    return out


def _stated(column: Column) -> str:
    """Return what the file gives as the unit if it is not a known one, "" otherwise."""
    if not states_no_unit(column.unit):
        return "" if find_unit_key(column.unit) else column.unit.strip()
    return read_heading(column.heading).stated


def _two_units(column: Column) -> list[str]:
    """Return the units in the heading and apart from it if both are given and differ."""
    inside, apart = read_heading(column.heading), find_unit_key(column.unit)
    unit = inside.unit or (inside.stated if is_other_unit(inside.stated) else "")
    return [unit, apart] if unit and apart and unit != apart else []


def _is_kept(unit: str) -> bool:
    """Return whether a unit is known, and one that a drive or a displacement may have."""
    return unit in UNITS and UNITS[unit][1] in UNIT_NAMES


def _take_time(
    column: Column, found: Sheet, reading: ReadOptions, other: str, draft: Draft
) -> None:
    """Convert the times to seconds. other: where the file names another unit of time."""
    label = describe_column(column)
    unit = find_unit_key(reading.time_unit) or unit_of_column(column)
    values = np.asarray(column.values, dtype=np.float64)
    if column.clock and reading.time_unit and find_unit_key(reading.time_unit) != "s":
        draft.asked.append(
            f"{label} gives its times as a clock does, so that their unit is known: leave out "
            f"--time-unit {reading.time_unit}"
        )
        return
    if column.clock:  # converted to seconds, whatever unit its heading gives
        unit = "s"
    if not reading.time_unit and not column.clock and (stated := _stated(column)):
        is_factor = is_other_unit(stated) and states_factor(stated)
        doubt = "may be a label" if find_unit_key(stated) else "is not a known unit of time"
        what = "is not applied" if is_factor else doubt
        draft.asked.append(
            f"{label} states '{stated[:40]}', which {what}: add --time-unit s, ms or us, or "
            "--rate HZ"
        )
        return
    if (two := _two_units(column)) and not (reading.time_unit or column.clock):
        draft.asked.append(
            f"{label} states two units, {' and '.join(two)}: add --time-unit s, ms or us, "
            "whichever is right"
        )
        return
    given = column.clock or bool(reading.time_unit)
    if unit in ("", "s") and (doubt := doubt_of_digits(values, unit == "s", given)):
        draft.asked.append(f"{label} {doubt}")
        return
    unit = unit or unit_since_1970(float(np.min(values, initial=np.inf)), column.heading)
    if not unit:
        known = np.diff(values[np.isfinite(values)])
        step = float(np.median(known[known > 0.0])) if np.any(known > 0.0) else 0.0
        if not 0.0 < step < SURELY_SECONDS:
            draft.asked.append(
                f"{label} steps by {step:.4g}, and gives no unit: add --time-unit s, ms or us, or "
                "--rate HZ if it counts the rows or the ticks of a clock"
            )
            return
        if other:
            draft.asked.append(
                f"the unit of {label} is not given, and may be another than seconds ({other}): add "
                "--time-unit s, ms or us"
            )
            return
        first = float(values[np.isfinite(values)][0])
        dated = step < DATE_STEP and any(low <= first <= high for low, high in DATES)
        confirmed = abs(step - found.step_s) <= SAME_STEP * step  # a period, which is in seconds
        if dated or (step < LEAST_STEP_S and not confirmed):
            draft.asked.append(
                f"{label} begins at {first:.9g}, steps by {step:.4g}, and gives no unit: if these "
                "are days, write (days) into the heading or add --rate HZ; otherwise add "
                "--time-unit s, ms or us"
            )
            return
        unit, label = "s", f"{label}, taken as seconds"
    values, again = continued(values, column.clock)
    if again:
        found.said.append(
            f"{label} starts again at {found.where(again[0])}, as a clock or a counter does, and "
            "is continued there"
        )
    jumps = np.abs(np.diff(values[np.isfinite(values)]))
    if column.clock and np.any(jumps > LONGEST_PAUSE_S):
        row = int(np.argmax(jumps)) + 1
        draft.asked.append(
            f"{label} jumps by {float(jumps[row - 1]) / 86400.0:.3g} days at {found.where(row)}: "
            "if the day comes before the month, write the dates as 2024-03-05; otherwise cut the "
            "file there, or add --rate HZ"
        )
        return
    kind, _, factor = UNITS[unit]
    if kind != TIME:
        draft.asked.append(f"{label} is not a time; add --columns t=... or --rate HZ")
        return
    if factor == 1.0:
        draft.columns["t_s"] = values
    else:  # divide, so that 5 ms is 0.005 s to the last bit
        draft.columns["t_s"] = values / (1.0 / factor) if factor < 1.0 else values * factor
        label += f" (in {unit})"
    count_rounded(found, factor, draft)
    draft.said.append(f"t from {label}")


def _take(role: str, column: Column, given: str, elsewhere: str, draft: Draft) -> None:
    """Convert drive, displacement or target to a unit that recordings use. elsewhere: where the
    file says that a drive without a unit may not be in volts."""
    own, stated, label = unit_of_column(column), _stated(column), describe_column(column)
    unit = find_unit_key(given) or own
    option = "--drive-unit" if role == "u" else "--unit"
    if stated and not given:
        doubt = "may be a label" if find_unit_key(stated) else "is not a known unit"
        as_is = ", which are not multiplied" if states_factor(stated) else ""
        draft.asked.append(
            f"{label} states '{stated[:40]}', which {doubt}: add {option} and the unit of these "
            f"numbers{as_is} ({', '.join(DRIVE_UNITS)})"
        )
        return
    two = _two_units(column)
    if two and find_unit_key(given) not in two:
        known = " or ".join(f"{option} {one}" for one in two if _is_kept(one))
        draft.asked.append(
            f"{label} states two units, {' and '.join(two)}: add {known}, whichever is right"
        )
        return
    in_heading = not find_unit_key(column.unit)
    usable = _is_kept(own) and not two
    if usable and own != unit and (in_heading or UNITS[own][0] == UNITS[unit][0]):
        draft.asked.append(
            f"{label} is in {own}, but {option} says {unit}: without {option} it is read in "
            f"{own}; if the heading is wrong, correct it in the file"
        )
        return
    if not unit and role == "u":
        if elsewhere:
            draft.asked.append(
                f"the unit of {label} is not given, and may be another than volts "
                f"({elsewhere}): add --drive-unit v, mv or kv, or counts"
            )
            return
        highest = float(np.max(np.abs(column.values), initial=0.0, where=~np.isnan(column.values)))
        if highest > MOST_VOLTS:
            draft.asked.append(
                f"{label} gives no unit, and reaches {highest:.6g}: add --drive-unit v, mv, kv or "
                "counts"
            )
            return
        unit, label = "v", f"{label}, taken as volts"
    if not unit:
        draft.asked.append(
            f"the unit of {label} is not given: add --unit um, nm, m, v, counts, mrad or urad"
        )
        return
    _, kept, factor = UNITS[unit]
    if kept not in UNIT_NAMES:
        draft.asked.append(
            f"{label} is in {unit}, not a unit of the {NAMES[role]}; add {option} (counts: "
            "numbers of no length) or --columns"
        )
        return
    values = np.asarray(column.values, dtype=np.float64)
    if factor != 1.0:
        values = values / (1.0 / factor) if factor < 1.0 else values * factor
        label += f" ({unit}, as {kept})"
    elif given or kept != split_heading(column.heading)[1]:
        label += f" in {kept}" if "taken as" not in label else ""
    draft.columns[f"{role}_{kept}"] = values
    draft.said.append(f"{NAMES[role]} from {label}")


def _ask_of_factor(
    factor: str, chosen: Mapping[str, int], reading: ReadOptions, asked: list[str]
) -> None:
    """Ask for the units of the numbers to which a factor in the text of a preamble may apply."""
    given = {"u": ("--drive-unit", reading.drive_unit), "y": ("--unit", reading.unit)}
    missing = [option for role, (option, unit) in given.items() if role in chosen and not unit]
    if missing:
        asked.append(
            f"the file states '{factor}', which is not applied: add {' and '.join(missing)}, the "
            "unit of the numbers as they are"
        )


def _keep_as(name: str, column: Column, draft: Draft) -> None:
    """Add a further channel under the name that --columns gives it; its values are unchanged."""
    label, own, named = describe_column(column), unit_of_column(column), split_heading(name)[1]
    if re.fullmatch(ROLE_NAMES, name):
        draft.asked.append(
            f"--columns {name}=...: the name {name} is not free for a further channel"
        )
    elif own and named and own != named and UNITS[own][0] == UNITS[named][0]:
        draft.asked.append(
            f"--columns {name}=...: {label} is in {own}; give it a name that says so"
        )
    else:
        draft.columns[name] = np.asarray(column.values, dtype=np.float64)
        draft.said.append(f"{name} from {label}")


def _keep(column: Column, out: dict[str, Floats]) -> None:
    """Add a further channel, under a name that a recording may use."""
    name, own = split_heading(path_of(column.heading)[-1])
    unit = find_unit_key(column.unit) or own
    plain = re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_") or "channel"
    if unit and UNITS[unit][0] in (TIME, VOLTAGE, LENGTH) and UNITS[unit][2] != 1.0:
        plain = f"{plain}_{unit}"
    elif unit:
        plain = f"{plain}_{UNITS[unit][1]}"
    if re.fullmatch(ROLE_NAMES, plain):  # not a role that was ruled out
        plain = f"other_{plain}"
    if plain.startswith("temperatur") and unit == "c":
        plain = "temp_c"
    key, number = plain, 2
    while key in out:
        key, number = f"{plain}_{number}", number + 1
    out[key] = np.asarray(column.values, dtype=np.float64)
