"""Compare an offered model with the one in use on telemetry to which neither was fitted."""

from dataclasses import dataclass, replace

import numpy as np

from dehyst.models.identify.validation import validate
from dehyst.models.model import Model
from dehyst.models.recording import Recording

ROUNDS, CLOSE = 4, 0.02
"""Largest number of steps towards the wanted zero, and the relative error at which they end."""


@dataclass(frozen=True)
class ReplayComparison:
    """rms residual of both models on the same recording, each without its mean; noise: rms;
    seconds: duration with a reading [s]."""

    in_use: float
    offered: float
    noise: float
    seconds: float

    @property
    def improves(self) -> bool:
        """Whether the offered model removes more power than that of the noise."""
        return self.in_use**2 - self.offered**2 > self.noise**2


def replay_both(
    in_use: Model, offered: Model, recording: Recording, noise: float, seconds: float
) -> ReplayComparison:
    """Run both models on the recording's drive; `seconds` of it have a reading. Raises BadInput if
    a model cannot be run on it."""
    before, after = validate(in_use, recording), validate(offered, recording)
    return ReplayComparison(before.rms, after.rms, noise, seconds)


def keep_zero(in_use: Model, offered: Model, recording: Recording) -> Model:
    """Return the offered model with its constant adjusted, so that a target means the same position
    as under the model in use with its trim: creep of the whole displacement shifts a model's zero
    by micrometres, and with a new model the trim starts at 0. Raises BadInput if a model cannot be
    run on the recording."""
    trim = recording.channels.get(f"trim_{in_use.displacement_unit}", np.zeros(1))
    wanted = validate(in_use, recording).offset + float(np.nanmean(trim))
    shift, gain, model = validate(offered, recording).offset - wanted, 1.0, offered
    for _ in range(ROUNDS):
        c = np.array(model.hysteresis.c)
        c[0] += shift / gain
        model = replace(model, hysteresis=replace(model.hysteresis, c=c))
        left = validate(model, recording).offset - wanted
        if abs(left) <= CLOSE * abs(shift):
            break
        gain *= (shift - left) / shift  # later blocks act on the constant as well
        shift = left
    return model
