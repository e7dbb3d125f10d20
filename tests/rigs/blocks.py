"""The forward side of a kind of block over a whole record."""

import numpy as np

from dehyst.models.arrays import Floats
from dehyst.models.physics import KINDS


def forward(
    kind: str,
    x: Floats,
    t_s: Floats,
    channel: Floats | None = None,
    **values: float | tuple[float, ...],
) -> Floats:
    """Return the output (N,) of a block for an input x (N,) at times t_s (N,); values by parameter
    name, missing ones at their defaults."""
    given = {p.name: p.default for p in KINDS[kind].params if p.default is not None} | values
    packed = {name: np.atleast_1d(np.asarray(v, np.float64)) for name, v in given.items()}
    return KINDS[kind].run(packed, x, t_s, channel)
