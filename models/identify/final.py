"""The fit of the chosen structure on many operators and all rows.

A stage may want what an invertible model cannot give: an output that runs back right after a
reversal. The bounded fit would bend the rest of the model towards the recording at hand, and be
worse on every other drive. So a fit without bounds on narrow operators goes first, and the
invertible model is the one that is close to the data and, on a drive of all kinds
(dehyst.models.identify.comparison_drive), to that first fit alike.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dehyst.models.identify.bounded import bounded_solve
from dehyst.models.identify.comparison_drive import make_comparison_drive
from dehyst.models.identify.data.outliers import thin
from dehyst.models.identify.data.rows import Rows
from dehyst.models.identify.equations import (
    Equations,
    Normal,
    Params,
    Shape,
    assemble,
    measure_misfit,
)
from dehyst.models.identify.evidence import weigh
from dehyst.models.identify.fit import Solution, make_bounds, make_start, solve
from dehyst.models.identify.setup import FitSetup
from dehyst.models.identify.structure import Candidate, Trial
from dehyst.models.identify.thresholds import Prior, eliminate, regrid, space_thresholds
from dehyst.models.identify.tuning import TUNING
from dehyst.models.recording import Bools, Floats


@dataclass(frozen=True)
class Fitted:
    """The model's numbers. r: (n,) thresholds; free: unknowns off their bounds; strength: of the
    prior; scored: the structure on these operators, as it foretells stretches; costly: the data
    want what no invertible model gives; unreachable: rms of that on a drive of all kinds;
    equations: what was fitted, the pull's last; normal: the
    normal equations at the end, the prior's with them."""

    r: Floats
    shape: Shape
    params: Params
    free: Bools
    scored: Candidate
    costly: bool
    unreachable: float
    equations: list[Equations]
    normal: Normal
    orders: tuple[tuple[int, float], ...]


def fit_all(
    setup: FitSetup,
    best: Candidate,
    coarse: Floats,
    order: int | None,
    tried: Sequence[Candidate] = (),
) -> Fitted:
    """Fit the structure of a candidate, found on `coarse` thresholds, to all rows. tried: others,
    of which one with the second power of z may take its place."""
    finest = TUNING.fine if order is None else max(TUNING.finest, order)
    if order is None:
        r = space_thresholds(finest, setup.span, setup.wide, TUNING.spacing)
    else:
        r = space_thresholds(finest, setup.span)
    some = thin(setup.picks, TUNING.rows_compared)
    shape, offset, lag = best.shape, best.offset, best.lag
    start = regrid(best.params, coarse, r, shape)
    trial = Trial(setup, some, r, offset, lag, best.loose)
    trial.linearise(start, shape, shape.powers)
    weighed = weigh(trial, shape)
    if (found := find_bent(setup, best, tried)) is not None:
        bent, odds = found
        known = dict(zip(shape.powers, start.c, strict=True))
        curved = start._replace(c=np.array([known.get(p, 0.0) for p in bent.powers]))
        trial.prior = Prior(r, setup.slope, 0.5 * setup.span)
        trial.linearise(curved, bent, bent.powers)
        other = weigh(trial, bent, weighed.noise)
        if other.candidate.invertible and other.evidence > weighed.evidence + odds:
            weighed, shape, start = other, bent, curved
    scored, prior = weighed.candidate, weighed.prior
    strength = scored.strength
    trial.prior = prior
    narrow = TUNING.narrow * setup.span * trial.loose
    picks = thin(setup.picks, min(TUNING.rows_fitted, TUNING.most_held // (2 * r.size)))
    equations = setup.equations(picks, r, offset, lag, shape.rate)

    def run(lots: list[Equations], begin: Params, above: float, close: float = 1e-4) -> Solution:
        bounds, loose = make_bounds(begin, setup.limits, r, above), above > 0.0
        return solve(lambda: lots, shape, begin, bounds, prior, strength, loose, (12, close))

    begins = (scored.params, start)  # the first was fitted to linear equations about the second
    begin = min(begins, key=lambda p: measure_misfit(equations, shape, p))
    loose = run(equations, begin, narrow)
    tight = run(equations, loose.params, 0.0, 1e-3)
    costly = False
    pull: list[Equations] = []
    worse = tight.normal.misfit > loose.normal.misfit * (1.0 + TUNING.costs)
    if setup.limits is not None and worse:
        wish = make_pull(setup, r, shape, offset, loose.params)
        pull = weigh_pull(setup, wish, r, offset, shape.rate, 1.0)
        most = TUNING.pull_price**2 * loose.normal.misfit
        share = _find_share(setup, shape, tight, assemble(pull, shape, tight.params), r, most)
        pull = [lot._replace(weight=lot.weight * share) for lot in pull]
        costly = share > 0.0
        if costly:
            tight = run(equations + pull, tight.params, 0.0)
        else:
            pull = []
    if not costly:
        tight = run(equations, tight.params, 0.0)
    orders: tuple[tuple[int, float], ...] = ()
    if order is not None:
        r, tight, orders = _reduce(setup, trial, tight, r, shape, order, prior, strength)
        prior = replace(prior, r=r)
        equations = setup.equations(picks, r, offset, lag, shape.rate)
        if costly:
            pull = weigh_pull(setup, wish, r, offset, shape.rate, share)
        tight = run(equations + pull, tight.params, 0.0)
    normal = prior.add_to(tight.normal, shape.rate, strength)
    alone = [lot._replace(weight=1.0) for lot in pull]
    rows = sum(lot.y.size for lot in alone)
    off = float(np.sqrt(measure_misfit(alone, shape, tight.params) / max(1, rows)))
    every = equations + pull
    return Fitted(r, shape, tight.params, tight.free, scored, costly, off, every, normal, orders)


def find_bent(
    setup: FitSetup, best: Candidate, tried: Sequence[Candidate]
) -> tuple[Shape, float] | None:
    """A structure with one power of z more, which the evidence is asked about, and the logarithm
    of the odds that it needs; None: there is none.

    A sine or two tell a saturation and what the rate does nearly alike, so hold-out does not see
    it. About a bias every curve has a second power, which stands unless the evidence is against
    it. From the de-energised state the third (Eq. 3) has to have it on its side.
    """
    shape = best.shape
    if setup.running is not None or not shape.rate or any(shape.powers):
        return None
    if best.lag is not None and best.lag.place == "sensor":
        return None  # the equations have it before the saturation, where a curve is told wrongly
    power, odds = (3, TUNING.bent) if setup.virgin else (2, -TUNING.bent)
    bent = replace(shape, powers=(*shape.powers, power))
    known = any(power in c.shape.powers and c.shape.rate for c in tried)
    return (bent, odds) if known else None


def make_pull(setup: FitSetup, r: Floats, shape: Shape, offset: float, params: Params) -> Rows:
    """The comparison drive with the displacements that these parameters give for it."""
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
    """(n,) what the parameters give for these equations, but for the recordings' shifts."""
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
    """Equations of the pull, each of which counts so often."""
    alone = replace(setup, rows=[pull], picks=[pull.use])
    lots = alone.equations(alone.picks, r, offset, rate=rate)
    return [lot._replace(weight=weight) for lot in lots]


def _find_share(
    setup: FitSetup, shape: Shape, tight: Solution, pull: Normal, r: Floats, most: float
) -> float:
    """How much the pull may count so that the data's misfit, as linearised, stays below `most`; 0
    where the bounds alone cost nearly as much."""
    data, found = tight.normal, 0.0
    low, high = make_bounds(tight.params, setup.limits)
    for share in TUNING.pull_weights:
        weight = share * data.count / pull.count
        p, _ = bounded_solve(
            data.gram + weight * pull.gram, data.right + weight * pull.right, low, high, tight.free
        )
        if data.misfit_at(p) > most:
            break
        found = weight
    return found


def _reduce(
    setup: FitSetup,
    trial: Trial,
    found: Solution,
    r: Floats,
    shape: Shape,
    order: int,
    prior: Prior,
    strength: float,
) -> tuple[Floats, Solution, tuple[tuple[int, float], ...]]:
    """The `order` thresholds whose loss costs least, and the errors of all orders above."""
    normal = prior.add_to(found.normal, shape.rate, strength)
    low, _ = make_bounds(found.params, setup.limits)
    grids = eliminate(normal, normal, low, r.size, shape.rate, order)
    orders = tuple((len(g.kept), float(np.sqrt(g.held / max(1, normal.count)))) for g in grids)
    kept = list(grids[-1].kept)
    like = make_start(order, shape, setup.slope, len(setup.rows))
    return r[kept], replace(found, params=Params.unpacked(grids[-1].p, like)), orders
