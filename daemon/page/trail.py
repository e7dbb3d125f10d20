"""Past positions of an axis, decimated for drawing its path in the plane. Pure.

Keeps one point per POINT_NS of the loop's clock, the newest KEPT of them. Axes of one loop are
sampled at the same times, so that points with equal numbers belong together.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

POINT_NS = 5_000_000  # 5 ms: 200 points per second
KEPT = 6000  # 30 s


class TrailPoints(NamedTuple):
    """Points by ascending number, (n,) each; NaN: no target, no reading."""

    number: NDArray[np.int64]
    target: NDArray[np.float64]
    measured: NDArray[np.float64]


NOTHING = TrailPoints(np.zeros(0, np.int64), np.zeros(0), np.zeros(0))


class Trail:
    """The newest points of one axis."""

    def __init__(self) -> None:
        self._piece = NOTHING

    def add(self, samples: NDArray[Any]) -> None:
        """Add (n,) TELEMETRY records, ascending. If the clock was restarted, so is the trail."""
        number = samples["scheduled_ns"] // POINT_NS
        held = self._piece
        if held.number.size and number.size and number[-1] < held.number[0]:
            held = NOTHING
        newest = int(held.number[-1]) if held.number.size else -1
        first = np.flatnonzero(np.diff(number, prepend=newest) > 0)  # the first in each POINT_NS
        first = first[number[first] > newest]
        self._piece = TrailPoints(
            np.concatenate([held.number, number[first]])[-KEPT:],
            np.concatenate([held.target, samples["target"][first]])[-KEPT:],
            np.concatenate([held.measured, samples["measured"][first]])[-KEPT:],
        )

    def since(self, number: int) -> TrailPoints:
        """Return the points after this number."""
        start = int(np.searchsorted(self._piece.number, number, side="right"))
        held = self._piece
        return TrailPoints(held.number[start:], held.target[start:], held.measured[start:])


def join_trails(pieces: list[TrailPoints]) -> list[TrailPoints]:
    """Return, for each axis, the points that all of these axes have in common."""
    if not pieces:
        return []
    common = pieces[0].number
    for piece in pieces[1:]:
        common = np.intersect1d(common, piece.number, assume_unique=True)
    out = []
    for piece in pieces:
        place = np.searchsorted(piece.number, common)
        out.append(TrailPoints(common, piece.target[place], piece.measured[place]))
    return out
