"""The physics around the hysteresis: one file for each, found in this folder.

Hysteresis of any shape, which the diagnosis' base makes, has its blocks by name: `curved_plays`,
`bent_loops`.
"""

from dehyst.models.physics.kind import Kind, Param
from dehyst.models.physics.registry import (
    KINDS,
    PHYSICS,
    PLACES,
    changes_alone,
    check_block,
    list_candidates,
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
    "curved_plays",
    "list_candidates",
]
