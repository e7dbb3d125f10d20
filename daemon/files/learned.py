"""Learned correction of a trajectory on disk: JSON, valid for one model and one trajectory only."""

import hashlib
from pathlib import Path

import msgspec
import numpy as np

from dehyst.daemon.files.outputs import report_failures, whole_file
from dehyst.daemon.input_file import NotReadable, read_text
from dehyst.daemon.prepared import resolve_classes
from dehyst.models.errors import BadInput
from dehyst.models.recording import Floats

LARGEST_BYTES = 1 << 28


class Learned(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The file. model, trajectory: digests of those it belongs to; correction: one number per
    period of the loop, added to the target, in `unit`."""

    format: int = 1
    model: str
    trajectory: str
    period_s: float
    unit: str
    passes: int
    correction: list[float]


resolve_classes(Learned)


def trajectory_digest(target: Floats, period_s: float) -> str:
    """Return the digest of one pass at the loop's period: 16 characters."""
    data = np.asarray(target, "<f8").tobytes() + np.float64(period_s).tobytes()
    return hashlib.sha256(data).hexdigest()[:16]


def read_learned(path: Path, model: str, trajectory: str, unit: str, n: int) -> Floats | None:
    """Return the correction (n,) in a file; None if the file does not exist yet. Raises BadInput if
    the file is not a correction, or belongs to another model or trajectory."""
    if not path.exists():
        return None
    try:
        found = msgspec.json.decode(read_text(path, LARGEST_BYTES), type=Learned)
    except NotReadable as error:
        raise BadInput(f"{path}: cannot be read: {error}") from None
    except (msgspec.MsgspecError, ValueError) as error:
        raise BadInput(f"{path}: not a learned correction: {error}") from None
    for what, mine, its in (
        ("another model", model, found.model),
        ("another trajectory", trajectory, found.trajectory),
        ("another unit", unit, found.unit),
    ):
        if mine != its:
            raise BadInput(
                f"{path}: was learned with {what} ({its}, now it is {mine}); choose another file"
            )
    correction = np.array(found.correction)
    if found.format != 1 or correction.size != n or not np.isfinite(correction).all():
        raise BadInput(f"{path}: holds {correction.size} corrections, {n} are needed")
    return correction


def write_learned(path: Path, learned: Learned) -> None:
    """Write the file, completely or not at all. Raises BadInput."""
    with report_failures(path), whole_file(path) as file:
        file.write(msgspec.json.encode(learned))
