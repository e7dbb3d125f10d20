"""The roles of a table's columns, each by its heading and by the other columns of the table."""

from collections.abc import Mapping, Sequence

from dehyst.daemon.files.foreign.epochs import never_falls
from dehyst.daemon.files.foreign.found import Column
from dehyst.daemon.files.foreign.roles import (
    BY_UNIT,
    BY_WORD,
    daq_side,
    kind_of,
    may_be_drive,
    named_axis,
    names_drive,
    role_of,
)
from dehyst.daemon.files.foreign.units import ANGLE, LENGTH, VOLTAGE, find_unit_key


def roles_together(
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
