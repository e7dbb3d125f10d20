"""Recordings with a lead-in, which determines the stage's memory and is not evaluated."""

from dataclasses import replace

import numpy as np

from dehyst.models.recording import Recording


def blank_lead(recording: Recording, lead_s: float) -> Recording:
    """Return the recording without readings in its first lead_s seconds."""
    y = recording.displacement
    if y is None or lead_s <= 0.0:
        return recording
    first = recording.t_s[0] + lead_s
    return replace(recording, displacement=np.where(_before(recording, first), np.nan, y))


def drop_lead(recording: Recording, lead_s: float) -> Recording:
    """Return the recording without its first lead_s seconds."""
    y = recording.displacement
    counts = ~_before(recording, recording.t_s[0] + lead_s)
    if y is None or lead_s <= 0.0 or not counts.any():
        return recording
    return replace(
        recording,
        t_s=recording.t_s[counts],
        drive=recording.drive[counts],
        displacement=y[counts],
        channels={name: column[counts] for name, column in recording.channels.items()},
    )


def _before(recording: Recording, first_s: float) -> np.ndarray:
    step = float(np.min(np.diff(recording.t_s))) if recording.size > 1 else 0.0
    return np.asarray(recording.t_s < first_s - 0.5 * step)  # half a step: times are rounded
