"""A model run on a recording that may begin anywhere in a stage's life.

What the stage went through before the first row is not in the file. Three histories are tried:
de-energised, come from the top of the model's drive range, and come from its bottom after the top.
Each is driven slowly before the first row, so that every block with a memory has been through it.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from dehyst.models.cascade.simulate import Parts, channels_of, simulate_parts
from dehyst.models.errors import BadInput
from dehyst.models.model import Floats, Model
from dehyst.models.recording import Recording

DE_ENERGISED, FROM_ABOVE, FROM_BELOW = "de-energised", "from above", "from below"
HISTORIES = (DE_ENERGISED, FROM_ABOVE, FROM_BELOW)
LEG_SAMPLES, LEG_S = 200, 20.0
"""Of one way over the range: slow, so that nothing but memory is left of it."""
BETTER = 0.01
"""Of the error: what a history must take away before it is believed in place of the ones before."""


class Replay(NamedTuple):
    """start: the history that fits; predicted: (N,) the reading by the model behind it."""

    start: str
    predicted: Floats


def replay(
    model: Model, t_s: Floats, u: Floats, channels: Mapping[str, Floats], y: Floats
) -> Replay:
    """The model on the drive u (N,) behind the history that fits the reading y (N,) best, its mean
    left out; NaN in y count for nothing. Raises BadInput as `simulate` does."""
    best, least = None, np.inf
    for start in HISTORIES:
        predicted = simulate_behind(model, t_s, u, channels, start).reading
        left = _spread(y - predicted)
        if best is None or left < (1.0 - BETTER) * least:
            best, least = Replay(start, predicted), left
    assert best is not None
    return best


def replay_recording(model: Model, recording: Recording) -> Replay:
    """The model on a recording as it is, behind the history that fits its displacement; without one
    in the model's unit, de-energised. Rows that lack the drive or a channel are passed over and are
    NaN. Raises BadInput where no row has all that the model reads, or a channel is absent."""
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
    t, u, out = recording.t_s[known], recording.drive[known], np.full(recording.size, np.nan)
    y = recording.displacement
    if y is None or recording.displacement_unit != model.displacement_unit:
        out[known] = simulate_parts(model, t, u, channels).reading
        return Replay(DE_ENERGISED, out)
    start, out[known] = replay(model, t, u, channels, y[known])
    return Replay(start, out)


def simulate_behind(
    model: Model, t_s: Floats, u: Floats, channels: Mapping[str, Floats], start: str
) -> Parts:
    """Every stage of the model for a drive u (N,) behind one of the HISTORIES, which is driven
    slowly. Raises BadInput as `simulate` does."""
    legs = _list_legs(model, float(u[0]))[start]
    if not legs:
        return simulate_parts(model, t_s, u, channels)
    way = np.interp(
        np.arange(LEG_SAMPLES * (len(legs) - 1)) / LEG_SAMPLES, np.arange(len(legs)), legs
    )
    before = t_s[0] - (LEG_S / LEG_SAMPLES) * np.arange(way.size, 0, -1)
    led = {name: np.append(np.full(way.size, c[0]), c) for name, c in channels.items()}
    parts = simulate_parts(model, np.append(before, t_s), np.append(way, u), led)
    return Parts(*(part[way.size :] for part in parts))


def _spread(error: Floats) -> float:
    return float(np.nanstd(error)) if np.any(np.isfinite(error)) else 0.0


def _list_legs(model: Model, first: float) -> dict[str, list[float]]:
    """Turning points before the first row, by the stage's history."""
    v = model.validity
    rest = min(max(0.0, v.drive_min), v.drive_max)
    return {
        DE_ENERGISED: [],
        FROM_ABOVE: [rest, v.drive_max, first],
        FROM_BELOW: [rest, v.drive_max, v.drive_min, first],
    }
