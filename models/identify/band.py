"""How far a model may be off on a drive that it has not seen: one figure for the whole range.

What the model foretells errs by what its parameters are not known to (their covariance, carried to
a drive of all kinds, models.identify.comparison_drive), by what the structure left of stretches
that it had not seen, beyond the noise, and, where the data want what no invertible model gives, by
what that leaves on the drive of all kinds.
"""

from dataclasses import replace

import numpy as np

from dehyst.models.identify.comparison_drive import make_comparison_drive
from dehyst.models.identify.equations import linearise
from dehyst.models.identify.final import Fitted
from dehyst.models.identify.setup import FitSetup
from dehyst.models.recording import Floats

Z95 = 1.96
EVERY = 7  # rows of the drive of all kinds, which is none of its periods


def estimate_band(
    setup: FitSetup, fitted: Fitted, offset: float, covariance: Floats, left: float, noise: float
) -> float:
    """Half the width of the interval that holds 95 % of the displacements that the model foretells.

    covariance: (p, p) of the parameters; left: rms that the model leaves in the recordings; noise:
    rms of what changes there from row to row.
    """
    shape = fitted.shape
    rows = make_comparison_drive(
        setup.drive_min, setup.drive_max, setup.rate_max if shape.rate else 0.0
    )
    use = np.arange(rows.u.size) % EVERY == 0
    alone = replace(setup, rows=[rows], picks=[use])
    power, count = 0.0, 0
    for lot in alone.equations(alone.picks, fitted.r, offset, rate=shape.rate):
        jac, _ = linearise(lot, shape, fitted.params)
        power += float(np.einsum("ni,ij,nj->", jac, covariance, jac, optimize=True))
        count += jac.shape[0]
    unseen = max(left, fitted.scored.held_rms) ** 2 - noise**2
    return Z95 * float(np.sqrt(power / count + max(unseen, fitted.unreachable**2, 0.0)))
