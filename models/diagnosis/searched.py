"""Find the effects: SearchProblem -> Searched. The search uses a rich base, or a compact one where
little was recorded, and estimates the noise from its own residual."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from dehyst.models.diagnosis.base import compact_base, no_base
from dehyst.models.diagnosis.data.between import with_smooth_path
from dehyst.models.diagnosis.data.noise import noise_rms
from dehyst.models.diagnosis.data.survey import (
    BUTTERFLY_WARNING,
    FEW_PLACES,
    has_response_to_drive,
    has_reversals_within_sweeps,
)
from dehyst.models.diagnosis.effects import Effect
from dehyst.models.diagnosis.evidence import blockwise_held_out_error
from dehyst.models.diagnosis.findings.episodes import Episode
from dehyst.models.diagnosis.findings.reported import (
    keep_effects_of_known_size,
    keep_helpful_effects,
    without_effects_of_kind,
)
from dehyst.models.diagnosis.findings.spans import with_span
from dehyst.models.diagnosis.fit import Problem
from dehyst.models.diagnosis.judge import (
    SearchState,
    can_distinguish_lag,
    misfit_beyond_noise,
)
from dehyst.models.diagnosis.pasts import explained_heads, rows_with_heads
from dehyst.models.diagnosis.result import Progress
from dehyst.models.diagnosis.search import search
from dehyst.models.diagnosis.search_problem import SearchProblem, SearchStart
from dehyst.models.diagnosis.tuning import TUNING
from dehyst.models.physics import list_candidates
from dehyst.models.physics.candidate import Candidate, Sighting
from dehyst.models.signals.joined import Data


@dataclass(frozen=True)
class SearchResult:
    """The search's result, and the result with the rich base."""

    search: SearchState
    over_rich: SearchState


@dataclass(frozen=True)
class Searched:
    """What was found. whole, bare: as in SearchProblem, with those heads of recordings that are
    explained; found: effects other than the episode; seen: what recordings show directly, without a
    fit; shown: keys of the accepted effects that were also seen; warnings: warnings about the data,
    which are reported first."""

    whole: Data
    bare: Problem
    found: SearchState
    episode: Episode | None
    seen: tuple[tuple[Candidate, Sighting], ...]
    shown: frozenset[str]
    warnings: tuple[str, ...]


def look_for_causes(search_problem: SearchProblem, say: Progress) -> Searched:
    """Find the effects: by the search, and as recordings show them directly."""
    result, heads = _search_with_heads(search_problem, say)
    result = _without_base_if_as_good(result, say)
    spanned = with_span(result.search)
    if spanned is not result.search:
        result = SearchResult(spanned, spanned)
    whole, alone = (
        replace(one, rows=rows_with_heads(one, heads))
        for one in (search_problem.whole, search_problem.bare.data)
    )
    found, rich = result.search, result.over_rich
    data = rich.problem.data
    unexplained = blockwise_held_out_error(rich.problem, rich.null)
    explained = blockwise_held_out_error(found.problem, found.accepted)
    butterfly = has_reversals_within_sweeps(data) and explained > TUNING.minor * unexplained
    if butterfly or not has_response_to_drive(data, min(unexplained, explained)):
        # outside the model class: what the drive causes cannot be distinguished from the loop
        found = without_effects_of_kind(found, lambda c: c.driven)
    seen = [(c, c.find_sighting(data, found.sigma)) for c in list_candidates(data)]
    sightings = tuple((c, one) for c, one in seen if one is not None)
    for candidate, one in sightings:
        other = _accept(rich, Effect(candidate, one.theta))
        if candidate.key in other.accepted.effect_keys:
            found = other
    few = "" if can_distinguish_lag(rich.problem, found.sigma) else FEW_PLACES
    shown = frozenset(c.key for c, _ in sightings) & set(found.accepted.effect_keys)
    warnings = (search_problem.foreign, BUTTERFLY_WARNING if butterfly else "", few)
    bare = replace(search_problem.bare, data=alone)
    given = tuple(one for one in warnings if one)
    return Searched(whole, bare, found, search_problem.episode, sightings, shown, given)


def _search_with_heads(
    search_problem: SearchProblem, say: Progress
) -> tuple[SearchResult, list[int]]:
    """Return the search's result, and the recordings whose heads count in it. Once the first
    effects are known, so is the past, and the heads show what began before the recording. The
    effects are found from the other rows, because in the heads the past of the hysteresis shows as
    well."""
    plain = find_above_noise(search_problem.start, say)
    search_start = search_problem.start.with_problem(
        switch_model_under_base(search_problem.start.problem, plain.search)
    )
    if search_start is not search_problem.start:
        plain = find_above_noise(search_start, say)
    first, data = plain.search, search_start.problem.data
    heads = explained_heads(first.problem, first.accepted, first.sigma)
    if not heads:
        return plain, heads
    longer = replace(data, rows=rows_with_heads(data, heads))
    search_start = search_start.with_problem(replace(search_start.problem, data=longer))
    found = find_above_noise(search_start, say, first.passed_over)
    # candidates that were passed over in a near-tie stay rivals
    rounds = (*found.search.rounds, *(first.rounds if first.passed_over else ()))
    return replace(found, search=replace(found.search, rounds=rounds)), heads


def _without_base_if_as_good(result: SearchResult, say: Progress) -> SearchResult:
    """Return what is found over a given model without a base, if that leaves little but noise and
    predicts held-out samples as well. A base that is free to bend takes over part of an effect,
    such as the fast part of creep, and what it took is then reported as a shape."""
    found = result.search
    problem = found.problem
    if not problem.diagnosed.given or not problem.base.width or problem.has_few_distinct_moments:
        return result
    alone = replace(
        problem,
        base=no_base(problem.data),
        diagnosed=replace(problem.diagnosed, carries=True),
    )
    start = SearchStart(alone, alone.solve([]), found.sigma)
    other = _find_known(start, say, ()).search
    if not other.accepted.effects or any(e.candidate.static for e in other.accepted.effects):
        return result  # what resembles a loop of another shape may be one
    noise = found.sigma**2
    with_base = blockwise_held_out_error(problem, found.accepted) - noise
    without = blockwise_held_out_error(alone, other.accepted) - noise
    most = with_base + TUNING.clear**2 * noise
    if any(e.candidate.slow for e in other.accepted.effects):  # fits a part of any change in time
        most = TUNING.half * with_base
    as_good = without < min(most, TUNING.strong**2 * noise)
    return replace(result, search=other) if as_good else result


def switch_model_under_base(problem: Problem, found: SearchState) -> Problem:
    """Return the problem with the model in use removed from under the base, or added where it was
    not, if that predicts much better with the effects found: a large effect dominates the errors
    that `choose_model_under_base` compares."""
    diagnosed = problem.diagnosed
    if not found.accepted.effects or (diagnosed.carries and diagnosed.model.blocks):
        return problem
    other = replace(problem, diagnosed=replace(diagnosed, carries=not diagnosed.carries))
    fit = other.refit(found.accepted.effects)
    now = blockwise_held_out_error(found.problem, found.accepted)
    return other if blockwise_held_out_error(other, fit) < TUNING.most * now else problem


def find_above_noise(
    search_start: SearchStart, say: Progress, forbidden: Sequence[str] = ()
) -> SearchResult:
    """Find the effects, with the noise estimated from what they leave: where the drive fills the
    band, an effect's contribution counts as noise until the effect is known. forbidden: keys that
    are not tried."""
    search_start = search_start.with_estimated_noise()
    found = _find_known(search_start, say, forbidden)
    data = search_start.problem.data
    left = noise_rms(data, found.search.accepted.residual(data))
    if left > TUNING.most * search_start.sigma:
        return found
    again = _find_known(replace(search_start, sigma=left), say, forbidden)
    first, second = (
        blockwise_held_out_error(f.search.problem, f.search.accepted) for f in (found, again)
    )
    if second < first - (TUNING.trace * left) ** 2:
        return again
    return SearchResult(replace(found.search, sigma=left), replace(found.over_rich, sigma=left))


def _find_known(search_start: SearchStart, say: Progress, forbidden: Sequence[str]) -> SearchResult:
    """Find the effects whose size is known. Where the search accepts one whose size is not, search
    again without it: another effect may account for the same misfit."""
    found = _find(search_start, say, forbidden)
    kept = keep_helpful_effects(found.search)
    reported = keep_effects_of_known_size(kept)
    vague = set(kept.accepted.effect_keys) - set(reported.accepted.effect_keys)
    if vague:
        other = _find(search_start, say, (*forbidden, *vague))
        again = keep_effects_of_known_size(keep_helpful_effects(other.search))
        first, second = (blockwise_held_out_error(f.problem, f.accepted) for f in (reported, again))
        if second < first:
            found, reported = other, again
    if found.over_rich is found.search:
        return SearchResult(reported, reported)
    return SearchResult(reported, keep_effects_of_known_size(keep_helpful_effects(found.over_rich)))


def _find(search_start: SearchStart, say: Progress, forbidden: Sequence[str]) -> SearchResult:
    """Find the effects with the rich base, or with a compact one where the rich one has too many
    columns for what was recorded."""
    problem, null = search_start.problem, search_start.null
    if problem.has_few_distinct_moments:
        return _find_with_few_moments(search_start, say, forbidden)
    found = over_rich = _search(search_start, say, forbidden)
    in_sample = null.sse / int(problem.data.rows.sum())
    if blockwise_held_out_error(problem, null) > TUNING.near**2 * in_sample:
        plain = search_start.with_problem(replace(problem, base=compact_base(problem.data)))
        other = _search(plain, say, forbidden, share=TUNING.quarter)
        if blockwise_held_out_error(other.problem, other.accepted) < blockwise_held_out_error(
            problem, found.accepted
        ):
            found = other
    return SearchResult(found, over_rich)


def _find_with_few_moments(
    search_start: SearchStart, say: Progress, forbidden: Sequence[str]
) -> SearchResult:
    """Find the effects where the drive repeats itself within so few samples that a rich base can
    fit each sample, and absorbs all that the drive causes within a period. Late effects (delay,
    lag) are reported from a fit with a compact base alone, and only where they remove by far the
    most of what this base leaves: a loop of another class removes less."""
    problem, diagnosed = search_start.problem, search_start.problem.diagnosed
    within = [c for c in list_candidates(problem.data) if c.driven and not c.lasting]
    unseen = [c.key for c in within if not c.late]
    over_rich = _search(search_start, say, (*forbidden, *(c.key for c in within)))
    # a model that an effect may have distorted does not help if nothing corrects it
    own = replace(diagnosed, carries=diagnosed.given and diagnosed.carries)
    plain = search_start.with_problem(
        replace(problem, base=compact_base(problem.data), diagnosed=own)
    )
    other = _search(plain, say, (*forbidden, *unseen), TUNING.most)
    caused = any(e.candidate.late for e in other.accepted.effects)
    distinguished = caused and can_distinguish_lag(problem, search_start.sigma)
    return SearchResult(other if distinguished else over_rich, over_rich)


def _search(
    search_start: SearchStart, say: Progress, forbidden: Sequence[str], share: float = TUNING.minor
) -> SearchState:
    """Search on a subset of the rows and fit the result to all of them, with lags and modes fed by
    steps or by straight lines, whichever leaves less with all effects known."""
    problem = search_start.problem
    fed = [_search_fed(problem, search_start, say, share, forbidden)]
    other = _fed_otherwise(fed[0])
    if other is not fed[0]:  # with it, other effects may do better
        again = _search_fed(other.problem, search_start, say, share, forbidden)
        fed = [other, again]
    return min(fed, key=lambda one: one.accepted.sse)


def _search_fed(
    problem: Problem,
    search_start: SearchStart,
    say: Progress,
    share: float,
    forbidden: Sequence[str],
) -> SearchState:
    null, sigma = search_start.null, search_start.sigma
    light = search_start.with_problem(problem.with_fewer_rows(TUNING.search_rows))
    found = search(light.problem, sigma, light.null, say, share, forbidden)
    say("fitting all samples", 0.86)
    final = found.accepted
    final = problem.refit_closely(final.effects, sigma) if final.effects else null
    return replace(found, problem=problem, null=null, accepted=final)


def _fed_otherwise(found: SearchState) -> SearchState:
    """Return the search's result with its lags and modes fed by steps in place of straight lines,
    or the reverse, if that leaves less. A hold is half a sample ahead of straight lines, and a
    delay that was found has compensated for that. Straight lines also cut off the peaks of a smooth
    drive, and a hold with another delay cuts off less: the drive's smooth path is tried as well."""
    problem, sigma, effects = found.problem, found.sigma, found.accepted.effects
    if problem.data.early or all(e.candidate.mode == "columns" for e in effects):
        return found
    stepped = not problem.data.stepped
    ahead_s = 0.5 * problem.data.period * (1.0 if stepped else -1.0)
    other = problem.with_zero_order_hold(stepped)
    moved = [replace(e, theta=e.candidate.after(ahead_s, e.theta)) for e in effects]
    fit = other.refit_closely(moved, sigma)
    held = _with_hold(problem.data, moved) if stepped else []
    if held:
        late = other.refit_closely(held, sigma)
        least = min(misfit_beyond_noise(problem, one, sigma) for one in (found.accepted, fit))
        if misfit_beyond_noise(other, late, sigma) < TUNING.quarter * least:
            fit = late
    if fit.sse > found.accepted.sse - TUNING.price * sigma**2:
        return found
    fed = replace(found, problem=other, accepted=fit)
    smooth = with_smooth_path(problem.data, sigma)
    if smooth is problem.data:
        return fed
    through = replace(problem, data=smooth)
    curved = through.refit_closely(effects, sigma)
    return replace(found, problem=through, accepted=curved) if curved.sse < fit.sse else fed


def _with_hold(data: Data, effects: Sequence[Effect]) -> list[Effect]:
    """Return the effects with a delay of one sample in place of the other late ones: a drive whose
    values are held from their sample on is one sample later than one whose values are held up to
    their sample. Empty if nothing else remains, or if a delay was found already."""
    (delay,) = (c for c in list_candidates(data) if c.after(data.period, (0.0,)) != (0.0,))
    on_time = [e for e in effects if not e.candidate.late]
    if not on_time or any(e.candidate.key == delay.key for e in effects):
        return []
    return [*on_time, Effect(delay, (data.period,))]


def _accept(found: SearchState, seen: Effect) -> SearchState:
    """Return the search's result with a directly seen effect in its model, where that predicts
    held-out samples no worse; else unchanged."""
    problem, final = found.problem, found.accepted
    if seen.candidate.key in final.effect_keys:
        return found
    fit = problem.solve([*final.effects, seen], problem.output_of(final))
    if blockwise_held_out_error(problem, fit) > blockwise_held_out_error(problem, final):
        return found
    return replace(found, accepted=fit)
