"""Run a model on a recording that may begin at any point of a stage's history.

The history before the first row is not in the file. Three histories are tried: de-energised,
arrived from the top of the model's drive range, and arrived from its bottom after the top. Each is
simulated as a slow drive before the first row, so that it applies to every block with a memory.
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
"""Samples and duration [s] of one move over the range: slow, so that only memory remains of it."""
BETTER = 0.01
"""A history replaces those tried before it only if it reduces the error by this fraction."""


class Replay(NamedTuple):
    """start: the history that fits best; predicted: (N,) the model's reading after it."""

    start: str
    predicted: Floats


def replay(
    model: Model, t_s: Floats, u: Floats, channels: Mapping[str, Floats], y: Floats
) -> Replay:
    """Run the model on the drive u (N,) after the history that best fits the reading y (N,), apart
    from a constant; NaN in y are ignored. Raises BadInput like `simulate`."""
    best, least = None, np.inf
    for start in HISTORIES:
        predicted = simulate_behind(model, t_s, u, channels, start).reading
        left = _spread(y - predicted)
        if best is None or left < (1.0 - BETTER) * least:
            best, least = Replay(start, predicted), left
    assert best is not None
    return best


def replay_recording(model: Model, recording: Recording) -> Replay:
    """Run the model on a recording after the history that best fits its displacement; without a
    displacement in the model's unit, de-energised. Rows without the drive or a channel are skipped
    and are NaN. Raises BadInput if no row has all that the model reads, or a channel is absent."""
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
    """Return all parts of the model for a drive u (N,) after one of the HISTORIES, which is driven
    slowly. Raises BadInput like `simulate`."""
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
    """Return the turning points before the first row for each history."""
    v = model.validity
    rest = min(max(0.0, v.drive_min), v.drive_max)
    return {
        DE_ENERGISED: [],
        FROM_ABOVE: [rest, v.drive_max, first],
        FROM_BELOW: [rest, v.drive_max, v.drive_min, first],
    }
