"""Which structure the data supports: static or rate-dependent, which saturation, which thresholds.

Everything is decided on rows that the fit did not see: each recording is cut into parts in time
and two parts in five are held out. Among structures within a small tolerance of the best, the
simplest wins.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from dehyst.models.equations import Block, Params, Shape, normal
from dehyst.models.generic import generic_drive
from dehyst.models.glitches import thinned
from dehyst.models.problem import Problem
from dehyst.models.recording import Bools, Floats
from dehyst.models.rows import Rows, travel
from dehyst.models.solver import Prior, Solution, lower_bounds, solve, start_params
from dehyst.models.thresholds import Grid, choose, cubic_thresholds, eliminate

TOLERANCE = 0.005  # of the held-out power: less is not worth a larger model
FIRST_GRID = 32
FINEST_GRID = 48
LEAST_SATURATION = 0.05  # of the mean slope of the saturation
NARROW = 0.02  # of the drive span: narrower operators may at first run the wrong way
SPREAD = 0.1  # of the mean slope: how much neighbouring slopes of wide operators differ
ROUGHLY = 1e-4  # relative fall of the misfit at which a comparison is good enough
ROWS = 12_000
PARTS, HELD = 5, (1, 4)  # five parts in time, the second and the last held out
FEW_CYCLES, SHORT_PARTS = 6.0, 5  # with fewer cycles, five times as many parts, alike
PULL_WEIGHT = 0.8  # of the generic drive, against all rows
PULL_PRICE = 1.06  # held-out rms that the pull may cost, against the plain bounded fit
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


def split(problem: Problem, limit: int = ROWS) -> tuple[list[Bools], list[Bools]]:
    """Rows to fit and rows to hold out, at most `limit` rows altogether, of each recording."""
    train, held = [], []
    some = thinned(problem.picks, limit)
    for one, every, pick in zip(problem.rows, problem.picks, some, strict=True):
        at = np.flatnonzero(pick)
        cycles = travel(one.u, every) / (2.0 * problem.span)
        parts = PARTS * (SHORT_PARTS if cycles < FEW_CYCLES else 1)
        part = np.arange(at.size) * parts // max(1, at.size) % PARTS
        out = np.isin(part, HELD)
        masks = np.zeros((2, pick.size), dtype=bool)
        masks[0, at[~out]] = True
        masks[1, at[out]] = True
        train.append(masks[0])
        held.append(masks[1])
    return train, held


def shapes(rate: bool | None, saturation: int | None, bias: bool | None) -> list[Shape]:
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


def first_grid(problem: Problem) -> Floats:
    """(n,) thresholds on which structures are compared."""
    return cubic_thresholds(FIRST_GRID, problem.span)


def try_shapes(
    problem: Problem, wanted: list[Shape], progress: Callable[[str], None]
) -> list[Candidate]:
    """Fit every structure on a first grid of thresholds and score it on the held-out rows."""
    r = first_grid(problem)
    train, held = split(problem)
    out = []
    for number, offset in enumerate(problem.offsets):
        train_blocks = problem.blocks(train, r, offset)
        held_blocks = problem.blocks(held, r, offset)
        ladder: list[Candidate] = []
        for shape in wanted:
            same = offset != problem.running and not shape.rate and 2 in shape.powers
            if number and same:
                continue  # a full polynomial takes up a static model's offset
            progress(f"trying: {shape.name}")
            start = _from_below(ladder, shape)
            if start is None:
                start = start_params(r.size, shape, problem.slope, len(problem.rows), shape.rate)
            low = lower_bounds(start, problem.least, r, NARROW * problem.span)
            prior = prior_for(problem, r)
            found = solve(partial(list, train_blocks), shape, start, low, prior, tolerance=ROUGHLY)
            score = normal(held_blocks, shape, found.params)
            good = problem.margin(r, shape, found.params, offset) >= LEAST_SATURATION
            rms = float(np.sqrt(score.misfit / max(1, score.count)))
            ladder.append(Candidate(shape, offset, rms, good, found))
        out += ladder
    return out


def _from_below(ladder: list[Candidate], shape: Shape) -> Params | None:
    """The best fit so far of a structure that this one contains, as a start."""
    below = [
        c for c in ladder if c.shape.rate == shape.rate and set(c.shape.powers) < set(shape.powers)
    ]
    if not below:
        return None
    best = min(below, key=lambda c: c.solution.normal.misfit)
    known = dict(zip(best.shape.powers, best.solution.params.c, strict=True))
    c = np.array([known.get(p, 0.0) for p in shape.powers])
    return replace(best.solution.params, c=c)


def regrid(params: Params, coarse: Floats, fine: Floats, shape: Shape) -> Params:
    """The same slopes on other thresholds: each takes those of the next wider-set one below."""
    at = np.searchsorted(coarse, fine, side="right") - 1
    parts = np.split(params.slopes, 2) if shape.rate else [params.slopes]
    return replace(params, slopes=np.concatenate([part[at] for part in parts]))


def pick_shape(tried: list[Candidate]) -> Candidate:
    """The simplest candidate that can be inverted and is within the tolerance of the best."""
    fit = [c for c in tried if c.invertible] or tried[:1]
    best = min(c.held_rms for c in fit) ** 2
    near = [c for c in fit if c.held_rms**2 <= best * (1.0 + TOLERANCE)]
    return min(near, key=lambda c: (c.shape.rate, len(c.shape.powers), c.shape.even, c.held_rms))


@dataclass(frozen=True)
class Choice:
    """Shape, thresholds (n,), parameters fitted on the training rows, their held-out rms, the
    held-out rms of every order; pull: the generic drive with the displacements that the fit without
    bounds gives for it, where the bounds cost something (costly) or little is shown; finest: that
    fit's thresholds and parameters."""

    shape: Shape
    r: Floats
    params: Params
    held_rms: float
    orders: tuple[tuple[int, float], ...]
    pull: Rows | None
    finest: tuple[Floats, Shape, Params]
    costly: bool


def prior_for(problem: Problem, r: Floats) -> Prior:
    """What is taken for granted about the slopes at thresholds r."""
    return Prior(
        r, NARROW * problem.span, 0.5 * problem.span, SPREAD * problem.slope, 1.0 / FINEST_GRID
    )


def fit_finest(
    problem: Problem, picks: Sequence[Bools], r: Floats, shape: Shape, offset: float, start: Params
) -> Solution:
    """Fit on the finest grid with no bounds on the narrow operators."""
    blocks = problem.blocks(picks, r, offset)
    low = lower_bounds(start, problem.least, r, NARROW * problem.span)
    return solve(lambda: blocks, shape, start, low, prior_for(problem, r), tolerance=ROUGHLY)


def make_pull(problem: Problem, r: Floats, shape: Shape, offset: float, params: Params) -> Rows:
    """The generic drive with the displacements that these parameters give for it."""
    rate_max = problem.rate_max if shape.rate else 0.0
    rows = generic_drive(problem.drive_min, problem.drive_max, rate_max)
    alone = replace(problem, rows=[rows], picks=[rows.use])
    y = -alone.residuals(r, shape, params, offset)[0]
    return replace(rows, y=y)


def pull_blocks(
    problem: Problem, pull: Rows | None, r: Floats, offset: float, count: int
) -> list[Block]:
    """Blocks of the pull, which together count as PULL_WEIGHT times `count` equations."""
    if pull is None:
        return []
    alone = replace(problem, rows=[pull], picks=[pull.use])
    weight = PULL_WEIGHT * count / pull.u.size
    return [replace(block, weight=weight) for block in alone.blocks(alone.picks, r, offset)]


def _bent(
    problem: Problem,
    wanted: Sequence[Shape],
    start: Params,
    r: Floats,
    offset: float,
    train: list[Block],
    held: list[Block],
) -> tuple[Shape, Solution]:
    """The saturation chosen anew under the bounds, on given thresholds r: further powers of z take
    up a part of what the bounds forbid, though the fit without bounds has no use for them.

    wanted: structures, that fit's first; of the others those with at most one degree more, as high
    degrees err much beyond the range.
    """
    first, prior = wanted[0], prior_for(problem, r)
    ladder: list[Candidate] = []
    for shape in wanted:
        more = set(first.powers) < set(shape.powers) and shape.rate == first.rate
        if ladder and not (more and max(shape.powers) <= max(first.powers) + 1):
            continue
        begin = _from_below(ladder, shape) or start
        low = lower_bounds(begin, problem.least)
        found = solve(lambda: train, shape, begin, low, prior, tolerance=ROUGHLY)
        score = normal(held, shape, found.params)
        good = problem.margin(r, shape, found.params, offset) >= LEAST_SATURATION
        rms = float(np.sqrt(score.misfit / max(1, score.count)))
        ladder.append(Candidate(shape, offset, rms, good, found))
    best = pick_shape(ladder)
    return best.shape, best.solution


def choose_thresholds(
    problem: Problem, candidate: Candidate, order: int | None, wanted: Sequence[Shape] = ()
) -> Choice:
    """The thresholds that the data support for a structure, or the best `order` of them.

    wanted: structures that may take its place where the bounds cost something.
    """
    shape, offset = candidate.shape, candidate.offset
    finest = max(FINEST_GRID, order or 0)
    r = cubic_thresholds(finest, problem.span)
    prior = prior_for(problem, r)
    train, held = split(problem)
    train_blocks, held_blocks = (problem.blocks(p, r, offset) for p in (train, held))
    start = regrid(candidate.solution.params, first_grid(problem), r, shape)
    loose = fit_finest(problem, train, r, shape, offset, start)
    low = lower_bounds(start, problem.least)
    tight = solve(lambda: train_blocks, shape, start, low, prior, tolerance=ROUGHLY)
    pull = None
    if problem.least is not None and tight.normal.misfit > loose.normal.misfit * (1.0 + TOLERANCE):
        wish = make_pull(problem, r, shape, offset, loose.params)
        pulled = train_blocks + pull_blocks(problem, wish, r, offset, tight.normal.count)
        other = solve(lambda: pulled, shape, tight.params, low, prior, tolerance=ROUGHLY)
        price = normal(held_blocks, shape, other.params).misfit
        if price <= normal(held_blocks, shape, tight.params).misfit * PULL_PRICE**2:
            pull, tight = wish, other
    costly = pull is not None
    if pull is None and problem.running is not None:
        # so little is shown that held-out rows do not miss an operator: the generic drive does
        pull = make_pull(problem, r, shape, offset, tight.params)
    held_blocks_pull = pull_blocks(problem, pull, r, offset, sum(b.y.size for b in held_blocks))
    held_eq = normal(held_blocks + held_blocks_pull, shape, tight.params)
    grids = eliminate(prior.add_to(tight.normal, shape), held_eq, low, finest, shape.rate)
    orders = tuple((len(g.kept), float(np.sqrt(g.held / max(1, held_eq.count)))) for g in grids)
    best: Grid = choose(grids, order, TOLERANCE)
    few = r[list(best.kept)]
    like = start_params(few.size, shape, problem.slope, len(problem.rows), shape.rate)
    start = Params.unpacked(best.p, like)
    train_blocks, held_blocks = (problem.blocks(p, few, offset) for p in (train, held))
    counts = [sum(b.y.size for b in blocks) for blocks in (train_blocks, held_blocks)]
    fitted, scored = (
        blocks + pull_blocks(problem, pull, few, offset, count)
        for blocks, count in zip((train_blocks, held_blocks), counts, strict=True)
    )
    others = wanted if costly else ()
    shape, found = _bent(problem, [shape, *others], start, few, offset, fitted, scored)
    score = normal(held_blocks, shape, found.params)
    held_rms = float(np.sqrt(score.misfit / max(1, score.count)))
    finest_fit = (r, candidate.shape, loose.params)
    return Choice(shape, few, found.params, held_rms, orders, pull, finest_fit, costly)
