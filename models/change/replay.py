"""A model that is offered, tried on telemetry that it was not fitted to, beside the one in use."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from dehyst.models.identify.validation import validate
from dehyst.models.model import Block, Model
from dehyst.models.physics import KINDS
from dehyst.models.recording import Recording

PLACES = {"drive": 0.0, "stage": 1.0, "sensor": 2.0}
BESIDE = 0.5
ROUNDS, CLOSE = 4, 0.02
"""Steps towards the wanted zero, and the part of a step that may be left."""


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


def replay_both(
    in_use: Model, offered: Model, recording: Recording, noise: float, seconds: float
) -> BothReplayed:
    """Run both on the recording's drive; `seconds` of it have a reading. Raises BadInput where one
    cannot be run on it."""
    before, after = validate(in_use, recording), validate(offered, recording)
    return BothReplayed(before.rms, after.rms, noise, seconds)


def keep_zero(in_use: Model, offered: Model, recording: Recording) -> Model:
    """The offered model with the constant with which a target means the same place as under the one
    in use and its trim: a creep of the whole displacement moves a model's zero by micrometres, and
    with another model the trim begins at nothing. Raises BadInput where one cannot be run on the
    recording."""
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
        gain *= (shift - left) / shift  # blocks behind take the constant up, too
        shift = left
    return model


def with_blocks(model: Model, blocks: Iterable[Block]) -> Model:
    """The model with these around it: before its drive's blocks, behind its others."""
    added = list(blocks)
    before = [b for b in added if b.place == "drive"]
    behind = [b for b in added if b.place != "drive"]

    def rank(block: Block) -> float:
        return BESIDE if KINDS[block.kind].beside else PLACES[block.place]

    return replace(model, blocks=tuple(sorted([*before, *model.blocks, *behind], key=rank)))
