"""Decide whether a candidate's joint refit may count: by its size, share, values and constancy."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dehyst.models.diagnosis.base import compact_base
from dehyst.models.diagnosis.data.drive_path import count_distinct_moments, is_moving_against_drive
from dehyst.models.diagnosis.effects import Effect, Span, parameters_at_bound
from dehyst.models.diagnosis.evidence import Constancy, constancy, contribution
from dehyst.models.diagnosis.fit import Problem
from dehyst.models.diagnosis.joint_fit import JointFit
from dehyst.models.diagnosis.screen import Screen
from dehyst.models.diagnosis.tuning import TUNING
from dehyst.models.physics import list_candidates
from dehyst.models.physics.candidate import Candidate
from dehyst.models.signals.error_size import rms
from dehyst.models.signals.joined import Data


@dataclass(frozen=True)
class CandidateTrial:
    """A candidate's best joint refit in one round."""

    candidate: Candidate
    fit: JointFit
    gain: float  # fall of the sum of squares
    price: float
    constancy: Constancy | None = None
    refused: str = ""
    impossible: bool = False  # not even a rival: its values cannot be this physics
    with_companion: JointFit | None = None  # the fit with what must be present, if that was asked

    @property
    def worth(self) -> float:
        """Gain after the price."""
        return self.gain - self.price


@dataclass(frozen=True)
class SearchState:
    """State of the search; `rounds` keeps the trials for the report."""

    problem: Problem
    sigma: float
    null: JointFit
    accepted: JointFit
    rounds: tuple[tuple[CandidateTrial, ...], ...] = ()
    counted: int = 0  # rows that the gains of the rounds are summed over
    share: float = TUNING.minor
    picked: tuple[str, ...] = ()  # keys in order of acceptance
    passed_over: tuple[str, ...] = ()  # keys of less likely equivalents


def misfit_beyond_noise(problem: Problem, fit: JointFit, sigma: float) -> float:
    """Return the mean square misfit beyond the noise, >= 0 [displacement unit squared]."""
    n = int(problem.data.rows.sum())
    free = n - fit.design.shape[1]
    return max(0.0, fit.sse / max(free, 1) - sigma**2)


def least_size(problem: Problem, candidate: Candidate) -> float:
    """Return the smallest rms, in noise rms, that a candidate must remove."""
    if candidate.driven and problem.is_single_loop:
        return TUNING.strong
    if candidate.static or candidate.is_last_resort:
        return TUNING.clear
    return TUNING.visible if candidate.driven else TUNING.trace


def least_power(state: SearchState, candidate: Candidate, size: float | None = None) -> float:
    """Return the mean square that a candidate must remove, set by the noise (size: in noise rms)
    and, for causes driven by the drive, also by the base's own error."""
    least = (least_size(state.problem, candidate) if size is None else size) * state.sigma
    if candidate.driven:
        part = 2 * TUNING.finest if candidate.static else TUNING.finest
        least = max(least, base_error(state.problem.data, part))
    return least**2


def base_error(data: Data, part: float = TUNING.finest) -> float:
    """Return the smallest rms error of any base: a small fraction of the stroke, or a fraction of
    what the drive does between two samples, since how far it turns there is not recorded."""
    stroke = float(np.ptp(data.y))
    path = data.path
    bend = np.diff(path.u, 2)[~(path.starts[1:-1] | path.starts[2:])]
    between = rms(bend / 8.0) if bend.size else 0.0
    return max(part * stroke, TUNING.quarter * between * stroke / data.span)


def least_share(state: SearchState, left: float) -> float:
    """Return the share of the misfit that a cause driven by the drive must remove. A residual far
    above a low noise but only a small fraction of the stroke is mostly the base's own error."""
    stroke = float(np.ptp(state.problem.data.y))
    quiet = TUNING.near * state.sigma < np.sqrt(left) < 4 * TUNING.finest * stroke
    return max(state.share, TUNING.half) if quiet else state.share


def can_distinguish_lag(problem: Problem, sigma: float) -> bool:
    """Return whether a delay, a lag or a slew limit can be distinguished from the loop. It cannot
    where the drive is sampled at so few places that even a compact base has a column for nearly
    each, unless the displacement moves against the drive."""
    if not problem.has_few_distinct_moments:
        return True
    columns = compact_base(problem.data).width + len(problem.data.names)
    enough = count_distinct_moments(problem.data) >= TUNING.near * columns
    return enough or is_moving_against_drive(problem.data, sigma)


def effect_of(fit: JointFit, key: str) -> Effect:
    """Return the effect of a fit with this candidate's key."""
    return next(e for e in fit.effects if e.candidate.key == key)


def try_candidate(
    problem: Problem,
    sigma: float,
    current: JointFit,
    c: Candidate,
    start: Sequence[float],
    span: Span | None = None,
) -> CandidateTrial:
    """Return a candidate's trial, refitted jointly with the accepted effects, and its price."""
    fit = problem.refit([*current.effects, Effect(c, tuple(start), span)], start=current)
    count = sum(len(e.theta) for e in fit.effects) - sum(len(e.theta) for e in current.effects)
    columns = fit.design.shape[1] - current.design.shape[1]
    price = TUNING.price * sigma**2 * max(count + columns, 1)
    return CandidateTrial(c, fit, current.sse - fit.sse, price)


def judge(state: SearchState, trial: CandidateTrial, left: float) -> CandidateTrial:
    """Return the trial with its constancy and, where it fails, the reason."""
    problem, sigma = state.problem, state.sigma
    data = problem.data
    n = int(data.rows.sum())
    effect = effect_of(trial.fit, trial.candidate.key)
    mean_square = trial.gain / n
    why = trial.candidate.implausible(effect.theta, trial.fit.amplitudes_of(effect), data)
    impossible = bool(why) and not trial.candidate.rival_if_implausible
    steady = with_companion = None
    index = trial.candidate.size_index
    size = effect.parameters[index] if index is not None else None
    if not why and size and not size.whole and size.key in parameters_at_bound(effect):
        why = "its size is at a bound: not identified"
    if trial.worth <= 0:
        why = why or "its improvement does not justify its parameters"
    elif mean_square < least_power(state, trial.candidate) and not is_sure(state, trial, left):
        why = why or "too small compared with the noise"
    elif trial.candidate.driven and mean_square < least_share(state, left) * left:
        why = why or "too small a part of the misfit"
    else:
        steady = constancy(problem, sigma, *contribution(problem, trial.fit, effect))
        leaves = misfit_beyond_noise(problem, trial.fit, sigma)
        seen = max((TUNING.clear * sigma) ** 2, TUNING.quarter * left)
        if trial.candidate.is_last_resort and leaves > seen:
            why = why or "structure remains that it does not explain"
        if not why and (steady.wrong > 0.3 or steady.spread > trial.candidate.widest_spread):
            why = "not constant over the recordings"
        if not why:
            with_companion = fit_with_companion(problem, trial)
            why = implausible_with_companion(state, trial, with_companion)
    return replace(
        trial,
        constancy=steady,
        refused=why,
        impossible=impossible,
        with_companion=with_companion,
    )


def is_sure(state: SearchState, trial: CandidateTrial, left: float) -> bool:
    """Return whether a small static cause, or one that no base imitates, may count: it removes
    about half of the misfit, and is the same everywhere."""
    n, candidate = int(state.problem.data.rows.sum()), trial.candidate
    effect = effect_of(trial.fit, candidate.key)
    like_the_loop = candidate.static and candidate.driven and state.problem.is_single_loop
    if like_the_loop or not candidate.can_count_when_small(effect.theta):
        return False
    noise = (TUNING.visible * state.sigma) ** 2
    least = least_power(state, candidate, TUNING.visible) if candidate.static else noise
    if trial.gain < n * max(least, TUNING.half * left):
        return False
    steady = constancy(state.problem, state.sigma, *contribution(state.problem, trial.fit, effect))
    return steady.spread < TUNING.quarter and steady.wrong == 0.0


def fit_with_companion(problem: Problem, trial: CandidateTrial) -> JointFit:
    """Return the trial's fit, together with the effect that must be present with it."""
    companion, fit = trial.candidate.required_companion(), trial.fit
    if not companion or companion in fit.effect_keys:
        return fit
    screen = Screen(problem, fit)
    for other in (c for c in list_candidates(problem.data) if c.key == companion):
        for gain, theta in screen.starts(other)[:1]:
            if gain > 0:
                both = problem.refit([*trial.fit.effects, Effect(other, theta)], start=trial.fit)
                fit = min(fit, both, key=lambda f: f.sse)
    return fit


def implausible_with_companion(state: SearchState, trial: CandidateTrial, fit: JointFit) -> str:
    """Return why the amplitudes of the trial's candidate are not possible beside what must be
    present with it, or "". fit: together with that; a companion that gains less than the price of
    two parameters, its size and a time, is not there."""
    companion = trial.candidate.required_companion()
    if not companion:
        return ""
    seen = 2 * TUNING.price * state.sigma**2
    there = companion in trial.fit.effect_keys or trial.fit.sse - fit.sse > seen
    found = effect_of(fit, companion).theta if there else ()
    amplitudes = fit.amplitudes_of(effect_of(fit, trial.candidate.key))
    return trial.candidate.implausible_with(amplitudes, found, state.problem.data)


def worth_with_companion(state: SearchState, trial: CandidateTrial) -> float:
    """Return the fall of the sum of squares by the trial's candidate together with the one that
    must accompany it, less a price for each of their parameters (G. Schwarz, Ann. Statist. 6,
    1978), so that two explanations of the same misfit are compared as a whole."""
    problem = state.problem
    fit = trial.with_companion or fit_with_companion(problem, trial)
    count = sum(len(e.theta) for e in fit.effects) + fit.design.shape[1]
    count -= sum(len(e.theta) for e in state.accepted.effects) + state.accepted.design.shape[1]
    price = float(np.log(problem.data.rows.sum())) * state.sigma**2
    return state.accepted.sse - fit.sse - price * count
