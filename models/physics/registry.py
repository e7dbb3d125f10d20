"""The physics around the hysteresis: one file for each, found by listing this folder.

    drive blocks -> hysteresis (+ what stands beside it) -> stage blocks -> displacement
                 -> sensor blocks -> reading

Blocks of one place act in the order in which the model lists them. The drive compensates what
moves the stage (drive and stage blocks); what only the sensor does is never compensated. How a
block is undone stands with its kind; ahead of the present sample a channel is taken to stand still.

A file with physics defines PHYSICS (see `dehyst.models.physics.entry`): to add physics, add a file.
"""

import importlib
import pkgutil
from pathlib import Path

from dehyst.models.errors import BadModel
from dehyst.models.model import Block
from dehyst.models.physics.candidate import Candidate
from dehyst.models.physics.entry import Physics
from dehyst.models.physics.kind import Kind
from dehyst.models.signals.joined import Data

PLACES = ("drive", "stage", "sensor")
# files here that are no physics
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
    """Every candidate that these recordings allow, in the order of their place in the cascade."""
    found = [c for one in PHYSICS.values() for c in one.candidates(data)]
    return sorted(found, key=lambda c: c.order)


def changes_alone(data: Data) -> list[Candidate]:
    """What can be reported only as the one change of a stage whose model was right."""
    return [c for one in PHYSICS.values() for c in one.changes(data)]


def check_block(block: Block, drive_unit: str = "", displacement_unit: str = "") -> None:
    """Raise BadModel, naming the key, where a block's kind, place, channel or parameters are
    wrong. Units: those of the model, "" where they are not known."""
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
