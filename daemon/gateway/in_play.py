"""The trajectory in play: the reach with which it was admitted, and what another model changes.

A trajectory that has begun is not refused because the model, and so the reach, has changed. Points
that were within the reach when it began are passed on; where they are beyond the reach of now, the
loop goes to the nearest place and flags it. The file in the run folder lets a gateway that takes
over from one that was killed know the same.
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

log = logging.getLogger(__name__)
FILE = "in-play.json"
LARGEST_BYTES = 4096
REACH_SLACK = 1e-9  # displacement unit: rounding of a target at the end of the reach


class InPlay(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """low, high: the reach when it began; beyond: points passed on that were outside the reach of
    their moment, farthest: by how much at most [displacement unit]."""

    trajectory: int = 0
    client: int = 0
    low: float = math.nan
    high: float = math.nan
    beyond: int = 0
    farthest: float = 0.0

    def admits(self, values: NDArray[np.float64], reach: tuple[float, float]) -> float | None:
        """None: targets (n,) are within the reach of now or of the beginning; else one that is
        not."""
        low, high = float(np.fmin(self.low, reach[0])), float(np.fmax(self.high, reach[1]))
        least, most = float(values.min()), float(values.max())
        if not least >= low - REACH_SLACK:
            return least
        return None if most <= high + REACH_SLACK else most

    def count(self, values: NDArray[np.float64], reach: tuple[float, float]) -> bool:
        """Count the targets (n,) that are beyond the reach of now; True where one is."""
        far = np.maximum(reach[0] - values, values - reach[1])
        far = far[far > REACH_SLACK]
        if far.size:
            self.beyond += far.size
            self.farthest = max(self.farthest, float(far.max()))
        return bool(far.size)

    @classmethod
    def begin(cls, trajectory: int, client: int, reach: tuple[float, float]) -> "InPlay":
        """A trajectory that begins with this reach."""
        return cls(trajectory=trajectory, client=client, low=reach[0], high=reach[1])

    def say_beyond(self, reach: tuple[float, float], unit: str) -> str:
        """How many points are beyond the reach of now, by how much, and what becomes of them."""
        return (
            f"the model or the trim has changed, and the reach is now {reach[0]:.6g} to "
            f"{reach[1]:.6g} {unit}: {self.beyond} points passed on so far are beyond it, by up to "
            f"{self.farthest:.3g} {unit}; the loop takes the nearest position and flags it"
        )


def read_in_play(directory: Path) -> InPlay:
    """What a gateway before this one has left; an empty one where there is nothing to read."""
    try:
        return msgspec.json.decode(read_text(directory / FILE, LARGEST_BYTES), type=InPlay)
    except (NotReadable, msgspec.MsgspecError):
        return InPlay()


def write_in_play(directory: Path, now: InPlay) -> None:
    """Leave it for a gateway after this one; where that fails, the log says so."""
    try:
        write_text(directory / FILE, msgspec.json.encode(now).decode())
    except OSError as error:
        log.warning("%s: cannot be written: %s", directory / FILE, error.strerror or error)


resolve_classes(InPlay)
