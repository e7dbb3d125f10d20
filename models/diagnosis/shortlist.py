"""Select the candidates to try next and their order: which may be tried on these recordings, which
may be added to a fit's effects, and what the screen estimates they gain."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from dehyst.models.diagnosis.data.drive_path import can_be_distinguished, has_few_turns
from dehyst.models.diagnosis.effects import Theta
from dehyst.models.diagnosis.fit import Problem
from dehyst.models.diagnosis.joint_fit import JointFit
from dehyst.models.diagnosis.judge import SearchState, least_size
from dehyst.models.diagnosis.tuning import TUNING
from dehyst.models.physics import list_candidates
from dehyst.models.physics.candidate import Candidate


def list_eligible(problem: Problem, share: float, forbidden: Sequence[str]) -> list[Candidate]:
    """Return the candidates that may be tried."""
    data = problem.data
    strict = share > TUNING.minor
    few = has_few_turns(data)
    return [
        c
        for c in list_candidates(data)
        if c.key not in forbidden
        and not (strict and c.static)
        and not (c.beside_model and problem.base.width)
        and (not few or can_be_distinguished(c, data))
    ]


def list_remaining(
    problem: Problem, current: JointFit, everything: Sequence[Candidate]
) -> list[Candidate]:
    """Return the candidates that may be added next to a fit's effects."""
    # an effect in its finer form covers the simpler one too
    have = {k for e in current.effects for k in (e.candidate.key, *e.candidate.refines)}
    late = problem.has_few_distinct_moments and any(e.candidate.late for e in current.effects)
    return [
        c
        for c in everything
        if c.key not in have
        and (not c.refines or (c.alone and have.isdisjoint(c.refines)))
        and not (late and c.late)
        and _next_of_its_kind(c, have)
    ]


def _next_of_its_kind(candidate: Candidate, have: set[str]) -> bool:
    """Return whether a candidate is next in its series: numbered ones (modes) come in order, the
    second only after the first."""
    stem, _, number = candidate.key.rpartition("-")
    if candidate.channel or not number.isdecimal():
        return True
    return (stem if number == "2" else f"{stem}-{int(number) - 1}") in have


@dataclass(frozen=True)
class ScreenedCandidate:
    """A candidate's best start, its gain (fall of the sum of squares) estimated by the screen, and
    further starts that are refitted too."""

    candidate: Candidate
    theta: Theta
    gain: float
    further: tuple[Theta, ...] = ()


def rank_by_estimated_gain(
    state: SearchState, screened: Iterable[tuple[Candidate, Sequence[tuple[float, Theta]]]]
) -> list[ScreenedCandidate]:
    """Return the candidates that could be worth a refit, largest estimated gain first. screened:
    each candidate with its starts, best first."""
    n = int(state.problem.data.rows.sum())
    promises = [
        ScreenedCandidate(c, starts[0][1], starts[0][0], _further(c, starts))
        for c, starts in screened
        if starts and starts[0][0] > n * (0.5 * least_size(state.problem, c) * state.sigma) ** 2
    ]
    return sorted(promises, key=lambda p: -p.gain)


def _further(c: Candidate, starts: Sequence[tuple[float, Theta]]) -> tuple[Theta, ...]:
    """Return, where the misfit has several minima, the starts whose estimated gain is close to the
    best."""
    return tuple(theta for gain, theta in starts[1 : c.minima] if gain > TUNING.half * starts[0][0])


def drop_weak(
    some: Sequence[ScreenedCandidate], ranked: Sequence[ScreenedCandidate]
) -> list[ScreenedCandidate]:
    """Return those whose estimated gain is more than a small fraction of the largest."""
    return [p for p in some if p.gain > TUNING.minor * ranked[0].gain]


def select_for_refit(ranked: Sequence[ScreenedCandidate], most: int) -> list[ScreenedCandidate]:
    """Return at most `most` of the strongest, and in addition those not caused by the drive and
    those that contain another physics, which take no other candidate's place."""
    strong = drop_weak(ranked, ranked)
    beside = [p for p in strong if set(p.candidate.contains) - {p.candidate.name}]
    first = [p for p in strong if p not in beside][:most]
    return [p for p in strong if p in first or p in beside or not p.candidate.driven]
