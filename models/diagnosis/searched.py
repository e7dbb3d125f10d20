"""Find the effects: Based -> Searched. The search uses a rich base, or a compact one where little
was recorded, and estimates the noise from its own residual."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from dehyst.models.diagnosis.base import compact_base
from dehyst.models.diagnosis.based import Based, Footing, Progress
from dehyst.models.diagnosis.data.noise import noise_rms
from dehyst.models.diagnosis.data.survey import BUTTERFLY, FEW_PLACES, comes_back, follows
from dehyst.models.diagnosis.effects import Effect
from dehyst.models.diagnosis.evidence import by_blocks
from dehyst.models.diagnosis.findings.episodes import Episode
from dehyst.models.diagnosis.findings.reported import only_reported, without_kind, worth_reporting
from dehyst.models.diagnosis.fit import Problem
from dehyst.models.diagnosis.judge import SearchState, tells_what_is_late
from dehyst.models.diagnosis.pasts import explained_heads, rows_with_heads
from dehyst.models.diagnosis.search import search
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
    """What was found. whole, bare: as in Based, with those heads of recordings that are explained;
    found: effects other than the episode; seen: what recordings show directly, without a fit;
    shown: keys of the accepted effects that were also seen; warnings: warnings about the data,
    which are reported first."""

    whole: Data
    bare: Problem
    found: SearchState
    episode: Episode | None
    seen: tuple[tuple[Candidate, Sighting], ...]
    shown: frozenset[str]
    warnings: tuple[str, ...]


def look_for_causes(based: Based, say: Progress) -> Searched:
    """Find the effects: by the search, and as recordings show them directly."""
    result, heads = _search_with_heads(based, say)
    whole, alone = (
        replace(one, rows=rows_with_heads(one, heads)) for one in (based.whole, based.bare.data)
    )
    found, rich = result.search, result.over_rich
    data = rich.problem.data
    unexplained = by_blocks(rich.problem, rich.null)
    explained = by_blocks(found.problem, found.accepted)
    butterfly = comes_back(data) and explained > TUNING.minor * unexplained
    if butterfly or not follows(data, min(unexplained, explained)):
        # outside the model class: what the drive causes cannot be distinguished from the loop
        found = without_kind(found, lambda c: c.driven)
    seen = [(c, c.seen(data, found.sigma)) for c in list_candidates(data)]
    sightings = tuple((c, one) for c, one in seen if one is not None)
    for candidate, one in sightings:
        other = _accept(rich, Effect(candidate, one.theta))
        if candidate.key in other.accepted.effect_names:
            found = other
    few = "" if tells_what_is_late(rich.problem, found.sigma) else FEW_PLACES
    shown = frozenset(c.key for c, _ in sightings) & set(found.accepted.effect_names)
    warnings = tuple(x for x in (based.foreign, BUTTERFLY if butterfly else "", few) if x)
    bare = replace(based.bare, data=alone)
    return Searched(whole, bare, found, based.episode, sightings, shown, warnings)


def _search_with_heads(based: Based, say: Progress) -> tuple[SearchResult, list[int]]:
    """Return the search's result, and the recordings whose heads count in it. Once the first
    effects are known, so is the past, and the heads show what began before the recording. The
    effects are found from the other rows, because in the heads the past of the hysteresis shows as
    well."""
    plain = find_above_noise(based.footing, say)
    stands = based.footing.on(on_the_other(based.footing.problem, plain.search))
    if stands is not based.footing:
        plain = find_above_noise(stands, say)
    first, data = plain.search, stands.problem.data
    heads = explained_heads(first.problem, first.accepted, first.sigma)
    if not heads:
        return plain, heads
    longer = replace(data, rows=rows_with_heads(data, heads))
    stands = stands.on(replace(stands.problem, data=longer))
    found = find_above_noise(stands, say, first.passed_over)
    # candidates that were passed over in a near-tie stay rivals
    rounds = (*found.search.rounds, *(first.rounds if first.passed_over else ()))
    return replace(found, search=replace(found.search, rounds=rounds)), heads


def on_the_other(problem: Problem, found: SearchState) -> Problem:
    """Return the problem with the model in use removed from under the base, or added where it was
    not, if that predicts much better with the effects found: a large effect dominates the errors
    that `on_the_model` compares."""
    subject = problem.subject
    if not found.accepted.effects or (subject.carries and subject.model.blocks):
        return problem
    other = replace(problem, subject=replace(subject, carries=not subject.carries))
    fit = other.refit(found.accepted.effects)
    now = by_blocks(found.problem, found.accepted)
    return other if by_blocks(other, fit) < TUNING.most * now else problem


def find_above_noise(stands: Footing, say: Progress, forbidden: Sequence[str] = ()) -> SearchResult:
    """Find the effects, with the noise estimated from what they leave: where the drive fills the
    band, an effect's contribution counts as noise until the effect is known. forbidden: keys that
    are not tried."""
    stands = stands.at_own_noise()
    found = _find_known(stands, say, forbidden)
    data = stands.problem.data
    left = noise_rms(data, found.search.accepted.residual(data))
    if left > TUNING.most * stands.sigma:
        return found
    again = _find_known(replace(stands, sigma=left), say, forbidden)
    first, second = (by_blocks(f.search.problem, f.search.accepted) for f in (found, again))
    if second < first - (TUNING.trace * left) ** 2:
        return again
    return SearchResult(replace(found.search, sigma=left), replace(found.over_rich, sigma=left))


def _find_known(stands: Footing, say: Progress, forbidden: Sequence[str]) -> SearchResult:
    """Find the effects whose size is known. Where the search accepts one whose size is not, search
    again without it: another effect may account for the same misfit."""
    found = _find(stands, say, forbidden)
    kept = worth_reporting(found.search)
    reported = only_reported(kept)
    vague = set(kept.accepted.effect_names) - set(reported.accepted.effect_names)
    if vague:
        other = _find(stands, say, (*forbidden, *vague))
        again = only_reported(worth_reporting(other.search))
        first, second = (by_blocks(f.problem, f.accepted) for f in (reported, again))
        if second < first:
            found, reported = other, again
    if found.over_rich is found.search:
        return SearchResult(reported, reported)
    return SearchResult(reported, only_reported(worth_reporting(found.over_rich)))


def _find(stands: Footing, say: Progress, forbidden: Sequence[str]) -> SearchResult:
    """Find the effects with the rich base, or with a compact one where the rich one has too many
    columns for what was recorded."""
    problem, null = stands.problem, stands.null
    if problem.few_places:
        return _find_in_few_places(stands, say, forbidden)
    found = over_rich = _search(stands, say, forbidden)
    in_sample = null.sse / int(problem.data.rows.sum())
    if by_blocks(problem, null) > TUNING.near**2 * in_sample:
        plain = stands.on(replace(problem, base=compact_base(problem.data)))
        other = _search(plain, say, forbidden, share=TUNING.quarter)
        if by_blocks(other.problem, other.accepted) < by_blocks(problem, found.accepted):
            found = other
    return SearchResult(found, over_rich)


def _find_in_few_places(stands: Footing, say: Progress, forbidden: Sequence[str]) -> SearchResult:
    """Find the effects where the drive repeats itself within so few samples that a rich base can
    fit each sample, and absorbs all that the drive causes within a period. Late effects (delay,
    lag) are reported from a fit with a compact base alone, and only where they remove by far the
    most of what this base leaves: a loop of another class removes less."""
    problem, subject = stands.problem, stands.problem.subject
    within = [c for c in list_candidates(problem.data) if c.driven and not c.lasting]
    unseen = [c.key for c in within if not c.late]
    over_rich = _search(stands, say, (*forbidden, *(c.key for c in within)))
    own = replace(subject, carries=subject.given and subject.carries)  # a model that an effect may
    # have distorted does not help if nothing corrects it
    plain = stands.on(replace(problem, base=compact_base(problem.data), subject=own))
    other = _search(plain, say, (*forbidden, *unseen), TUNING.most)
    caused = any(e.candidate.late for e in other.accepted.effects)
    told = caused and tells_what_is_late(problem, stands.sigma)
    return SearchResult(other if told else over_rich, over_rich)


def _search(
    stands: Footing, say: Progress, forbidden: Sequence[str], share: float = TUNING.minor
) -> SearchState:
    """Search on a subset of the rows and fit the result to all of them."""
    problem, null, sigma = stands.problem, stands.null, stands.sigma
    light = stands.on(problem.light(TUNING.search_rows))
    found = search(light.problem, sigma, light.null, say, share, forbidden)
    say("fitting all samples", 0.86)
    final = found.accepted
    final = problem.refit(final.effects, rounds=8, settle=0.3 * sigma**2) if final.effects else null
    return replace(found, problem=problem, null=null, accepted=final)


def _accept(found: SearchState, seen: Effect) -> SearchState:
    """Return the search's result with a directly seen effect in its model, where that predicts
    held-out samples no worse; else unchanged."""
    problem, final = found.problem, found.accepted
    if seen.candidate.key in final.effect_names:
        return found
    fit = problem.solve([*final.effects, seen], problem.output_of(final))
    if by_blocks(problem, fit) > by_blocks(problem, final):
        return found
    return replace(found, accepted=fit)
