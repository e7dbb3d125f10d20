"""Convert what a caller passes as a recording, trajectory or model."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import ArrayLike

from dehyst.daemon.files.models import load_model as read_model
from dehyst.daemon.files.recordings import (
    read_recordings,
    read_trajectory,
    recording_of,
    trajectory_of,
)
from dehyst.models.errors import BadInput
from dehyst.models.model import Model
from dehyst.models.recording import Recording, Trajectory
from dehyst.models.units import how_many

Columns = Mapping[str, ArrayLike]
Source = Recording | str | Path | Columns
"""A recording; the path of one; or columns by name with units in the names (`t_s`, `u_v`, `y_um`):
a dict, a pandas.DataFrame, or the fields of a structured array."""

FORMS = (
    "give recordings, paths, or columns by name ({'t_s': ..., 'u_v': ..., 'y_um': ...}), or the "
    "arrays t_s, drive, displacement"
)


def take_recordings(
    data: tuple[Any, ...], units: tuple[str, str], need_displacement: bool
) -> list[Recording]:
    """Return the recordings that were passed to a function of dehyst: (source, source, ...), one
    sequence of sources, or the arrays (t_s, drive) and optionally displacement, (N,) each.

    units: units of drive and displacement, for arrays. Raises BadInput.
    """
    if data and _is_array(data[0]):
        if not 2 <= len(data) <= 3 or not all(map(_is_array, data)):
            raise BadInput(
                f"{how_many(len(data), 'argument is', 'arguments are')} not t_s, drive, "
                f"displacement; {FORMS}"
            )
        names = ("t_s", f"u_{units[0]}", f"y_{units[1]}")
        data = (dict(zip(names, data, strict=False)),)
    elif len(data) == 1 and isinstance(data[0], Sequence) and not isinstance(data[0], str):
        data = tuple(data[0])
    if not data:
        raise BadInput(f"no recording was given; {FORMS}")
    return [
        recording
        for i, one in enumerate(data, 1)
        for recording in _take_recordings(one, need_displacement, i)
    ]


def _take_recordings(source: Any, need_displacement: bool, number: int) -> list[Recording]:
    """Convert one source; a file whose clock went back yields several recordings."""
    if isinstance(source, Recording):
        if need_displacement and source.displacement is None:
            raise BadInput(f"{source.name}: no displacement")
        return [source]
    if isinstance(source, str | Path):
        return read_recordings(source, need_displacement=need_displacement, min_rows=1)
    if _has_columns(source):
        columns = {str(key): source[key] for key in source.keys()}  # noqa: SIM118
        name = f"recording {number}"
        return [recording_of(columns, name, need_displacement=need_displacement, min_rows=1)]
    raise BadInput(f"{type(source).__name__} is not a recording; {FORMS}")


def take_trajectory(data: tuple[Any, ...], unit: str) -> Trajectory:
    """Return the trajectory given as a Trajectory, a path, columns by name (`t_s`, `target_um`, and
    channels that the model reads), or the arrays t_s, target in `unit`."""
    if len(data) == 2 and all(map(_is_array, data)):
        data = ({"t_s": data[0], f"target_{unit}": data[1]},)
    if len(data) != 1 or _is_array(data[0]):
        raise BadInput("give one trajectory: a path, columns t_s and target_um, or two arrays")
    source = data[0]
    if isinstance(source, Trajectory):
        return source
    if isinstance(source, str | Path):
        return read_trajectory(source)
    if _has_columns(source):
        columns = {str(key): source[key] for key in source.keys()}  # noqa: SIM118
        return trajectory_of(columns, "trajectory")
    raise BadInput(f"{type(source).__name__} is not a trajectory: a path, or columns by name")


def take_model(model: Any) -> Model:
    """Return the model given as a Model, a path, a shipped name, or a result that holds one."""
    if isinstance(model, Model):
        return model
    if isinstance(model, str | Path):
        return read_model(model)
    held = getattr(model, "model", None)
    if isinstance(held, Model):
        return held
    raise BadInput(f"{type(model).__name__} is not a model: a path, a shipped name, or a Model")


def _is_array(one: Any) -> bool:
    """Return whether `one` is a one-dimensional column of numbers."""
    if isinstance(one, str | Path | Mapping | Recording) or _has_columns(one):
        return False
    if np.iscomplexobj(one):  # numpy would drop the imaginary part with a warning
        return False
    try:
        return np.asarray(one, dtype=np.float64).ndim == 1
    except (TypeError, ValueError):
        return False


def _has_columns(one: Any) -> TypeGuard[Columns]:
    return hasattr(one, "keys") and hasattr(one, "__getitem__")
