"""Select stretches of a very long recording: as many rows as a model needs.

Every trial of a structure runs the operators through all rows. A million more rows lower the error
of a fit by less than a nanometre, but lengthen each of hundreds of trials.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from dehyst.models.arrays import Ints
from dehyst.models.identify.tuning import TUNING
from dehyst.models.recording import Floats, Recording

Some = TypeVar("Some", bound=np.generic)


@dataclass(frozen=True)
class Taken:
    """The part of a recording that is used. whole: rows of the whole recording; rows: (n,) used
    rows of it; note: a remark for the user."""

    recording: Recording
    whole: int
    rows: Ints | None = None
    note: str = ""

    def spread(self, values: NDArray[Some], empty: Any) -> NDArray[Some]:
        """Return (whole,) values with `values` (n,) at their rows and `empty` elsewhere."""
        if self.rows is None:
            return values
        out: NDArray[Some] = np.full(self.whole, empty, dtype=values.dtype)
        out[self.rows] = values
        return out


def take_stretches(recording: Recording, most: int = TUNING.most_rows) -> Taken:
    """Return at most `most` rows of a recording, in stretches spread over it, the first from its
    start.

    In each stretch the drive covers nearly all of its range, so that the memory of the stage
    becomes known; the slower the drive, the fewer and longer the stretches. Returns all rows if no
    stretch does.
    """
    size = recording.size
    if size <= most or np.isnan(recording.drive).all():
        return Taken(recording, size)
    span = float(np.nanmax(recording.drive) - np.nanmin(recording.drive))
    # the most stretches first, as they spread over more of the recording; halving their number
    # doubles their length, in which a slower drive can cover its range
    for count in (4, 2, 1):
        each = most // count
        begins = np.linspace(0, size - each, count).astype(np.int64)
        parts = [recording.drive[at : at + each] for at in begins]
        if _least_range(parts) >= (1.0 - TUNING.minor) * span:
            rows = (begins[:, None] + np.arange(each)).ravel()
            return Taken(_pick(recording, rows), size, rows, _tell(recording, rows.size, count))
    return Taken(recording, size)


def _least_range(parts: Sequence[Floats]) -> float:
    known = [part[~np.isnan(part)] for part in parts]
    return min(float(np.ptp(part)) if part.size else 0.0 for part in known)


def _pick(one: Recording, rows: Ints) -> Recording:
    return replace(
        one,
        t_s=one.t_s[rows],
        drive=one.drive[rows],
        displacement=None if one.displacement is None else one.displacement[rows],
        channels={name: values[rows] for name, values in one.channels.items()},
    )


def _tell(one: Recording, rows: int, count: int) -> str:
    ways = f"{count} stretches spread over it" if count > 1 else "its first stretch"
    return (
        f"{one.name}: {rows} of {one.size} rows were used, {ways}; error, noise and gaps in "
        "time refer to these rows"
    )
