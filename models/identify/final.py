"""The fit of the chosen structure on many operators and all rows.

Without bounds on narrow operators first; where these cost, the invertible model is held to the
shape of that first fit (dehyst.models.identify.pull).
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
    """The model's numbers. setup: what they belong to; r: (n,) thresholds; free: unknowns off
    their bounds; strength: of the prior; scored: the structure on these operators, as it predicts
    stretches; costly: the data want what no invertible model gives; unreachable: rms of that on a
    drive of all kinds; equations: what was fitted, the pull's last; normal: the normal equations
    at the end, the prior's with them."""

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


def fit_all(
    setup: FitSetup,
    best: TriedStructure,
    coarse: Floats,
    order: int | None,
    tried: Sequence[TriedStructure] = (),
) -> Fitted:
    """Fit the structure of a candidate, found on `coarse` thresholds, to all rows. tried: others,
    of which one with the second power of z may take its place.

    Where the data want what a model cannot give whose slopes are positive at every rate, they are
    positive up to the rates that the drive can have after a turn. Structures are compared without
    that freedom, in which a rate-dependence may pass for a lag.
    """
    found = _fit(setup, best, coarse, order, tried)
    if found is None:
        found = _fit(replace(setup, by_turns=True), best, coarse, order, tried)
    assert found is not None  # with the freedom there is none to ask for
    return found


def _fit(
    setup: FitSetup,
    best: TriedStructure,
    coarse: Floats,
    order: int | None,
    tried: Sequence[TriedStructure],
) -> Fitted | None:
    """None where the bounds cost, and the freedom after a turn would loosen them."""
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
        return fit_shape(lambda: lots, shape, begin, bounds, prior, strength, loose, (12, close))

    begins = (scored.params, start)  # the first was fitted to linear equations about the second
    begin = min(begins, key=lambda p: measure_misfit(equations, shape, p))
    loose = run(equations, begin, narrow)
    tight = run(equations, loose.params, 0.0, 1e-3)
    least, bounded = loose.normal.misfit, tight.normal.misfit
    freed = float(np.count_nonzero(r <= narrow) * (1 + shape.rate))  # of these chance takes some
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
        # it moves the model far: what it costs is computed from where it would end
        begin = run(equations + pull, begin, 0.0, 1e-3).params
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
        r, tight, orders = _reduce(setup, trial, tight, r, shape, order, prior, strength)
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
    """A structure with one power of z more, which the evidence is asked about; None: there is none.

    A sine or two tell a saturation and what the rate does nearly alike, so hold-out does not see
    it. Every curve bends, by a second power about a bias and by a third (Eq. 3) from the
    de-energised state, and it stands unless the evidence is against it: what a bend costs where
    there is none is a fraction of what it costs to leave one out.
    """
    shape = best.shape
    if setup.running is not None or not shape.rate or any(shape.powers):
        return None
    if best.lag is not None and best.lag.place == "sensor":
        return (
            None  # the equations have it before the saturation, where a curve is predicted wrongly
        )
    power = 3 if setup.virgin else 2
    bent = replace(shape, powers=(*shape.powers, power))
    known = any(power in c.shape.powers and c.shape.rate for c in tried)
    return bent if known else None


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
    if setup.by_turns:
        shares = setup.rates(r) / setup.rate_max
        normal = at_one_rate(normal, shares)
        low[: 2 * r.size][np.tile(shares < 1.0, 2)] = -np.inf
    grids = eliminate(normal, normal, low, r.size, shape.rate, order)
    orders = tuple((len(g.kept), float(np.sqrt(g.held / max(1, normal.count)))) for g in grids)
    kept = list(grids[-1].kept)
    like = make_start(order, shape, setup.slope, len(setup.rows))
    params = Params.unpacked(grids[-1].p, like)
    if setup.by_turns:
        slopes = change_rates(params.slopes, setup.rates(r[kept]) / setup.rate_max)
        params = params._replace(slopes=slopes)
    return r[kept], replace(found, params=params), orders
