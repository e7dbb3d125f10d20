"""Which candidates are accepted: screen, joint refit, price, tiers, repeat, prune, back-track.

Gains are sums of squares over the counted rows [displacement unit squared], always after
everything else was refitted.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from dehyst.models.diagnosis.candidates import library
from dehyst.models.diagnosis.candidates.interface import Candidate
from dehyst.models.diagnosis.data import turns
from dehyst.models.diagnosis.evidence import Constancy, constancy, contribution
from dehyst.models.diagnosis.fit import Effect, Fitted, Problem, on_bound
from dehyst.models.diagnosis.screen import Screen

MAX_EFFECTS = 5
SHORTLIST = 5  # candidates that get the full nonlinear refit in each round
DRIVEN_SHARE = 0.12  # of the excess, that a cause driven by the drive must take
DRIVEN_SIZE = 0.17  # of the noise rms, that it must remove
STATIC_SIZE = 0.3  # the same for causes that resemble a hysteresis of another shape
SURE_SIZE = 0.18  # and for those of them that take SURE_SHARE of the excess, the same everywhere
SURE_SHARE = 0.45
SURE_SPREAD = 0.2
FREE_SIZE = 0.12  # the same for causes beside the drive
WEAK = 0.1  # screened gain, as a part of the best, below which a candidate is not refitted
PART_SHARE = 0.02  # of the excess, that one more part (a mode) of a chosen effect must take
FEW_TURNS = 3  # with fewer turns of the drive nothing that it causes can be told from the loop
RIVAL = 0.7  # part of the first pick's gain, from which another first pick is tried too
FINEST = 1e-4  # of the displacement's range: no base is better than this
TIE = 0.12  # noise rms: a simpler cause that leaves no more than this beside the best is taken
BUDGET = 240  # full solutions after which the search stops adding effects
PRICE = 16.0  # of one parameter, in noise variances; includes the number of candidates tried


@dataclass(frozen=True)
class Trial:
    """A candidate's best joint refit in one round."""

    candidate: Candidate
    fit: Fitted
    gain: float  # fall of the sum of squares
    price: float
    constancy: Constancy | None = None
    refused: str = ""

    @property
    def worth(self) -> float:
        """Gain after the price."""
        return self.gain - self.price


@dataclass
class Search:
    """Everything the search has learned; `rounds` keeps the trials for the report."""

    problem: Problem
    sigma: float
    null: Fitted
    accepted: Fitted
    rounds: list[list[Trial]] = field(default_factory=list)
    counted: int = 0  # rows that the gains of the rounds are summed over
    share: float = DRIVEN_SHARE
    picked: list[str] = field(default_factory=list)  # keys in the order of their acceptance


def excess(problem: Problem, fit: Fitted, sigma: float) -> float:
    """Mean square misfit beyond the noise, >= 0 [displacement unit squared]."""
    n = int(problem.data.rows.sum())
    free = n - fit.design.shape[1]
    return max(0.0, fit.sse / max(free, 1) - sigma**2)


Say = Callable[[str, float], None]


def search(
    problem: Problem, sigma: float, null: Fitted, say: Say, share: float = DRIVEN_SHARE
) -> Search:
    """Accept effects one by one until none pays, then prune.

    share: part of the excess that a cause driven by the drive must take; above the usual one the
    base is a compact one, and candidates that resemble a hysteresis of another shape stay out.
    """
    state = _forward(problem, sigma, null, say, share, forbidden=())
    first = state.accepted.effects
    left = excess(problem, state.accepted, sigma)
    if len(first) >= 2 and state.rounds:
        # one back-track: a wrong first pick is often repaired by a crowd of others
        chosen = next(t for t in state.rounds[0] if t.candidate.key in state.picked[:1])
        rivals = [
            t
            for t in state.rounds[0]
            if t is not chosen and not t.refused and t.gain > RIVAL * chosen.gain
        ]
        if rivals and chosen.candidate.driven and problem.solved < 0.5 * BUDGET:
            other = _forward(problem, sigma, null, say, share, forbidden=(chosen.candidate.key,))
            if better(other, state, left):
                state = other
    return state


def least_size(candidate: Candidate) -> float:
    """Smallest rms, in noise rms, that a candidate must remove."""
    if candidate.static or candidate.last:
        return STATIC_SIZE
    return DRIVEN_SIZE if candidate.driven else FREE_SIZE


def least_power(state: Search, candidate: Candidate, size: float | None = None) -> float:
    """Mean square that a candidate must remove: by the noise (size: in noise rms), and for causes
    driven by the drive by the stroke too, whose finest part is the base's own error."""
    least = (least_size(candidate) if size is None else size) * state.sigma
    if candidate.driven:
        least = max(least, FINEST * float(np.ptp(state.problem.data.y)))
    return least**2


def better(other: Search, state: Search, left: float) -> bool:
    """Whether another search explains the same with fewer effects, or clearly more."""
    n = int(state.problem.data.rows.sum())
    other_left = excess(state.problem, other.accepted, state.sigma)
    margin = max(0.1 * left, (0.07 * state.sigma) ** 2)
    if len(other.accepted.effects) < len(state.accepted.effects):
        return other_left < left + margin
    if len(other.accepted.effects) == len(state.accepted.effects):
        return (left - other_left) * n > PRICE * state.sigma**2 and other_left < left - margin
    return False


def _forward(
    problem: Problem, sigma: float, null: Fitted, say: Say, share: float, forbidden: Sequence[str]
) -> Search:
    counted = int(problem.data.rows.sum())
    strict = share > DRIVEN_SHARE
    few = turns(problem.data) < FEW_TURNS
    state = Search(problem, sigma, null, null, counted=counted, share=share)
    everything = [
        c
        for c in library(problem.data)
        if c.key not in forbidden and not (strict and c.static) and not (few and c.driven)
    ]
    for number in range(MAX_EFFECTS):
        current = state.accepted
        if problem.solved > BUDGET:
            break
        left = excess(problem, current, sigma)
        trials = _round(problem, sigma, current, everything, say, number)
        judged = [_judged(state, t, left) for t in trials]
        state.rounds.append(judged)
        chosen = _choice(state, judged)
        if chosen is None:
            break
        state.picked.append(chosen.candidate.key)
        fit = refine(problem, sigma, chosen.fit, chosen.candidate, everything)
        state.accepted = prune(problem, sigma, fit, keep=chosen.candidate.key)
    return state


def _round(
    problem: Problem,
    sigma: float,
    current: Fitted,
    everything: Sequence[Candidate],
    say: Say,
    number: int,
) -> list[Trial]:
    n = int(problem.data.rows.sum())
    # an effect in its finer form stands for the simpler one too
    have = {k for e in current.effects for k in (e.candidate.key, e.candidate.refines)}
    pool = [
        c for c in everything if c.key not in have and not c.refines and _next_of_its_kind(c, have)
    ]
    look = Screen(problem, current)

    def tried(c: Candidate, start: Sequence[float]) -> Trial:
        fit = problem.refit([*current.effects, Effect(c, tuple(start))], start=current)
        count = sum(len(e.theta) for e in fit.effects) - sum(len(e.theta) for e in current.effects)
        columns = fit.design.shape[1] - current.design.shape[1]
        price = PRICE * sigma**2 * max(count + columns, 1)
        return Trial(c, fit, current.sse - fit.sse, price)

    scored = []
    for c, starts in zip(pool, problem.several(look.starts, pool), strict=True):
        if starts and starts[0][0] > n * (0.5 * least_size(c) * sigma) ** 2:
            scored.append((*starts[0], c))
    scored.sort(key=lambda s: -s[0])
    short = [(c, start) for gain, start, c in scored[:SHORTLIST] if gain > WEAK * scored[0][0]]
    trials = []
    for k, trial in enumerate(problem.several(tried, *zip(*short, strict=True)) if short else ()):
        say(f"tried {trial.candidate.key}", min(0.85, 0.1 + 0.15 * (number + k / SHORTLIST)))
        trials.append(trial)
    return sorted(trials, key=lambda t: -t.worth)


def _choice(state: Search, judged: Sequence[Trial]) -> Trial | None:
    """The best trial that is not refused, or a simpler one that does as well."""
    good = [t for t in judged if not t.refused]
    if not good:
        return None
    best = good[0]
    n = int(state.problem.data.rows.sum())
    tie = max(n * (TIE * state.sigma) ** 2, 0.01 * best.gain)
    simpler = [t for t in good if t.price < best.price and best.gain - t.gain < tie]
    return min(simpler, key=lambda t: (t.price, -t.gain)) if simpler else best


def _next_of_its_kind(candidate: Candidate, have: set[str]) -> bool:
    """Repeatable kinds (modes) come in order: the second only behind the first."""
    if "-" not in candidate.key or not candidate.repeatable:
        return True
    stem, number = candidate.key.rsplit("-", 1)
    return (stem if number == "2" else f"{stem}-{int(number) - 1}") in have


def effect_of(fit: Fitted, key: str) -> Effect:
    """The effect of a fit with this candidate's key."""
    return next(e for e in fit.effects if e.candidate.key == key)


def _judged(state: Search, trial: Trial, left: float) -> Trial:
    """The trial with its constancy and, where it fails, the reason."""
    problem, sigma = state.problem, state.sigma
    data = problem.data
    n = int(data.rows.sum())
    effect = effect_of(trial.fit, trial.candidate.key)
    amplitudes = trial.fit.amplitudes[trial.fit.effects.index(effect)]
    mean_square = trial.gain / n
    why = trial.candidate.implausible(effect.theta, amplitudes, data)
    steady = None
    index = trial.candidate.size_index
    size = effect.parameters[index].key if index is not None else ""
    if not why and size != "share" and size in on_bound(effect):  # a share of 1 is the whole stroke
        why = "its size stands on a bound: not identified"
    if trial.worth <= 0:
        why = why or "not worth its parameters"
    elif mean_square < least_power(state, trial.candidate) and not _sure(state, trial, left):
        why = why or "too small against the noise"
    elif trial.candidate.driven and mean_square < state.share * left:
        why = why or "too small a part of the misfit"
    else:
        steady = constancy(problem, sigma, *contribution(problem, trial.fit, effect))
        leaves = excess(problem, trial.fit, sigma)
        if trial.candidate.last and leaves > max((0.3 * sigma) ** 2, 0.25 * left):
            why = why or "structure remains that it does not explain"
        if not why and (steady.wrong > 0.3 or steady.spread > 1.0):
            why = "not the same everywhere"
    return Trial(trial.candidate, trial.fit, trial.gain, trial.price, steady, why)


def _sure(state: Search, trial: Trial, left: float) -> bool:
    """Whether a small static cause may count: it takes about half of what there is, and is the
    same everywhere. Not for those that look through many shapes for the best."""
    n = int(state.problem.data.rows.sum())
    least = max(least_power(state, trial.candidate, SURE_SIZE), SURE_SHARE * left)
    if not trial.candidate.static or trial.candidate.many or trial.gain < n * least:
        return False
    effect = effect_of(trial.fit, trial.candidate.key)
    steady = constancy(state.problem, state.sigma, *contribution(state.problem, trial.fit, effect))
    return steady.spread < SURE_SPREAD and steady.wrong == 0.0


def _grown(problem: Problem, sigma: float, fit: Fitted, chosen: Candidate) -> Fitted:
    """The fit with more parts (modes) of the chosen physics, as long as they pay."""
    n = int(problem.data.rows.sum())
    effect = effect_of(fit, chosen.key)
    while theta := chosen.grown(effect.theta, problem.data, fit.residual(problem.data)):
        rest = [e for e in fit.effects if e is not effect]
        trial = problem.refit([*rest, Effect(chosen, theta)], start=fit)
        more = effect_of(trial, chosen.key)
        least = n * max((FREE_SIZE * sigma) ** 2, PART_SHARE * excess(problem, fit, sigma))
        price = PRICE * sigma**2 * (len(theta) - len(effect.theta))
        if fit.sse - trial.sse <= max(least, price) or on_bound(more):
            break
        amplitudes = trial.amplitudes[trial.effects.index(more)]
        if chosen.implausible(more.theta, amplitudes, problem.data):
            break
        fit, effect = trial, more
    return fit


def refine(
    problem: Problem, sigma: float, fit: Fitted, chosen: Candidate, everything: Sequence[Candidate]
) -> Fitted:
    """The fit with more parts of the chosen physics, or a finer form of it, where that pays."""
    n = int(problem.data.rows.sum())
    fit = _grown(problem, sigma, fit, chosen)
    for finer in everything:
        if finer.refines != chosen.key:
            continue
        effect = effect_of(fit, chosen.key)
        rest = [e for e in fit.effects if e is not effect]
        theta = finer.refined(effect.theta)
        trial = problem.refit([*rest, Effect(finer, theta)], start=fit)
        if fit.sse - trial.sse > max(n * (DRIVEN_SIZE * sigma) ** 2, PRICE * sigma**2):
            fit = trial
    return fit


def prune(problem: Problem, sigma: float, fit: Fitted, keep: str = "") -> Fitted:
    """Without the effects that the others have made needless."""
    n = int(problem.data.rows.sum())
    while len(fit.effects) > 1:
        losses = []
        out = problem.output_of(fit)
        for e in fit.effects:
            if e.candidate.key == keep:
                continue
            rest = [o for o in fit.effects if o is not e]
            losses.append((problem.solve(rest, out).sse - fit.sse, e))
        if not losses:
            break
        loss, weakest = min(losses, key=lambda pair: pair[0])
        limit = n * (least_size(weakest.candidate) * sigma) ** 2
        if loss > 4 * limit:
            break
        refitted = problem.refit([o for o in fit.effects if o is not weakest], start=fit)
        if refitted.sse - fit.sse > limit:
            break
        fit = refitted
    return fit
