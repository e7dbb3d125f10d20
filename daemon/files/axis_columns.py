"""Names of other axes in the file of one axis, and in the channels of its recording.

    column in a file                        channel of the recording
    axis_y_um, axis_y_nm (displacement)     axis.y
    axis_y_drive_v (drive)                  axis.y.drive
    target_y_um (of a trajectory)           axis.y

Column names have no dot, so that numpy.genfromtxt keeps them. A channel uses the unit of the
recording's own displacement or drive: lengths are converted, and a column in a unit that cannot be
converted keeps its own name as a channel.
"""

import re
from collections.abc import Mapping

from dehyst.models.recording import AXIS_CHANNEL, Floats

LENGTHS = {"um": 1.0, "nm": 1e-3}
_COLUMN = re.compile(r"axis_([a-z0-9]{1,8})_(drive_)?([a-z]+)")
_TARGET = re.compile(r"target_([a-z0-9]{1,8})_([a-z]+)")


def axis_column(axis: str, unit: str, drive: bool = False) -> str:
    """Return the column name of another axis: of its displacement, or of its drive."""
    return f"axis_{axis}_drive_{unit}" if drive else f"axis_{axis}_{unit}"


def is_axis_column(name: str) -> bool:
    """Return whether a column belongs to another axis, by its name."""
    return bool(_COLUMN.fullmatch(name) or _TARGET.fullmatch(name))


def to_channels(
    columns: Mapping[str, Floats], displacement_unit: str, drive_unit: str = ""
) -> dict[str, Floats]:
    """Return columns as channels by name; those of other axes become `axis.y` and
    `axis.y.drive`."""
    out = {}
    for key, values in columns.items():
        match = _COLUMN.fullmatch(key)
        if match is None:
            out[key] = values
            continue
        axis, drive, unit = match.groups()
        factor = unit_factor(unit, drive_unit if drive else displacement_unit)
        name = f"axis.{axis}.drive" if drive else f"axis.{axis}"
        if factor is None or name in out:
            out[key] = values
        else:
            out[name] = values if factor == 1.0 else values * factor
    return out


def targets_as_channels(columns: Mapping[str, Floats], unit: str) -> dict[str, Floats]:
    """Return the further columns of a trajectory as channels; targets of other axes become
    `axis.y`, in `unit`."""
    out = to_channels(columns, unit)
    for key, values in columns.items():
        match = _TARGET.fullmatch(key)
        if match is None or f"axis.{match[1]}" in out:
            continue
        factor = unit_factor(match[2], unit)
        if factor is not None:
            out[f"axis.{match[1]}"] = values * factor
    return out


def to_columns(
    channels: Mapping[str, Floats], displacement_unit: str, drive_unit: str
) -> dict[str, Floats]:
    """Return channels as columns of a file."""
    out = {}
    for name, values in channels.items():
        match = AXIS_CHANNEL.fullmatch(name)
        if match is None:
            out[name] = values
        else:
            drive = bool(match[2])
            unit = drive_unit if drive else displacement_unit
            out[axis_column(match[1], unit, drive)] = values
    return out


def unit_factor(unit: str, wanted: str) -> float | None:
    """Return the factor from one unit to the other; None if they measure different quantities."""
    if unit == wanted:
        return 1.0
    if unit in LENGTHS and wanted in LENGTHS:
        return LENGTHS[unit] / LENGTHS[wanted]
    return None
