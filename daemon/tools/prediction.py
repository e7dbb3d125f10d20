"""A model run on a recording's drive, and how it compares: what `dehyst simulate` does."""

import numpy as np

from dehyst.models.cascade.simulate import channels_of, simulate
from dehyst.models.errors import BadInput
from dehyst.models.model import Model
from dehyst.models.recording import Floats, Recording


def predict(model: Model, recording: Recording) -> Floats:
    """(N,) displacement by the model. NaN where the drive or a channel that it reads is missing.

    The plays pass over missing rows; nothing is filled in. Raises BadInput on other units or
    missing channels.
    """
    if model.drive_unit != recording.drive_unit:
        raise BadInput(
            f"{recording.name}: the drive is in {recording.drive_unit}, the model's in "
            f"{model.drive_unit}"
        )
    needed = channels_of(model)
    absent = [name for name in needed if name not in recording.channels]
    if absent:
        raise BadInput(
            f"{recording.name}: the model reads the channel {absent[0]}, which is absent"
        )
    known = ~recording.missing_drive
    for name in needed:
        known &= ~np.isnan(recording.channels[name])
    if not known.any():
        raise BadInput(f"{recording.name}: no row has all that the model reads")
    channels = {name: recording.channels[name][known] for name in needed}
    out = np.full(recording.size, np.nan)
    out[known] = simulate(model, recording.t_s[known], recording.drive[known], channels)
    return out


def outside_validity(model: Model, recording: Recording) -> dict[str, float]:
    """Share of the rows that leave the model's drive range and its rate range."""
    v, u = model.validity, recording.drive
    margin = 1e-6 * (v.drive_max - v.drive_min)
    with np.errstate(invalid="ignore"):
        drive = (u < v.drive_min - margin) | (u > v.drive_max + margin)
        rate = np.abs(np.diff(u)) / np.diff(recording.t_s)
        fast = rate > v.rate_max * (1 + 1e-6) if v.rate_max else np.zeros(1, dtype=bool)
    return {"drive": float(np.mean(drive)), "rate": float(np.mean(fast)) if fast.size else 0.0}


def rms_error(recording: Recording, y: Floats, unit: str) -> float | None:
    """rms of measured minus y; None without a measured displacement in that unit."""
    if recording.displacement is None or recording.displacement_unit != unit:
        return None
    error = recording.displacement - y
    known = error[~np.isnan(error)]
    return float(np.sqrt(np.mean(known**2))) if known.size else None
