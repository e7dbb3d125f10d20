"""Choose the structure that the data support: static or rate-dependent, saturation, prior strength.

All candidates are scored from the same normal equations, linearised once per stretch
(dehyst.models.identify.data.folds): each is fitted without a stretch and predicts it. A richer
structure is chosen only if its gain over the stretches, paired, is more than chance.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dehyst.models.identify.bounded import bounded_solve
from dehyst.models.identify.equations import (
    Equations,
    Ints,
    Normal,
    Params,
    Shape,
    assemble,
    sort_by_piece,
)
from dehyst.models.identify.fit import fit_shape, make_bounds, make_start
from dehyst.models.identify.setup import FitSetup
from dehyst.models.identify.thresholds import Prior
from dehyst.models.identify.tuning import TUNING
from dehyst.models.physics.dynamics import LEAD, Dynamics
from dehyst.models.recording import Bools, Floats

ODD = ((0,), (0, 3), (0, 3, 5), (0, 3, 5, 7))
FULL = ((0, 2), (0, 2, 3), (0, 2, 3, 4), (0, 2, 3, 4, 5))
"""Powers of z that a saturation may have in addition to the first: a constant, and odd or all."""


def list_shapes(rate: bool | None, saturation: int | None, bias: bool | None) -> list[Shape]:
    """Return the structures to try, simple ones first, within what the user fixed."""
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


@dataclass(frozen=True)
class TriedStructure:
    """One candidate structure and its scores.

    held: (pieces,) sum of squares of each stretch when predicted without it; sizes: (pieces,) rows
    of each; fitted: (pieces,) sum of squares of each stretch in the fit to all; strength: of the
    prior; params: fitted to all stretches; lag: linear dynamics; loose: narrow operators were not
    bounded; superseded: the fit shows a shift in time that this candidate lacks.
    """

    shape: Shape
    offset: float
    held: Floats
    fitted: Floats
    sizes: Floats
    invertible: bool
    params: Params
    strength: float
    lag: Dynamics | None = None
    loose: bool = True
    superseded: bool = False

    @property
    def has_lag(self) -> bool:
        """Whether it has a lag or a delay. A lead of a part of a sample belongs to the recorder."""
        return self.lag is not None and self.lag.kind != LEAD

    @property
    def held_rms(self) -> float:
        """Held-out rms error over all stretches."""
        return float(np.sqrt(self.held.sum() / max(1.0, self.sizes.sum())))

    @property
    def fitted_rms(self) -> float:
        """Rms error over all stretches in the fit to all."""
        return float(np.sqrt(self.fitted.sum() / max(1.0, self.sizes.sum())))

    @property
    def size(self) -> int:
        """Complexity beyond the simplest structure."""
        shape = self.shape
        base = len(shape.powers) + shape.even + 3 * shape.rate + shape.free_offset
        return base + 2 * (self.lag is not None)


def pays(simple: TriedStructure, rich: TriedStructure, clear: float = TUNING.most) -> bool:
    """Return whether the richer candidate predicts better, by more than chance over the stretches.
    clear: fraction of the misfit below which no test against chance is made."""
    if rich.held.sum() > simple.held.sum() * (1.0 - TUNING.crumb):
        return False
    if rich.held.sum() < simple.held.sum() * clear:
        return True
    return predicts_better(rich, simple)


def predicts_better(one: TriedStructure, other: TriedStructure) -> bool:
    """Return whether `one` predicts better than `other`, by more than chance over the stretches."""
    used = (other.sizes > 0) & (other.held > 0.0) & (one.held > 0.0)
    if not used.any():
        return bool(one.held.sum() < other.held.sum())
    share = np.log(other.held[used] / one.held[used])
    power = (other.held - one.held)[used]
    return _is_sure(share) or (_is_sure(power) and float(np.median(share)) > 0.0)


def shows(simple: TriedStructure, rich: TriedStructure, least: float = TUNING.trace) -> bool:
    """Return whether the richer candidate, with few more unknowns, fits better by more than chance
    over the pieces. least: fraction of the misfit that it must remove."""
    gain = simple.fitted - rich.fitted
    return bool(gain.sum() > least * simple.fitted.sum()) and _is_sure(gain)


def _is_sure(gain: Floats) -> bool:
    """Return whether the mean of these gains is above zero by more than chance."""
    if gain.size < 2:
        return bool(gain.sum() > 0.0)
    error = float(np.std(gain, ddof=1)) / np.sqrt(gain.size)
    return float(np.mean(gain)) > TUNING.sure * error


def _extends(simple: TriedStructure, rich: TriedStructure) -> bool:
    """Return whether the richer candidate has all powers of the other and its further ones show."""
    nested = set(simple.shape.powers) <= set(rich.shape.powers)
    return nested and shows(simple, rich, TUNING.trace)


def choose_structure(tried: Sequence[TriedStructure]) -> TriedStructure:
    """Return the simplest invertible candidate that no richer one beats in prediction.

    First among candidates of one kind (rate, offset, lag), which differ in a few powers of z: there
    a gain in the fit counts as well, unless held-out stretches contradict it. Then among the kinds.
    """
    known = [c for c in tried if c.invertible and not c.superseded] or list(tried[:1])
    kinds: dict[tuple[bool, float, Dynamics | None, bool], list[TriedStructure]] = {}
    for c in known:
        kinds.setdefault((c.shape.rate, c.offset, c.lag, c.loose), []).append(c)
    firsts = [_climb(sorted(group, key=lambda c: c.size)) for group in kinds.values()]
    best = min(firsts, key=lambda c: c.held_rms)
    good = [c for c in firsts if c is best or not pays(c, best)]
    return min(good, key=lambda c: (c.size, c.held_rms))


def _climb(group: Sequence[TriedStructure]) -> TriedStructure:
    """Move from the simplest candidate to a richer one while one pays, or shows with more
    powers."""
    now = group[0]
    while True:
        richer = [
            c
            for c in group
            if c.size > now.size
            and (pays(now, c) or (_extends(now, c) and c.held.sum() < now.held.sum()))
        ]
        if not richer:
            return now
        now = min(richer, key=lambda c: (c.size, c.held_rms))


class Trial:
    """The equations of one offset and one linear dynamics, by stretch."""

    def __init__(
        self,
        setup: FitSetup,
        picks: Sequence[Bools],
        r: Floats,
        offset: float,
        lag: Dynamics | None = None,
        loose: bool | None = None,
        split: bool = True,
        rate: bool = True,
    ) -> None:
        """split: sort the equations into stretches, of which some can be held out; rate: whether a
        structure that depends on the rate is to be fitted."""
        self.setup, self.r, self.offset, self.lag, self.rate = setup, r, offset, lag, rate
        # leave narrow operators unbounded at first, as their slopes may be negative
        self.loose = (lag is None or lag.short) if loose is None else loose
        self.prior = Prior(r, setup.slope, 0.5 * setup.span)
        equations = self.gather(picks)
        self.folds = setup.folds if split else 1
        self.lots = sort_by_piece(equations, self.folds * TUNING.pieces) if split else equations
        self.normals: list[Normal] = []
        self.folded: list[Normal] = []
        self.shape = Shape(True, ())
        self.like = make_start(0, self.shape, 1.0, 1)

    def gather(self, picks: Sequence[Bools]) -> list[Equations]:
        """Return the equations of the picked rows."""
        return self.setup.equations(picks, self.r, self.offset, self.lag, self.rate)

    def linearise(self, params: Params, shape: Shape, powers: tuple[int, ...]) -> None:
        """Make the normal equations of each stretch about these parameters, for all `powers`."""
        known = dict(zip(shape.powers, params.c, strict=True))
        self.shape = replace(shape, powers=powers)
        self.like = params._replace(c=np.array([known.get(p, 0.0) for p in powers]))
        self.normals = [assemble([lot], self.shape, self.like) for lot in self.lots]
        self.folded = [_sum(self.normals[fold :: self.folds]) for fold in range(self.folds)]

    def score(self, shape: Shape, strengths: Sequence[float]) -> TriedStructure:
        """Score a structure by its prediction, at the best of these strengths of the prior."""
        loose = self.loose
        at = self._find(shape)
        folded = [_reduce(one, at) for one in self.folded]
        goals = self.normals
        total = _sum(folded)
        like = make_start(self.r.size, shape, 1.0, self.like.shifts.size + 1)
        low, high = self.bound(shape)
        p, free = bounded_solve(total.gram, total.right, low, high)
        noise = total.noise_at(p)
        best: tuple[float, Floats, Floats, float] | None = None
        whole_p = np.zeros(self.like.packed().size)
        for strength in strengths:
            whole = self.prior.add_to(total, shape.rate, strength, noise, loose)
            p, free = bounded_solve(whole.gram, whole.right, low, high, free)
            held = np.zeros(len(goals))
            for fold, part in enumerate(folded):
                gram, right = whole.gram - part.gram, whole.right - part.right
                whole_p[at], _ = bounded_solve(gram, right, low, high, free)
                for i in range(fold, len(goals), len(folded)):
                    held[i] = goals[i].misfit_at(whole_p)
            if best is None or held.sum() < best[0]:
                best = (float(held.sum()), held, p, strength)
        assert best is not None
        params = Params.unpacked(best[2], like)
        good = self.setup.margin(self.r, shape, params, self.offset) >= TUNING.small
        sizes = np.array([float(goal.count) for goal in goals])
        whole_p[at] = best[2]
        fitted = np.array([goal.misfit_at(whole_p) for goal in goals])
        return TriedStructure(
            shape,
            self.offset,
            best[1],
            fitted,
            sizes,
            good,
            params,
            best[3],
            self.lag,
            self.loose,
        )

    def bound(self, shape: Shape) -> tuple[Floats, Floats]:
        """Return the bounds of a structure's unknowns."""
        like = make_start(self.r.size, shape, 1.0, self.like.shifts.size + 1)
        narrow = TUNING.crumb * self.setup.span if self.loose else 0.0
        return make_bounds(like, self.setup.limits, self.r, narrow)

    def refine(self, found: TriedStructure) -> Params:
        """Return the candidate's parameters after a few more steps, linearised about themselves."""
        bounds = make_bounds(
            found.params, self.setup.limits, self.r, TUNING.crumb * self.setup.span * self.loose
        )
        return fit_shape(
            self.lots,
            found.shape,
            found.params,
            bounds,
            self.prior,
            found.strength,
            self.loose,
            (3, 1e-3),  # steps, relative decrease: near its minimum already
        ).params

    def misfit(self, shape: Shape, strength: float, noise: float, loose: bool) -> float:
        """Return the misfit of a structure fitted to all stretches, as linearised. noise: noise
        power."""
        total = self.total(shape)
        like = make_start(self.r.size, shape, 1.0, self.like.shifts.size + 1)
        narrow = TUNING.crumb * self.setup.span if loose else 0.0
        low, high = make_bounds(like, self.setup.limits, self.r, narrow)
        whole = self.prior.add_to(total, shape.rate, strength, noise, loose)
        p, _ = bounded_solve(whole.gram, whole.right, low, high)
        return total.misfit_at(p)

    def total(self, shape: Shape) -> Normal:
        """Return the normal equations of all stretches for a structure's unknowns."""
        return _reduce(_sum(self.folded), self._find(shape))

    def _find(self, shape: Shape) -> Ints:
        """Return the positions (some,) of a structure's unknowns among those of the whole."""
        slopes, powers = self.like.slopes.size, self.shape.powers
        known = [slopes + powers.index(p) for p in shape.powers]
        rest = np.arange(slopes + len(powers), self.like.packed().size)
        return np.concatenate([np.arange(slopes), np.array(known, dtype=np.int64), rest])


def _reduce(eq: Normal, at: Ints) -> Normal:
    return Normal(eq.gram[np.ix_(at, at)], eq.right[at], eq.total, eq.count, eq.misfit)


def _sum(parts: Sequence[Normal]) -> Normal:
    return Normal(
        np.sum([p.gram for p in parts], axis=0),
        np.sum([p.right for p in parts], axis=0),
        sum(p.total for p in parts),
        sum(p.count for p in parts),
        sum(p.misfit for p in parts),
    )
