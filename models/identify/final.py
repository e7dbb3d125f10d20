"""Fit the chosen structure with many operators to all rows.

The first fit leaves narrow operators unbounded; if the bounds cost much misfit, the invertible
model is pulled towards the shape of that first fit (dehyst.models.identify.pull).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dehyst.models.identify.data.outliers import thin
from dehyst.models.identify.equations import (
    Equations,
    Normal,
    Params,
    Shape,
    assemble,
    measure_misfit,
)
from dehyst.models.identify.evidence import maximise_evidence
from dehyst.models.identify.fit import Solution, fit_shape, make_bounds, make_start
from dehyst.models.identify.pull import find_share, make_pull, weigh_pull
from dehyst.models.identify.setup import FitSetup
from dehyst.models.identify.structure import Trial, TriedStructure
from dehyst.models.identify.thresholds import (
    Prior,
    at_one_rate,
    change_rates,
    eliminate,
    regrid,
    space_thresholds,
)
from dehyst.models.identify.tuning import TUNING
from dehyst.models.recording import Bools, Floats


@dataclass(frozen=True)
class Fitted:
    """The fitted model and its equations.

    setup: the setup to which they belong; r: (n,) thresholds; free: unknowns that are off their
    bounds; scored: the structure with these operators, with its held-out scores; costly: the data
    call for a behaviour that no invertible model has; unreachable: rms of that behaviour on the
    comparison drive; equations: the fitted equations, those of the pull last; normal: the normal
    equations at the end, including the prior; orders: (number of operators, rms error of
    the fitted rows) of each reduced grid.
    """

    setup: FitSetup
    r: Floats
    shape: Shape
    params: Params
    free: Bools
    scored: TriedStructure
    costly: bool
    unreachable: float
    equations: list[Equations]
    normal: Normal
    orders: tuple[tuple[int, float], ...]

    def held_rms(self, left: float) -> float:
        """Return the held-out rms error of the written model, which leaves this rms in the
        recordings: that of the structure and, in quadrature, what the written model leaves beyond
        the fit of the structure, because it can be inverted or has the offset of the end."""
        scored = self.scored
        beyond = max(0.0, left**2 - (1.0 + TUNING.minor) * scored.fitted_rms**2)
        return float(np.sqrt(scored.held_rms**2 + beyond))


def fit_all(
    setup: FitSetup,
    best: TriedStructure,
    coarse: Floats,
    order: int | None,
    tried: Sequence[TriedStructure] = (),
) -> Fitted:
    """Fit the structure of a candidate, found with `coarse` thresholds, to all rows. tried: other
    candidates; one with a further power of z may replace it.

    If the data call for a behaviour that a model with positive slopes at every rate cannot have,
    slopes are only kept positive up to the rates that the drive can have after a turn. Structures
    are compared without that freedom, because with it a rate-dependence may be mistaken for a lag.
    """
    found = _fit(setup, best, coarse, order, tried)
    if found is None:
        found = _fit(replace(setup, by_turns=True), best, coarse, order, tried)
    assert found is not None  # only a fit without the freedom returns None
    return found


def _fit(
    setup: FitSetup,
    best: TriedStructure,
    coarse: Floats,
    order: int | None,
    tried: Sequence[TriedStructure],
) -> Fitted | None:
    """Return None if the bounds cost misfit and the freedom after a turn would loosen them."""
    finest = max(TUNING.fine, order or 0)
    if order is None:
        r = space_thresholds(finest, setup.span, setup.wide, TUNING.spacing)
    else:
        r = space_thresholds(finest, setup.span)
    some = thin(setup.picks, TUNING.rows_compared)
    shape, offset, lag = best.shape, best.offset, best.lag
    shares = setup.rates(r) / setup.rate_max if shape.rate else 1.0
    start = regrid(best.params, coarse, r, shape, shares)
    trial = Trial(setup, some, r, offset, lag, best.loose)
    trial.linearise(start, shape, shape.powers)
    weighed = maximise_evidence(trial, shape)
    if (bent := find_bent(setup, best, tried)) is not None:
        known = dict(zip(shape.powers, start.c, strict=True))
        curved = start._replace(c=np.array([known.get(p, 0.0) for p in bent.powers]))
        trial.prior = Prior(r, setup.slope, 0.5 * setup.span)
        trial.linearise(curved, bent, bent.powers)
        other = maximise_evidence(trial, bent, weighed.noise)
        if other.candidate.invertible and other.evidence > weighed.evidence - TUNING.certain:
            weighed, shape, start = other, bent, curved
    scored, prior = weighed.candidate, weighed.prior
    strength = scored.strength
    trial.prior = prior
    narrow = TUNING.crumb * setup.span * trial.loose
    picks = thin(setup.picks, TUNING.rows_fitted)
    equations = setup.equations(picks, r, offset, lag, shape.rate)

    def run(lots: list[Equations], begin: Params, above: float, close: float = 1e-4) -> Solution:
        bounds, loose = make_bounds(begin, setup.limits, r, above), above > 0.0
        return fit_shape(lots, shape, begin, bounds, prior, strength, loose, (12, close))

    begins = (scored.params, start)  # the first solves the equations linearised about the second
    begin = min(begins, key=lambda p: measure_misfit(equations, shape, p))
    loose = run(equations, begin, narrow)
    tight = run(equations, loose.params, 0.0, 1e-3)  # rough: the last run refines it
    least, bounded = loose.normal.misfit, tight.normal.misfit
    freed = float(np.count_nonzero(r <= narrow) * (1 + shape.rate))  # each gains a little by chance
    chance = (freed + TUNING.sure * np.sqrt(2.0 * freed)) / loose.normal.count
    costly = setup.limits is not None and bounded > least * (1.0 + TUNING.trace + chance)
    if costly and shape.rate and not setup.by_turns:
        slower = replace(setup, by_turns=True).rates(r) < setup.rate_max
        if slower.any():
            return None
    pull: list[Equations] = []
    begin, weight = tight.params, 0.0
    if costly:
        wish = make_pull(setup, r, shape, offset, loose.params)
        each = loose.normal.count / wish.u.size
        pull = weigh_pull(setup, wish, r, offset, shape.rate, each)
        # the pull moves the model far, so compute its cost at the end of that move
        begin = run(equations + pull, begin, 0.0, 1e-3).params  # likewise
        data = assemble(equations, shape, begin)
        whole = prior.add_to(data, shape.rate, strength)
        pull = [lot._replace(weight=1.0) for lot in pull]
        most = max(least * (1.0 + TUNING.minor), least + (1.0 + TUNING.half) * (bounded - least))
        bounds = make_bounds(begin, setup.limits)
        weight = each * find_share(data, whole, assemble(pull, shape, begin), bounds, most)
        pull = [lot._replace(weight=weight) for lot in pull]
    tight = run(equations + pull, begin, 0.0)
    orders: tuple[tuple[int, float], ...] = ()
    if order is not None:
        r, tight, orders = _reduce(setup, tight, r, shape, order, prior, strength)
        prior = replace(prior, r=r)
        equations = setup.equations(picks, r, offset, lag, shape.rate)
        if costly:
            pull = weigh_pull(setup, wish, r, offset, shape.rate, weight)
        tight = run(equations + pull, tight.params, 0.0)
    normal = prior.add_to(tight.normal, shape.rate, strength)
    alone = [lot._replace(weight=1.0) for lot in pull]
    rows = sum(lot.y.size for lot in alone)
    off = float(np.sqrt(measure_misfit(alone, shape, tight.params) / max(1, rows)))
    every = equations + pull
    return Fitted(
        setup, r, shape, tight.params, tight.free, scored, costly, off, every, normal, orders
    )


def find_bent(
    setup: FitSetup, best: TriedStructure, tried: Sequence[TriedStructure]
) -> Shape | None:
    """Return a structure with one more power of z, for comparison by evidence; None if there is
    none.

    One or two sines hardly distinguish a saturation from a rate-dependence, so hold-out does not
    detect it. Every curve bends, by a second power about a bias and by a third (Eq. 3) from the
    de-energised state. The bent curve is kept unless the evidence contradicts it: a bend where
    there is none costs a fraction of the error of a bend left out.
    """
    shape = best.shape
    if setup.running is not None or not shape.rate or any(shape.powers):
        return None
    if best.lag is not None and best.lag.place == "sensor":
        # the equations apply this lag before the saturation, so a curve is predicted wrongly
        return None
    power = 3 if setup.virgin else 2
    bent = replace(shape, powers=(*shape.powers, power))
    known = any(power in c.shape.powers and c.shape.rate for c in tried)
    return bent if known else None


def _reduce(
    setup: FitSetup,
    found: Solution,
    r: Floats,
    shape: Shape,
    order: int,
    prior: Prior,
    strength: float,
) -> tuple[Floats, Solution, tuple[tuple[int, float], ...]]:
    """Return the `order` thresholds whose removal costs least, their solution, and the errors of
    all larger orders."""
    normal = prior.add_to(found.normal, shape.rate, strength)
    low, _ = make_bounds(found.params, setup.limits)
    if setup.by_turns:
        shares = setup.rates(r) / setup.rate_max
        normal = at_one_rate(normal, shares)
        low[: 2 * r.size][np.tile(shares < 1.0, 2)] = -np.inf
    grids = eliminate(normal, low, r.size, shape.rate, order)
    orders = tuple((len(g.kept), float(np.sqrt(g.misfit / max(1, normal.count)))) for g in grids)
    kept = list(grids[-1].kept)
    like = make_start(order, shape, setup.slope, len(setup.rows))
    params = Params.unpacked(grids[-1].p, like)
    if setup.by_turns:
        slopes = change_rates(params.slopes, setup.rates(r[kept]) / setup.rate_max)
        params = params._replace(slopes=slopes)
    return r[kept], replace(found, params=params), orders
