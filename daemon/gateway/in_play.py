"""Tracks the trajectory in play: the reach at its start, and the effect of a model change.

A trajectory in progress is not refused because the model, and hence the reach, has changed. Points
within the reach at its start are passed on; if they are beyond the present reach, the loop goes to
the nearest position and flags them. A file in the run folder hands this state to a gateway that
replaces a killed one.
"""

import logging
import math
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from dehyst.daemon.files.models import write_text
from dehyst.daemon.input_file import NotReadable, read_text
from dehyst.daemon.prepared import resolve_classes
from dehyst.models.units import how_many

log = logging.getLogger(__name__)
FILE = "in-play.json"
LARGEST_BYTES = 4096  # this record has a few hundred
REACH_SLACK = 1e-9  # displacement unit: rounding of a target at the end of the reach


class InPlay(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """State of the trajectory in play. low, high: reach at its start; beyond: number of points
    passed on that were outside the reach at the time; farthest: by how much at most [displacement
    unit]."""

    trajectory: int = 0
    client: int = 0
    low: float = math.nan
    high: float = math.nan
    beyond: int = 0
    farthest: float = 0.0

    def find_unreachable(
        self, values: NDArray[np.float64], reach: tuple[float, float]
    ) -> float | None:
        """Return None if targets (n,) are within the present or the initial reach, else a target
        that is not."""
        low, high = float(np.fmin(self.low, reach[0])), float(np.fmax(self.high, reach[1]))
        least, most = float(values.min()), float(values.max())
        if not least >= low - REACH_SLACK:
            return least
        return None if most <= high + REACH_SLACK else most

    def count(self, values: NDArray[np.float64], reach: tuple[float, float]) -> bool:
        """Count the targets (n,) beyond the present reach; return True if there is one."""
        far = np.maximum(reach[0] - values, values - reach[1])
        far = far[far > REACH_SLACK]
        if far.size:
            self.beyond += far.size
            self.farthest = max(self.farthest, float(far.max()))
        return bool(far.size)

    @classmethod
    def begin(cls, trajectory: int, client: int, reach: tuple[float, float]) -> "InPlay":
        """Return the state of a trajectory that begins with this reach."""
        return cls(trajectory=trajectory, client=client, low=reach[0], high=reach[1])

    def describe_beyond(self, reach: tuple[float, float], unit: str) -> str:
        """Describe how many points are beyond the present reach, by how much, and how they are
        handled."""
        beyond = how_many(self.beyond, "point passed on is", "points passed on so far are")
        return (
            f"the model or the trim has changed, and the reach is now {reach[0]:.6g} to "
            f"{reach[1]:.6g} {unit}: {beyond} beyond it, by up to "
            f"{self.farthest:.3g} {unit}; the loop takes the nearest position and flags it"
        )


def read_in_play(directory: Path) -> InPlay:
    """Read the state that an earlier gateway has written; an empty one if there is none."""
    try:
        return msgspec.json.decode(read_text(directory / FILE, LARGEST_BYTES), type=InPlay)
    except (NotReadable, msgspec.MsgspecError):
        return InPlay()


def write_in_play(directory: Path, now: InPlay) -> None:
    """Write the state for a later gateway; a failure is logged."""
    try:
        write_text(directory / FILE, msgspec.json.encode(now).decode())
    except OSError as error:
        log.warning("%s: cannot be written: %s", directory / FILE, error.strerror or error)


resolve_classes(InPlay)
