"""How far a model may be off on a drive that it has not seen: one figure for the whole range.

What the model predicts errs by what its parameters are not known to (their covariance, carried to
a drive of all kinds, models.identify.data.comparison_drive), by what structures differ there
between which the recordings do not decide, by what is left of stretches that were held out, beyond
the noise, and, where the data want what no invertible model gives, by what that leaves. Each is an
estimate of the same error, so that the largest is taken.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from dehyst.models.identify.data.comparison_drive import make_comparison_drive
from dehyst.models.identify.data.outliers import thin
from dehyst.models.identify.equations import Equations, Params, linearise
from dehyst.models.identify.final import Fitted
from dehyst.models.identify.fit import fit_shape, make_bounds
from dehyst.models.identify.pull import predict_lot
from dehyst.models.identify.setup import FitSetup
from dehyst.models.identify.structure import TriedStructure, pays
from dehyst.models.identify.thresholds import Prior
from dehyst.models.identify.tuning import TUNING
from dehyst.models.recording import Floats

Z95 = 1.96
EVERY = 7  # rows of the drive of all kinds, which is none of its periods


def estimate_band(
    setup: FitSetup,
    fitted: Fitted,
    offset: float,
    covariance: Floats,
    known: tuple[float, float, float],
) -> float:
    """Half the width of the interval that holds 95 % of the displacements that the model predicts.

    covariance: (p, p) of the parameters; known: rms that the model leaves in the recordings, of
    what the structures differ, and of the noise.
    """
    left, spread, noise = known
    power, count = 0.0, 0
    for lot in _list_equations(setup, fitted.r, offset, fitted.shape.rate):
        jac, _ = linearise(lot, fitted.shape, fitted.params)
        power += float(np.einsum("ni,ij,nj->", jac, covariance, jac, optimize=True))
        count += jac.shape[0]
    unseen = max(left, fitted.scored.held_rms) ** 2 - noise**2
    if len(setup.rows) == 1:
        unseen *= TUNING.another_waveform**2
    return Z95 * float(np.sqrt(max(power / count, spread**2, unseen, fitted.unreachable**2, 0.0)))


def is_rival(best: TriedStructure, other: TriedStructure) -> bool:
    """Do the recordings not decide between these two, of one kind?"""
    kind = (best.shape.rate, best.offset, best.lag, best.loose)
    if not other.invertible or other.superseded:
        return False  # it could not have been taken
    same = kind == (other.shape.rate, other.offset, other.lag, other.loose)
    return same and best.shape != other.shape and not pays(other, best, clear=0.0)


def measure_spread(
    setup: FitSetup, r: Floats, best: TriedStructure, rivals: Sequence[TriedStructure]
) -> float:
    """Rms of what the farthest of these structures, on thresholds r, differs from the best on a
    drive of all kinds. Each is fitted anew to the recordings: the parameters that it was compared
    by belong to equations that are linear about others."""
    if not rivals:
        return 0.0
    picks = thin(setup.picks, TUNING.rows_compared)
    lots = setup.equations(picks, r, best.offset, best.lag, best.shape.rate)
    own, *others = [_settle(setup, r, lots, one) for one in (best, *rivals)]
    powers, count = np.zeros(len(rivals)), 0
    for lot in _list_equations(setup, r, best.offset, best.shape.rate):
        here = predict_lot(lot, best.shape, own)
        count += here.size
        for at, (other, params) in enumerate(zip(rivals, others, strict=True)):
            powers[at] += float(np.sum((predict_lot(lot, other.shape, params) - here) ** 2))
    return float(np.sqrt(np.max(powers) / count))


def _settle(setup: FitSetup, r: Floats, lots: list[Equations], one: TriedStructure) -> Params:
    """Parameters of a structure at the minimum of its misfit within the bounds."""
    bounds = make_bounds(one.params, setup.limits, r, TUNING.narrow * setup.span * one.loose)
    prior = Prior(r, setup.slope, 0.5 * setup.span)
    return fit_shape(
        lambda: lots, one.shape, one.params, bounds, prior, one.strength, one.loose, (12, 1e-4)
    ).params


def _list_equations(setup: FitSetup, r: Floats, offset: float, rate: bool) -> Iterator[Equations]:
    """Equations of some rows of the drive of all kinds."""
    rows = make_comparison_drive(setup.drive_min, setup.drive_max, setup.rate_max if rate else 0.0)
    use = np.arange(rows.u.size) % EVERY == 0
    alone = replace(setup, rows=[rows], picks=[use])
    yield from alone.equations(alone.picks, r, offset, rate=rate)
