"""Trajectories of one or several axes on disk: `t_s` and `target_um`, or one column per axis
(`target_x_um`, `target_y_um`, ...), in um or another unit of displacement."""

import re
from pathlib import Path

from dehyst.daemon.files.foreign.reading import AS_IT_IS, ReadOptions
from dehyst.daemon.files.recordings import read_columns, read_trajectory
from dehyst.models.errors import BadRecording
from dehyst.models.recording import Trajectory
from dehyst.models.units import UNIT_NAMES

OF_AXIS = re.compile(rf"target_([a-z0-9]{{1,8}})_({'|'.join(UNIT_NAMES)})")


def read_trajectories(
    path: str | Path, *, min_rows: int = 1, column: str = "", reading: ReadOptions = AS_IT_IS
) -> dict[str, Trajectory]:
    """Return the trajectory of each axis by its short name, in the file's order; the key is "" for
    a file with `target_um`, or if `column` names the column. Raises BadRecording like
    read_trajectory."""
    path = Path(path)
    if column:
        return {"": read_trajectory(path, min_rows=min_rows, column=column, reading=reading)}
    columns, _ = read_columns(path, reading=reading)
    found = [match for name in columns if (match := OF_AXIS.fullmatch(name))]
    if not found or any(name.removeprefix("target_") in UNIT_NAMES for name in columns):
        return {"": read_trajectory(path, min_rows=min_rows, reading=reading)}
    axes = [match[1] for match in found]
    if len(set(axes)) < len(axes):
        raise BadRecording(f"{path.name}: an axis has two columns of targets: {', '.join(axes)}")
    return {match[1]: read_trajectory(path, min_rows=min_rows, column=match[0]) for match in found}
