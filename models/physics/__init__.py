"""The physical effects around the hysteresis: one file each, found by listing this folder.

Other packages build some blocks directly, with functions exported here: those of a hysteresis of
any shape (`curved_plays`, `bent_loops`), of a lead and of a coupling. `line_for_a_time` returns the
texts for a line that is present at times.
"""

from dehyst.models.physics.coupling import coupled
from dehyst.models.physics.delay import lead
from dehyst.models.physics.hum import line_for_a_time
from dehyst.models.physics.kind import Kind, Param
from dehyst.models.physics.registry import (
    KINDS,
    PHYSICS,
    PLACES,
    changes_alone,
    check_block,
    list_candidates,
    split_off_one_recording,
    with_blocks,
)
from dehyst.models.physics.shape import DriveScale, bent_loops, curved_plays

__all__ = [
    "KINDS",
    "PHYSICS",
    "PLACES",
    "DriveScale",
    "Kind",
    "Param",
    "bent_loops",
    "changes_alone",
    "check_block",
    "coupled",
    "curved_plays",
    "lead",
    "line_for_a_time",
    "list_candidates",
    "split_off_one_recording",
    "with_blocks",
]
