"""A model that is offered, tried on telemetry that it was not fitted to, beside the one in use; and
which of its blocks explains what is new.

Each block alone is put behind the model in use, and both are run on what came after the mismatch
and on the last good recording. What a block removes of the one and not of the other is new. The
shares of a diagnosis cannot say that: where the loop's shape is fitted anew, they are nearly all
its.
"""

from dataclasses import dataclass, replace

from dehyst.models.errors import BadInput
from dehyst.models.identify.validation import validate
from dehyst.models.model import Block, Model
from dehyst.models.recording import Recording

SHAPES = ("shape", "memory")
"""Kinds of block that are the loop's new shape: only known where the recording was."""


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


def weigh_new(
    in_use: Model, augmented: Model, later: Recording, good: Recording | None
) -> list[tuple[Block, float]]:
    """The blocks of physics that the augmented model has beyond the one in use, each with the mean
    square that it alone removes of what came later, less what it removes of the good recording;
    the largest first."""
    found = []
    for block in augmented.blocks:
        if block.kind in SHAPES or block in in_use.blocks:
            continue
        alone = replace(in_use, blocks=(*in_use.blocks, block))
        try:
            new = _removed(in_use, alone, later)
            if good is not None:
                new -= max(0.0, _removed(in_use, alone, good))
        except BadInput:
            continue
        found.append((block, new))
    return sorted(found, key=lambda one: -one[1])


def _removed(in_use: Model, alone: Model, recording: Recording) -> float:
    return validate(in_use, recording).rms ** 2 - validate(alone, recording).rms ** 2


def models_to_try(
    in_use: Model, augmented: Model, ranked: list[tuple[Block, float]]
) -> list[Model]:
    """From the sparsest to the richest: what is new alone, all physics, and with a new shape."""
    blocks = [tuple(block for block, _ in ranked[:1])] if ranked else []
    physics = tuple(b for b in augmented.blocks if b.kind not in SHAPES and b not in in_use.blocks)
    blocks += [physics] if len(physics) > 1 else []
    out = [replace(in_use, blocks=(*in_use.blocks, *some)) for some in blocks]
    return [*out, augmented]
