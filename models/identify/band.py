"""Estimate how far a model may be off on an unseen drive: one figure for the whole range.

The misfit of a model shows out of sample, on stretches of its own recording that were left out,
both of time and of the drive's segments, beyond the noise. Errors on left-out stretches of time are
used with their own distribution, by the quantile that holds 95 % of them (as in the jackknife+: R.
F. Barber et al., Ann. Stat. 49, 2021): misfit has no tails as noise has, so 1.96 times its rms is
too wide. One recording contains one waveform, so a factor widens the quantile for other waveforms.
The effect of noise on the parameters is independent of it and adds in squares, computed on the
comparison drive (models.identify.data.comparison_drive). On that drive, structures between which
the recordings do not decide may differ, and the model may differ from the shape that the data call
for if no invertible model has it. These are estimates of the same error, so the largest is used.
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
from dehyst.models.model import Fit
from dehyst.models.recording import Floats
from dehyst.models.signals.error_size import Z95

EVERY = 7  # one row in this many of the comparison drive; not commensurate with its periods


def estimate_band(
    setup: FitSetup,
    fitted: Fitted,
    offset: float,
    jackknife: Jackknife,
    known: tuple[float, float],
) -> float:
    """Return half the width of the interval that holds 95 % of the displacements that the model
    predicts.

    jackknife: with each stretch of time left out; known: rms difference between the candidate
    structures, and rms noise.
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


def is_stated(fit: Fit, band: float, stroke: float) -> bool:
    """Return whether the interval of this half-width is narrow enough to be stated: a small part of
    the stroke, of a model that leaves mostly noise, and not far beyond that of the noise, as where
    a drift adds to it. An interval for what a model leaves out holds for every second waveform."""
    assert fit.noise_rms is not None
    beyond = band > TUNING.twice * Z95 * fit.noise_rms
    return fit.leaves_mostly_noise and not beyond and band <= TUNING.quarter * stroke


def is_rival(best: TriedStructure, other: TriedStructure) -> bool:
    """Return whether the recordings do not decide between these two candidates of one kind."""
    kind = (best.shape.rate, best.offset, best.lag, best.loose)
    if not other.invertible or other.superseded:
        return False  # it could not have been chosen
    same = kind == (other.shape.rate, other.offset, other.lag, other.loose)
    return same and best.shape != other.shape and not pays(other, best, clear=0.0)


def measure_spread(
    setup: FitSetup, r: Floats, best: TriedStructure, rivals: Sequence[TriedStructure]
) -> float:
    """Return the rms difference on the comparison drive between the best structure and the farthest
    of its rivals, all on thresholds r. Each is fitted to the recordings again, because the
    parameters by which it was compared belong to equations linearised about others."""
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
    """Return the parameters of a structure at the minimum of its misfit within the bounds."""
    bounds = make_bounds(one.params, setup.limits, r, TUNING.crumb * setup.span * one.loose)
    prior = Prior(r, setup.slope, 0.5 * setup.span)
    # (12, 1e-4) is the effort of the last fit
    return fit_shape(
        lots, one.shape, one.params, bounds, prior, one.strength, one.loose, (12, 1e-4)
    ).params


def _list_equations(setup: FitSetup, r: Floats, offset: float, rate: bool) -> Iterator[Equations]:
    """Yield the equations of some rows of the comparison drive."""
    rows = make_comparison_drive(setup.drive_min, setup.drive_max, setup.rate_max if rate else 0.0)
    use = np.arange(rows.u.size) % EVERY == 0
    alone = replace(setup, rows=[rows], picks=[use])
    yield from alone.equations(alone.picks, r, offset, rate=rate)
