"""Find the physical effects around the hysteresis: one file each, found by listing this folder.

    drive blocks -> hysteresis (+ blocks parallel to it) -> stage blocks -> displacement
                 -> sensor blocks -> reading

Blocks in the same place act in the order in which the model lists them. Drive and stage blocks move
the stage and are compensated; sensor blocks affect only the reading and never are. The kind of a
block defines its inverse. Channels are assumed constant after the present sample.

A file with physics defines PHYSICS (see `dehyst.models.physics.entry`): to add physics, add a file.
"""

import importlib
import pkgutil
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from dehyst.models.errors import BadModel
from dehyst.models.model import Block, Model
from dehyst.models.physics.candidate import Candidate
from dehyst.models.physics.entry import Physics
from dehyst.models.physics.kind import Kind, Never
from dehyst.models.signals.joined import Data

PLACES = ("drive", "stage", "sensor")
# files of this folder that define no physics
FRAME = ("address", "candidate", "dynamics", "entry", "kind", "registry")


def _found() -> dict[str, Physics]:
    names = [m.name for m in pkgutil.iter_modules([str(Path(__file__).parent)])]
    return {
        name: importlib.import_module(f"{__package__}.{name}").PHYSICS
        for name in names
        if name not in FRAME
    }


PHYSICS: dict[str, Physics] = _found()  # by file
KINDS: dict[str, Kind] = {kind.name: kind for one in PHYSICS.values() for kind in one.kinds}


def list_candidates(data: Data) -> list[Candidate]:
    """Return every candidate that these recordings allow, in the order of the cascade."""
    found = [c for one in PHYSICS.values() for c in one.candidates(data)]
    return sorted(found, key=lambda c: c.order)


def changes_alone(data: Data) -> list[Candidate]:
    """Return the candidates that can be reported only as the single change from a model that was
    right before."""
    return [c for one in PHYSICS.values() for c in one.changes(data)]


def check_block(block: Block, drive_unit: str = "", displacement_unit: str = "") -> None:
    """Raise BadModel, which names the key, if a block's kind, place, channel or parameters are
    wrong. Units: those of the model, "" if unknown."""
    kind = KINDS.get(block.kind)
    if kind is None:
        raise BadModel(f"kind: {block.kind!r} is not known; known are {', '.join(KINDS)}")
    if block.place not in kind.places:
        raise BadModel(
            f"place: a block of kind {kind.name!r} belongs at {' or '.join(kind.places)}, "
            f"not at {block.place!r}"
        )
    if kind.channel and not block.channel:
        raise BadModel(f"channel: kind {kind.name!r} needs the name of a channel")
    if block.channel and not kind.channel:
        raise BadModel(f"channel: kind {kind.name!r} reads no channel")
    kind.values(block, drive_unit, displacement_unit)


def split_off_one_recording(model: Model) -> tuple[Model, tuple[str, ...]]:
    """Return (the model without the blocks that describe one recording only, what these are, in
    words). A controller runs at other times than the recording, and starts at another phase and
    with another past."""

    def is_of_one(block: Block) -> bool:
        inverse = KINDS[block.kind].inverse
        return isinstance(inverse, Never) and inverse.of_one_recording

    left_out = [block for block in model.blocks if is_of_one(block)]
    kept = tuple(block for block in model.blocks if not is_of_one(block))
    says = tuple(dict.fromkeys(KINDS[block.kind].says for block in left_out))
    return replace(model, blocks=kept), says


def with_blocks(model: Model, blocks: Iterable[Block]) -> Model:
    """Return the model with further blocks, in the order of the cascade: drive blocks before its
    own, the others after them."""
    added = list(blocks)
    before = [b for b in added if b.place == "drive"]
    behind = [b for b in added if b.place != "drive"]

    def rank(block: Block) -> float:
        return 0.5 if KINDS[block.kind].is_parallel else PLACES.index(block.place)

    return replace(model, blocks=tuple(sorted([*before, *model.blocks, *behind], key=rank)))
