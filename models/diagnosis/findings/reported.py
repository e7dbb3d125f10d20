"""Select the accepted effects that are worth reporting: those that help on held-out samples, and
whose size is known to a factor of ten and does not vary."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from dehyst.models.diagnosis.effects import Effect
from dehyst.models.diagnosis.evidence import blockwise_held_out_error, constancy, contribution
from dehyst.models.diagnosis.findings.growth import growth
from dehyst.models.diagnosis.intervals import intervals
from dehyst.models.diagnosis.joint_fit import JointFit
from dehyst.models.diagnosis.judge import SearchState
from dehyst.models.diagnosis.result import Value
from dehyst.models.diagnosis.tuning import TUNING
from dehyst.models.physics.candidate import Candidate
from dehyst.models.signals.lines import gain_of_line


def keep_helpful_effects(found: SearchState) -> SearchState:
    """Return the search without the effects that do not help on held-out samples, or may be lines
    of the surroundings."""
    problem, sigma = found.problem, found.sigma
    final = _without_lines(found)
    first = blockwise_held_out_error(problem, found.null)
    while final.effects:
        whole = blockwise_held_out_error(problem, final)
        # next to a cause a hundred times as large, a second one of a few noise rms still counts
        of_all = TUNING.trace**2 * max(first - sigma**2, 0.0)
        of_rest = TUNING.minor * max(whole - sigma**2, 0.0)
        losses = []
        for e in final.effects:
            most = TUNING.strong if e.candidate.driven else TUNING.clear
            least = max((TUNING.trace * sigma) ** 2, min(of_all, (most * sigma) ** 2), of_rest)
            alone = len(final.effects) == 1
            left = first if alone else blockwise_held_out_error(problem, problem.without(final, e))
            losses.append(((left - whole) / least, e))
        loss, weakest = min(losses, key=lambda pair: pair[0])
        if loss > 1.0:
            break
        final = _without(found, final.effects, weakest)
    if (
        final.effects
        and first - blockwise_held_out_error(problem, final) < (TUNING.trace * sigma) ** 2
    ):
        final = found.null  # each seems to need the others, and together they predict nothing
    return replace(found, accepted=final)


def _without_lines(found: SearchState) -> JointFit:
    """Return the fit without modes that may be lines of the surroundings: a drive that repeats a
    single loop does not distinguish the two."""
    problem, final = found.problem, found.accepted
    if not problem.is_single_loop:
        return final
    for e in final.effects:
        ring = e.candidate.free_oscillation(e.theta)
        if ring is None or not e.candidate.driven:
            continue
        left = problem.without(final, e)
        line = gain_of_line(problem.data, left.residual(problem.data), ring[0])
        if line > (1.0 - TUNING.minor) * (left.sse - final.sse):
            final = _without(found, final.effects, e)
    return final


def keep_effects_of_known_size(found: SearchState) -> SearchState:
    """Return the search without the effects whose size is not known to a factor of ten, or differs
    between parts of the recordings. Of several similar ones, the one that the others best replace
    is removed first, which may leave another one known."""
    final, problem = found.accepted, found.problem
    while final.effects:
        values = intervals(problem, final, found.sigma)
        wide = [
            effect
            for effect, value in zip(final.effects, values, strict=True)
            if not (size_is_known(effect, value) and has_steady_size(found, final, effect))
        ]
        if not wide:
            break
        left = [problem.without(final, e).sse for e in wide]
        final = _without(found, final.effects, wide[int(np.argmin(left))])
    return replace(found, accepted=final)


def without_effects_of_kind(
    found: SearchState, of_kind: Callable[[Candidate], bool]
) -> SearchState:
    """Return the search without the effects of a kind of candidate."""
    rest = [e for e in found.accepted.effects if not of_kind(e.candidate)]
    if len(rest) == len(found.accepted.effects):
        return found
    final = found.problem.refit_closely(rest, found.sigma) if rest else found.null
    return replace(found, accepted=final)


def _without(found: SearchState, effects: tuple[Effect, ...], one: Effect) -> JointFit:
    rest = [o for o in effects if o is not one]
    return found.problem.refit_closely(rest, found.sigma) if rest else found.null


def has_steady_size(found: SearchState, final: JointFit, effect: Effect) -> bool:
    """Return whether an effect has one size throughout the recordings, or one size before and
    another after some time. An effect that varies by more than half without such a time is an
    artefact of other structure, and does not predict another recording."""
    data, sigma = found.problem.data, found.sigma
    x, r = contribution(found.problem, final, effect)
    if constancy(found.problem, sigma, x, r).spread <= TUNING.half:
        return True
    return growth(data, sigma, x, r) is not None


def size_is_known(effect: Effect, values: Mapping[str, Value]) -> bool:
    """Return whether the parameter that gives the effect's size has an interval of less than a
    factor of ten."""
    parameters = effect.parameters
    if effect.candidate.size_index is not None:
        return is_narrow(values[parameters[effect.candidate.size_index].key])
    own = {p.key for p in parameters}
    sizes = [v for k, v in values.items() if k not in own]
    if not sizes:  # the parameters are the size; a level has no factor
        sizes = [values[p.key] for p in parameters if p.log and p.key in values][:1]
    return any(is_narrow(v) for v in sizes) if sizes else True


def unidentified(effect: Effect, values: Mapping[str, Value]) -> list[str]:
    """Return the keys whose interval spans more than a factor of ten, which are not reported. A
    level's interval may include 0, where no factor is defined."""
    levels = {p.key for p in effect.parameters if not p.log}
    return [
        k for k, v in values.items() if not is_narrow(v) and (k not in levels or v.low * v.high > 0)
    ]


def is_narrow(v: Value) -> bool:
    """Return whether an interval spans less than a factor of ten."""
    low, high = sorted((abs(v.low), abs(v.high)))
    return bool(v.low * v.high > 0 and high < TUNING.widest * low)
