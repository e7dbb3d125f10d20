"""A model that is offered, tried on telemetry that it was not fitted to, beside the one in use."""

from dataclasses import dataclass

from dehyst.models.identify.validation import validate
from dehyst.models.model import Model
from dehyst.models.recording import Recording


@dataclass(frozen=True)
class BothReplayed:
    """rms misfit of both models on the same recording, each without its mean; noise: rms."""

    in_use: float
    offered: float
    noise: float
    seconds: float

    @property
    def improves(self) -> bool:
        """By more than the noise: what the offered model removes is of more power than that."""
        return self.in_use**2 - self.offered**2 > self.noise**2


def replay_both(in_use: Model, offered: Model, recording: Recording, noise: float) -> BothReplayed:
    """Run both on the recording's drive. Raises BadInput where one cannot be run on it."""
    before, after = validate(in_use, recording), validate(offered, recording)
    seconds = float(recording.t_s[-1] - recording.t_s[0])
    return BothReplayed(before.rms, after.rms, noise, seconds)
