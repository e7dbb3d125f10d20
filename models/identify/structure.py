"""Which structure the data supports: static or rate-dependent, which saturation, which thresholds.

Everything is decided on rows that the fit did not see: each recording is cut into parts in time
and two parts in five are held out. Among structures within a small tolerance of the best, the
simplest wins.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from dehyst.models.identify.comparison_drive import make_comparison_drive
from dehyst.models.identify.equations import Equations, Params, Shape, assemble
from dehyst.models.identify.fit import Prior, Solution, make_bounds, make_start, solve
from dehyst.models.identify.outliers import thin
from dehyst.models.identify.rows import Rows, sum_travel
from dehyst.models.identify.setup import FitSetup
from dehyst.models.identify.thresholds import Grid, choose, eliminate, space_thresholds
from dehyst.models.identify.tuning import TUNING
from dehyst.models.recording import Bools, Floats

ODD = ((0,), (0, 3), (0, 3, 5), (0, 3, 5, 7))
FULL = ((0, 2), (0, 2, 3), (0, 2, 3, 4), (0, 2, 3, 4, 5))


@dataclass(frozen=True)
class Candidate:
    """One structure tried: what it left on the held-out rows, and whether it can be inverted."""

    shape: Shape
    offset: float
    held_rms: float
    invertible: bool
    solution: Solution


def split(setup: FitSetup, limit: int = TUNING.rows_compared) -> tuple[list[Bools], list[Bools]]:
    """Rows to fit and rows to hold out, at most `limit` rows altogether, of each recording."""
    train, held = [], []
    some = thin(setup.picks, limit)
    for one, every, pick in zip(setup.rows, setup.picks, some, strict=True):
        at = np.flatnonzero(pick)
        cycles = sum_travel(one.u, every) / (2.0 * setup.span)
        parts = TUNING.parts * (TUNING.short_parts if cycles < TUNING.few_cycles else 1)
        part = np.arange(at.size) * parts // max(1, at.size) % TUNING.parts
        out = np.isin(part, TUNING.held)
        masks = np.zeros((2, pick.size), dtype=bool)
        masks[0, at[~out]] = True
        masks[1, at[out]] = True
        train.append(masks[0])
        held.append(masks[1])
    return train, held


def list_shapes(rate: bool | None, saturation: int | None, bias: bool | None) -> list[Shape]:
    """The structures to try, simple ones first, within what the user fixed."""
    powers: list[tuple[int, ...]] = []
    if bias is not True:
        powers += list(ODD)
    if bias is not False:
        powers += list(FULL)
    if saturation is not None:
        full = tuple(p for p in range(saturation + 1) if p != 1)
        odd = tuple(p for p in full if p == 0 or p % 2)
        powers = [p for p in (odd, full) if max((1, *p)) == saturation]
        powers = [p for p in powers if bias is None or bias == any(q and q % 2 == 0 for q in p)]
        powers = list(dict.fromkeys(powers)) or [full]
    powers.sort(key=len)
    rates = [False, True] if rate is None else [rate]
    return [Shape(r, p) for r in rates for p in powers]


def make_first_grid(setup: FitSetup) -> Floats:
    """(n,) thresholds on which structures are compared."""
    return space_thresholds(TUNING.first_grid, setup.span)


def try_shapes(
    setup: FitSetup, wanted: list[Shape], progress: Callable[[str], None]
) -> list[Candidate]:
    """Fit every structure on a first grid of thresholds and score it on the held-out rows."""
    r = make_first_grid(setup)
    train, held = split(setup)
    out = []
    for number, offset in enumerate(setup.offsets):
        train_equations = setup.equations(train, r, offset)
        held_equations = setup.equations(held, r, offset)
        ladder: list[Candidate] = []
        for shape in wanted:
            same = offset != setup.running and not shape.rate and 2 in shape.powers
            if number and same:
                continue  # a full polynomial takes up a static model's offset
            progress(f"trying: {shape.name}")
            start = _start_from_below(ladder, shape)
            if start is None:
                start = make_start(r.size, shape, setup.slope, len(setup.rows), shape.rate)
            low = make_bounds(start, setup.least, r, TUNING.narrow * setup.span)
            prior = make_prior(setup, r)
            found = solve(
                partial(list, train_equations), shape, start, low, prior, tolerance=TUNING.roughly
            )
            score = assemble(held_equations, shape, found.params)
            good = setup.margin(r, shape, found.params, offset) >= TUNING.least_saturation
            rms = float(np.sqrt(score.misfit / max(1, score.count)))
            ladder.append(Candidate(shape, offset, rms, good, found))
        out += ladder
    return out


def _start_from_below(ladder: list[Candidate], shape: Shape) -> Params | None:
    """The best fit so far of a structure that this one contains, as a start."""
    below = [
        c for c in ladder if c.shape.rate == shape.rate and set(c.shape.powers) < set(shape.powers)
    ]
    if not below:
        return None
    best = min(below, key=lambda c: c.solution.normal.misfit)
    known = dict(zip(best.shape.powers, best.solution.params.c, strict=True))
    c = np.array([known.get(p, 0.0) for p in shape.powers])
    return best.solution.params._replace(c=c)


def regrid(params: Params, coarse: Floats, fine: Floats, shape: Shape) -> Params:
    """The same slopes on other thresholds: each takes those of the next wider-set one below."""
    at = np.searchsorted(coarse, fine, side="right") - 1
    parts = np.split(params.slopes, 2) if shape.rate else [params.slopes]
    return params._replace(slopes=np.concatenate([part[at] for part in parts]))


def pick_shape(tried: list[Candidate]) -> Candidate:
    """The simplest candidate that can be inverted and is within the tolerance of the best."""
    fit = [c for c in tried if c.invertible] or tried[:1]
    best = min(c.held_rms for c in fit) ** 2
    near = [c for c in fit if c.held_rms**2 <= best * (1.0 + TUNING.tolerance)]
    return min(near, key=lambda c: (c.shape.rate, len(c.shape.powers), c.shape.even, c.held_rms))


@dataclass(frozen=True)
class Choice:
    """Shape, thresholds (n,), parameters fitted on the training rows, their held-out rms, the
    held-out rms of every order; pull: the comparison drive with the displacements that the fit
    without bounds gives for it, where the bounds cost something (costly) or little is shown;
    finest: that fit's thresholds and parameters."""

    shape: Shape
    r: Floats
    params: Params
    held_rms: float
    orders: tuple[tuple[int, float], ...]
    pull: Rows | None
    finest: tuple[Floats, Shape, Params]
    costly: bool


def make_prior(setup: FitSetup, r: Floats) -> Prior:
    """What is taken for granted about the slopes at thresholds r."""
    return Prior(
        r,
        TUNING.narrow * setup.span,
        0.5 * setup.span,
        TUNING.spread * setup.slope,
        1.0 / TUNING.finest_grid,
    )


def fit_finest(
    setup: FitSetup, picks: Sequence[Bools], r: Floats, shape: Shape, offset: float, start: Params
) -> Solution:
    """Fit on the finest grid with no bounds on the narrow operators."""
    equations = setup.equations(picks, r, offset)
    low = make_bounds(start, setup.least, r, TUNING.narrow * setup.span)
    return solve(
        lambda: equations, shape, start, low, make_prior(setup, r), tolerance=TUNING.roughly
    )


def make_pull(setup: FitSetup, r: Floats, shape: Shape, offset: float, params: Params) -> Rows:
    """The comparison drive with the displacements that these parameters give for it."""
    rate_max = setup.rate_max if shape.rate else 0.0
    rows = make_comparison_drive(setup.drive_min, setup.drive_max, rate_max)
    alone = replace(setup, rows=[rows], picks=[rows.use])
    y = -alone.residuals(r, shape, params, offset)[0]
    return replace(rows, y=y)


def make_pull_equations(
    setup: FitSetup, pull: Rows | None, r: Floats, offset: float, count: int
) -> list[Equations]:
    """Equations of the pull, which together count as pull_weight times `count` equations."""
    if pull is None:
        return []
    alone = replace(setup, rows=[pull], picks=[pull.use])
    weight = TUNING.pull_weight * count / pull.u.size
    return [lot._replace(weight=weight) for lot in alone.equations(alone.picks, r, offset)]


def _choose_bent(
    setup: FitSetup,
    wanted: Sequence[Shape],
    start: Params,
    r: Floats,
    offset: float,
    train: list[Equations],
    held: list[Equations],
) -> tuple[Shape, Solution]:
    """The saturation chosen anew under the bounds, on given thresholds r: further powers of z take
    up a part of what the bounds forbid, though the fit without bounds has no use for them.

    wanted: structures, that fit's first; of the others those with at most one degree more, as high
    degrees err much beyond the range.
    """
    first, prior = wanted[0], make_prior(setup, r)
    ladder: list[Candidate] = []
    for shape in wanted:
        more = set(first.powers) < set(shape.powers) and shape.rate == first.rate
        if ladder and not (more and max(shape.powers) <= max(first.powers) + 1):
            continue
        begin = _start_from_below(ladder, shape) or start
        low = make_bounds(begin, setup.least)
        found = solve(lambda: train, shape, begin, low, prior, tolerance=TUNING.roughly)
        score = assemble(held, shape, found.params)
        good = setup.margin(r, shape, found.params, offset) >= TUNING.least_saturation
        rms = float(np.sqrt(score.misfit / max(1, score.count)))
        ladder.append(Candidate(shape, offset, rms, good, found))
    best = pick_shape(ladder)
    return best.shape, best.solution


def choose_thresholds(
    setup: FitSetup, candidate: Candidate, order: int | None, wanted: Sequence[Shape] = ()
) -> Choice:
    """The thresholds that the data support for a structure, or the best `order` of them.

    wanted: structures that may take its place where the bounds cost something.
    """
    shape, offset = candidate.shape, candidate.offset
    finest = max(TUNING.finest_grid, order or 0)
    r = space_thresholds(finest, setup.span)
    prior = make_prior(setup, r)
    train, held = split(setup)
    train_equations, held_equations = (setup.equations(p, r, offset) for p in (train, held))
    start = regrid(candidate.solution.params, make_first_grid(setup), r, shape)
    loose = fit_finest(setup, train, r, shape, offset, start)
    low = make_bounds(start, setup.least)
    tight = solve(lambda: train_equations, shape, start, low, prior, tolerance=TUNING.roughly)
    pull = None
    worse = tight.normal.misfit > loose.normal.misfit * (1.0 + TUNING.tolerance)
    if setup.least is not None and worse:
        wish = make_pull(setup, r, shape, offset, loose.params)
        pulled = train_equations + make_pull_equations(setup, wish, r, offset, tight.normal.count)
        other = solve(lambda: pulled, shape, tight.params, low, prior, tolerance=TUNING.roughly)
        price = assemble(held_equations, shape, other.params).misfit
        if price <= assemble(held_equations, shape, tight.params).misfit * TUNING.pull_price**2:
            pull, tight = wish, other
    costly = pull is not None
    if pull is None and setup.running is not None:
        # so little is shown that held-out rows do not miss an operator: the comparison drive does
        pull = make_pull(setup, r, shape, offset, tight.params)
    pull_equations = make_pull_equations(
        setup, pull, r, offset, sum(lot.y.size for lot in held_equations)
    )
    held_eq = assemble(held_equations + pull_equations, shape, tight.params)
    grids = eliminate(prior.add_to(tight.normal, shape), held_eq, low, finest, shape.rate)
    orders = tuple((len(g.kept), float(np.sqrt(g.held / max(1, held_eq.count)))) for g in grids)
    best: Grid = choose(grids, order, TUNING.tolerance)
    few = r[list(best.kept)]
    like = make_start(few.size, shape, setup.slope, len(setup.rows), shape.rate)
    start = Params.unpacked(best.p, like)
    train_equations, held_equations = (setup.equations(p, few, offset) for p in (train, held))
    counts = [sum(lot.y.size for lot in lots) for lots in (train_equations, held_equations)]
    fitted, scored = (
        lots + make_pull_equations(setup, pull, few, offset, count)
        for lots, count in zip((train_equations, held_equations), counts, strict=True)
    )
    others = wanted if costly else ()
    shape, found = _choose_bent(setup, [shape, *others], start, few, offset, fitted, scored)
    score = assemble(held_equations, shape, found.params)
    held_rms = float(np.sqrt(score.misfit / max(1, score.count)))
    finest_fit = (r, candidate.shape, loose.params)
    return Choice(shape, few, found.params, held_rms, orders, pull, finest_fit, costly)
