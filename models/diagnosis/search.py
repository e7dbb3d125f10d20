"""Search for the effects: screen, refit jointly, apply price and thresholds, repeat, prune,
back-track.

Gains are sums of squares over the counted rows [displacement unit squared], always after everything
else was refitted.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from dehyst.models.diagnosis.effects import Effect, parameters_at_bound
from dehyst.models.diagnosis.fit import Problem
from dehyst.models.diagnosis.joint_fit import JointFit
from dehyst.models.diagnosis.judge import (
    CandidateTrial,
    SearchState,
    effect_of,
    judge,
    least_size,
    misfit_beyond_noise,
    try_candidate,
    worth_with_companion,
)
from dehyst.models.diagnosis.result import Progress
from dehyst.models.diagnosis.screen import Screen
from dehyst.models.diagnosis.shortlist import (
    ScreenedCandidate,
    list_eligible,
    list_remaining,
    rank_by_estimated_gain,
    select_for_refit,
)
from dehyst.models.diagnosis.tuning import TUNING
from dehyst.models.physics.candidate import Candidate


def search(
    problem: Problem,
    sigma: float,
    null: JointFit,
    say: Progress,
    share: float = TUNING.minor,
    forbidden: Sequence[str] = (),
) -> SearchState:
    """Accept effects one by one until none pays, then prune. forbidden: keys that are not tried.

    share: share of the excess that a cause driven by the drive must remove; above the usual share
    the base is a compact one, and candidates that resemble a hysteresis of another shape are
    excluded.
    """
    counted = int(problem.data.rows.sum())
    bare = SearchState(problem, sigma, null, null, counted=counted, share=share)
    state = _forward(bare, say, forbidden)
    first = state.accepted.effects
    left = misfit_beyond_noise(problem, state.accepted, sigma)
    if len(first) >= 2 and state.rounds:
        # one back-track: a wrong first pick is often compensated by several others
        chosen = next(t for t in state.rounds[0] if t.candidate.key in state.picked[:1])
        # it should leave no structure, yet more was accepted
        last = chosen.candidate.is_last_resort
        part = TUNING.half if last else TUNING.most
        rivals = [
            t
            for t in state.rounds[0]
            if t is not chosen and not t.refused and t.gain > part * chosen.gain
        ]
        doubtful = chosen.candidate.driven or last
        if rivals and doubtful and problem.solution_count < 0.5 * TUNING.budget:
            other = _forward(bare, say, (*forbidden, chosen.candidate.key))
            if is_better_search(other, state, left):
                state = other
    return state


def is_better_search(other: SearchState, state: SearchState, left: float) -> bool:
    """Return whether another search explains the same with fewer physics, or clearly more."""
    n = int(state.problem.data.rows.sum())
    other_left = misfit_beyond_noise(state.problem, other.accepted, state.sigma)
    margin = max(0.1 * left, (0.07 * state.sigma) ** 2)
    names, other_names = ({e.candidate.name for e in s.accepted.effects} for s in (state, other))
    count, other_count = len(names), len(other_names)
    if other_count < count:
        return other_left < left + margin
    if other_count == count:
        pays = (left - other_left) * n > TUNING.price * state.sigma**2
        return pays and other_left < left - margin
    return False


def _forward(state: SearchState, say: Progress, forbidden: Sequence[str]) -> SearchState:
    everything = list_eligible(state.problem, state.share, forbidden)
    for number in range(TUNING.max_effects):
        if state.problem.solution_count > TUNING.budget:
            break
        before = state.picked
        state = _run_round(state, everything, TUNING.shortlist, say, number)
        if state.picked == before:
            break
    return state


def search_one_more(
    state: SearchState, shortlist: int, more: Sequence[Candidate] = ()
) -> SearchState:
    """Search one more round from a state's accepted effects. shortlist: candidates that get the
    full refit; more: candidates in addition to the library's."""
    everything = [*list_eligible(state.problem, state.share, ()), *more]
    return _run_round(state, everything, shortlist, lambda text, share: None, 0)


def _run_round(
    state: SearchState, everything: Sequence[Candidate], shortlist: int, say: Progress, number: int
) -> SearchState:
    """Screen, refit a short list and accept the best, if there is one."""
    screen = Screen(state.problem, state.accepted)
    pool = list_remaining(state.problem, state.accepted, everything)
    screened = zip(pool, state.problem.several(screen.starts, pool), strict=True)
    ranked = rank_by_estimated_gain(state, screened)
    trials = refit_each(state, select_for_refit(ranked, shortlist), say, number)
    return accept_best(state, trials, everything)


def refit_each(
    state: SearchState, short: Sequence[ScreenedCandidate], say: Progress, number: int
) -> list[CandidateTrial]:
    """Return the trials of a short list, the most valuable first. number: index of the round."""
    problem, sigma, current = state.problem, state.sigma, state.accepted

    def attempt(one: ScreenedCandidate) -> CandidateTrial:
        c = one.candidate
        starts = [one.theta, *one.further, *_distant_starts(problem, current, c)]
        starts += [double for theta in starts for double in c.likelier_equivalents(theta)]
        trials = [try_candidate(problem, sigma, current, c, theta) for theta in starts]
        return max(trials, key=_likely_gain)

    trials = []
    for k, trial in enumerate(problem.several(attempt, short)):
        share = (number + k / TUNING.shortlist) * 0.15
        say(f"tried {trial.candidate.key}", min(0.85, 0.1 + share))
        trials.append(trial)
    return sorted(trials, key=lambda t: -t.worth)


def _likely_gain(trial: CandidateTrial) -> float:
    effect = effect_of(trial.fit, trial.candidate.key)
    return trial.gain * effect.candidate.plausibility_weight(
        effect.theta, trial.fit.amplitudes_of(effect)
    )


def _distant_starts(problem: Problem, current: JointFit, c: Candidate) -> list[tuple[float, ...]]:
    """Return further starts for a slowly sampled drive: an effect of about one sample is too large
    for a first-order estimate from the fit without it. The two starts that fit best are
    returned."""
    if not c.late or problem.data.between is None:
        return []
    given = c.starts(problem.data, current.residual(problem.data))
    between = [tuple(np.sqrt(np.array(a) * np.array(b))) for a, b in pairwise(given)]

    def left(theta: tuple[float, ...]) -> float:
        return problem.solve([*current.effects, Effect(c, theta)]).sse

    return sorted([*given, *between], key=left)[:2]


def accept_best(
    state: SearchState, trials: Sequence[CandidateTrial], everything: Sequence[Candidate]
) -> SearchState:
    """Return the state with a round's trials, the best of them accepted. everything: candidates,
    one of which may be a finer form of it."""
    problem, sigma = state.problem, state.sigma
    left = misfit_beyond_noise(problem, state.accepted, sigma)
    judged = tuple(judge(state, t, left) for t in trials)
    good = [t for t in judged if not t.refused]
    reported = tuple(replace(t, fit=t.fit.without_rows(), with_companion=None) for t in judged)
    rounds = (*state.rounds, reported)
    if not good:
        return replace(state, rounds=rounds)
    chosen, *others = _choices(state, good)
    key = chosen.candidate.key
    fit = refine_fit(problem, sigma, chosen.fit, chosen.candidate, everything)
    return replace(
        state,
        rounds=rounds,
        picked=(*state.picked, key),
        passed_over=(*state.passed_over, *(t.candidate.key for t in others)),
        accepted=prune(problem, sigma, fit, keep=key),
    )


def _choices(state: SearchState, good: Sequence[CandidateTrial]) -> list[CandidateTrial]:
    """Return the best accepted trial, or a simpler or a likelier one that does as well, followed by
    those that could equally have been chosen."""
    best = good[0]
    n = int(state.problem.data.rows.sum())
    tie = max(n * (TUNING.trace * state.sigma) ** 2, 0.01 * best.gain)
    near = [t for t in good if best.gain - t.gain < tie]
    simpler = [t for t in near if t.price < best.price]
    chosen = min(simpler, key=lambda t: (t.price, -t.gain)) if simpler else best
    alike, doubles = (
        [t for t in some if chosen.candidate.name in t.candidate.confused_with]
        for some in (good, near)
    )
    rivals = [chosen, *(t for t in alike if t.candidate.past or chosen.candidate.past)]
    taken = chosen
    # include what must be present with it
    if any(t.candidate.required_companion() for t in rivals):
        taken = max(rivals, key=lambda t: worth_with_companion(state, t))
    return [taken, *(t for t in (chosen, *doubles) if t is not taken)]


def _with_more_parts(problem: Problem, sigma: float, fit: JointFit, chosen: Candidate) -> JointFit:
    """Return the fit with more parts (modes) of the chosen physics, as long as they pay."""
    n = int(problem.data.rows.sum())
    effect = effect_of(fit, chosen.key)
    while theta := chosen.add_mode(effect.theta, problem.data, fit.residual(problem.data)):
        rest = [e for e in fit.effects if e is not effect]
        trial = problem.refit([*rest, Effect(chosen, theta)], start=fit)
        more = effect_of(trial, chosen.key)
        least = n * max(
            (TUNING.trace * sigma) ** 2, TUNING.crumb * misfit_beyond_noise(problem, fit, sigma)
        )
        price = TUNING.price * sigma**2 * (len(theta) - len(effect.theta))
        if fit.sse - trial.sse <= max(least, price) or parameters_at_bound(more):
            break
        if chosen.implausible(more.theta, trial.amplitudes_of(more), problem.data):
            break
        fit, effect = trial, more
    return fit


def refine_fit(
    problem: Problem,
    sigma: float,
    fit: JointFit,
    chosen: Candidate,
    everything: Sequence[Candidate],
) -> JointFit:
    """Return the fit with more parts of the chosen physics, or a finer form of it, where that
    pays."""
    n = int(problem.data.rows.sum())
    fit = _with_more_parts(problem, sigma, fit, chosen)
    for finer in everything:
        if chosen.key not in finer.refines:
            continue
        effect = effect_of(fit, chosen.key)
        rest = [e for e in fit.effects if e is not effect]
        theta = finer.refined_start(effect.theta)
        trial = problem.refit([*rest, Effect(finer, theta)], start=fit)
        if fit.sse - trial.sse > max(n * (TUNING.visible * sigma) ** 2, TUNING.price * sigma**2):
            fit, chosen = trial, finer
    return fit


def prune(problem: Problem, sigma: float, fit: JointFit, keep: str = "") -> JointFit:
    """Return the fit without the effects that the others have made unnecessary."""
    n = int(problem.data.rows.sum())
    while len(fit.effects) > 1:
        others = [e for e in fit.effects if e.candidate.key != keep]
        losses = [(problem.without(fit, e).sse - fit.sse, e) for e in others]
        if not losses:
            break
        loss, weakest = min(losses, key=lambda pair: pair[0])
        limit = n * (least_size(problem, weakest.candidate) * sigma) ** 2
        if loss > 4 * limit:
            break
        refitted = problem.refit([o for o in fit.effects if o is not weakest], start=fit)
        if refitted.sse - fit.sse > limit:
            break
        fit = refitted
    return fit
