"""Pull an invertible model towards the shape that the data call for if no invertible model has it.

The data may call for an output that moves backwards right after a reversal, which no invertible
model gives. A bounded fit would bend the rest of the model towards this one recording and be worse
on every other drive. So a fit without bounds on narrow operators comes first, and the invertible
model is the one that is close both to the data and, on the comparison drive
(dehyst.models.identify.data.comparison_drive), to that first fit.
"""

from dataclasses import replace

import numpy as np

from dehyst.models.identify.bounded import bounded_solve
from dehyst.models.identify.data.comparison_drive import make_comparison_drive
from dehyst.models.identify.data.rows import Rows
from dehyst.models.identify.equations import Equations, Normal, Params, Shape
from dehyst.models.identify.fit import Bounds
from dehyst.models.identify.setup import FitSetup
from dehyst.models.recording import Floats


def make_pull(setup: FitSetup, r: Floats, shape: Shape, offset: float, params: Params) -> Rows:
    """Return the comparison drive with the displacements that these parameters give for it."""
    rate_max = setup.rate_max if shape.rate else 0.0
    rows = make_comparison_drive(setup.drive_min, setup.drive_max, rate_max)
    alone = replace(setup, rows=[rows], picks=[rows.use])
    y = np.empty(rows.u.size)
    start = 0
    for lot in alone.equations(alone.picks, r, offset, rate=shape.rate):
        one = params._replace(shifts=np.zeros(0))
        stop = start + lot.y.size
        y[start:stop] = setup.sign * predict_lot(lot, shape, one)
        start = stop
    return replace(rows, y=y)


def predict_lot(lot: Equations, shape: Shape, params: Params) -> Floats:
    """Return the prediction (n,) of the parameters for these equations, without the recordings'
    shifts."""
    n = lot.d.shape[1]
    if shape.rate:
        up, down = params.slopes[:n], params.slopes[n:]
        z = 0.5 * (lot.d @ (up + down) + lot.e[:, :n] @ (up - down))
    else:
        z = lot.d @ params.slopes
    if shape.free_offset:
        z = z + params.lead[0] * lot.pace
    return z + sum(c * z**p for p, c in zip(shape.powers, params.c, strict=True))


def weigh_pull(
    setup: FitSetup, pull: Rows, r: Floats, offset: float, rate: bool, weight: float
) -> list[Equations]:
    """Return the equations of the pull, each counted `weight` times."""
    alone = replace(setup, rows=[pull], picks=[pull.use])
    lots = alone.equations(alone.picks, r, offset, rate=rate)
    return [lot._replace(weight=weight) for lot in lots]


def find_share(data: Normal, whole: Normal, pull: Normal, bounds: Bounds, most: float) -> float:
    """Return the weight of the pull relative to all rows: the largest that keeps the linearised
    misfit of the data below `most`, but at least 0.01.

    data: normal equations of the rows; whole: these with the prior; pull: those of the pull.
    """
    low, high = bounds
    found, free = 0.01, None
    for share in np.geomspace(found, 1.0, 15):  # 1: as much as all rows together
        weight = share * data.count / pull.count
        gram, right = whole.gram + weight * pull.gram, whole.right + weight * pull.right
        p, free = bounded_solve(gram, right, low, high, free)
        if data.misfit_at(p) > most:
            break
        found = share
    return found
