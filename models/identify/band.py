"""How far a model may be off on a drive that it has not seen: one figure for the whole range.

What a model misses shows out of sample, on stretches of its own recording that were left out, of
time and of the drive's ways, beyond the noise. Errors of the first are taken as they are
distributed, by the quantile that holds 95 % of them (as in the jackknife+: R. F. Barber et al.,
Ann. Stat. 49, 2021): misfit has no tails as noise has, so that 1.96 times its rms is too wide. One
recording shows one waveform, and one factor widens the quantile for another. What noise does to the
parameters is independent of it and adds in squares, carried to a drive of all kinds
(models.identify.data.comparison_drive). There structures may differ between which the recordings do
not decide, and the model may differ from what the data want where no invertible model gives it:
estimates of the same error, of which the largest is taken.
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
from dehyst.models.identify.uncertainty import Jackknife
from dehyst.models.recording import Floats

Z95 = 1.96
EVERY = 7  # rows of the drive of all kinds, which is none of its periods


def estimate_band(
    setup: FitSetup,
    fitted: Fitted,
    offset: float,
    jackknife: Jackknife,
    known: tuple[float, float],
) -> float:
    """Half the width of the interval that holds 95 % of the displacements that the model predicts.

    jackknife: without each stretch of time; known: rms of what the structures differ, and of the
    noise.
    """
    spread, noise = known
    power, count = 0.0, 0
    for lot in _list_equations(setup, fitted.r, offset, fitted.shape.rate):
        jac, _ = linearise(lot, fitted.shape, fitted.params)
        power += float(np.einsum("ni,ij,nj->", jac, jackknife.by_noise, jac, optimize=True))
        count += jac.shape[0]
    by_noise = noise**2 * power / count
    left_out = float(np.quantile(np.abs(jackknife.left_out), 0.95)) ** 2 - (Z95 * noise) ** 2
    if len(setup.rows) == 1:
        left_out *= TUNING.near**2
    held = Z95**2 * (fitted.scored.held_rms**2 - noise**2)
    unseen = max(0.0, left_out, held) + Z95**2 * by_noise
    return float(np.sqrt(max(unseen, Z95**2 * max(spread, fitted.unreachable) ** 2)))


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
    bounds = make_bounds(one.params, setup.limits, r, TUNING.crumb * setup.span * one.loose)
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
