"""Which base the search stands on, and at which noise: rich, or compact where little was recorded;
on the identified model where that alone predicts better; earlier where the recorder holds each
command or is a row off."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dehyst.models.diagnosis.base import compact_base, no_base, rich_base
from dehyst.models.diagnosis.data.noise import noise_rms
from dehyst.models.diagnosis.evidence import by_blocks
from dehyst.models.diagnosis.findings.reported import only_reported, worth_reporting
from dehyst.models.diagnosis.fit import Problem
from dehyst.models.diagnosis.joint_fit import JointFit
from dehyst.models.diagnosis.judge import (
    SearchState,
    base_error,
    excess,
    tells_what_is_late,
    tried,
)
from dehyst.models.diagnosis.screen import Screen
from dehyst.models.diagnosis.search import search
from dehyst.models.diagnosis.tuning import TUNING
from dehyst.models.physics import list_candidates
from dehyst.models.physics.candidate import small
from dehyst.models.signals.joined import Data

Progress = Callable[[str, float], None]
FED = ("resonance", "lag-sensor")  # what shows how it is fed


@dataclass(frozen=True)
class SearchResult:
    """The search's result, and the same over the rich base."""

    search: SearchState
    over_rich: SearchState


def find(
    problem: Problem, sigma: float, null: JointFit, say: Progress, forbidden: Sequence[str] = ()
) -> SearchResult:
    """The effects over the rich base, or over a compact one where the rich one is too rich for what
    was recorded. Where an effect is taken whose size is not known then, they are looked for again
    without it: what it stood for may be another's. forbidden: keys that are not tried."""
    found = _find(problem, sigma, null, say, forbidden)
    kept = worth_reporting(found.search)
    reported = only_reported(kept)
    vague = set(kept.accepted.effect_names) - set(reported.accepted.effect_names)
    if vague:
        other = _find(problem, sigma, null, say, (*forbidden, *vague))
        again = only_reported(worth_reporting(other.search))
        first, second = (by_blocks(f.problem, f.accepted).mean_square for f in (reported, again))
        if second < first:
            found, reported = other, again
    if found.over_rich is found.search:
        return SearchResult(reported, reported)
    return SearchResult(reported, only_reported(worth_reporting(found.over_rich)))


def _find(
    problem: Problem, sigma: float, null: JointFit, say: Progress, forbidden: Sequence[str]
) -> SearchResult:
    if problem.few_places:
        return _find_in_few_places(problem, sigma, null, say, forbidden)
    found = over_rich = _search(problem, sigma, null, say, forbidden)
    in_sample = null.sse / int(problem.data.rows.sum())
    if by_blocks(problem, null).mean_square > TUNING.compact_doubt**2 * in_sample:
        plain = replace(problem, base=compact_base(problem.data))
        alone = plain.solve([])
        other = _search(plain, sigma, alone, say, forbidden, share=TUNING.compact_share)
        rich_error = by_blocks(problem, found.accepted).mean_square
        if by_blocks(plain, other.accepted).mean_square < rich_error:
            found = other
    return SearchResult(found, over_rich)


def _find_in_few_places(
    problem: Problem, sigma: float, null: JointFit, say: Progress, forbidden: Sequence[str]
) -> SearchResult:
    """The same where the drive repeats itself within so few samples that a rich base can give each
    its own value, and takes all that the drive causes within a period. What comes late is reported
    over a compact base alone, and only where it takes by far the most of what this leaves: a loop
    of another class leaves less."""
    within = [c for c in list_candidates(problem.data) if c.driven and not c.lasting]
    unseen = [c.key for c in within if not c.late]
    keys = [c.key for c in within]
    over_rich = _search(problem, sigma, null, say, (*forbidden, *keys))
    subject = problem.subject
    own = replace(subject, carries=subject.given and subject.carries)  # one that an effect may have
    # distorted is no help where nothing mends it
    plain = replace(problem, base=compact_base(problem.data), subject=own)
    alone, share = plain.solve([]), TUNING.few_places_share
    other = _search(plain, sigma, alone, say, (*forbidden, *unseen), share)
    caused = any(e.candidate.late for e in other.accepted.effects)
    return SearchResult(
        other if caused and tells_what_is_late(problem, sigma) else over_rich, over_rich
    )


def find_above_noise(
    problem: Problem, null: JointFit, say: Progress, forbidden: Sequence[str] = ()
) -> SearchResult:
    """The same with the noise of what it leaves: where the drive fills the band, what an effect
    leaves in it stands for noise until the effect is known."""
    sigma = noise_rms(problem.data, null.residual(problem.data))
    found = find(problem, sigma, null, say, forbidden)
    left = noise_rms(problem.data, found.search.accepted.residual(problem.data))
    if left > TUNING.noise_again * sigma:
        return found
    again = find(problem, left, null, say, forbidden)
    first, second = (by_blocks(f.search.problem, f.search.accepted) for f in (found, again))
    if second.mean_square < first.mean_square - (TUNING.helps * left) ** 2:
        return again
    return SearchResult(replace(found.search, sigma=left), replace(found.over_rich, sigma=left))


def on_the_model(problem: Problem, null: JointFit) -> Problem:
    """The problem with the model in use under the base, or without it, whichever predicts better.

    An identified model comes under the base where it alone predicts better than the base does:
    then no effect has distorted it, and the base need not find it again. A given one is taken away
    where the base without it predicts much better: an effect has distorted it so that the base
    cannot mend it. (Creep makes a recording that begins at rest look as if the stage had been moved
    before.) Not where it has blocks: they would be found as if they were news.
    """
    subject, over_base = problem.subject, by_blocks(problem, null).mean_square
    if subject.carries:
        if subject.model.blocks:
            return problem
        freed = replace(problem, subject=replace(subject, carries=False))
        without = by_blocks(freed, freed.solve([])).mean_square
        return freed if without < TUNING.distorted * over_base else problem
    data = problem.data
    carried = replace(problem, subject=replace(subject, carries=True))
    alone = replace(carried, base=no_base(data)).solve([]).sse / int(data.rows.sum())
    return carried if alone < over_base else problem


def on_the_other(problem: Problem, found: SearchState) -> Problem:
    """The problem without the model in use where it was under the base, or with it where it was
    not, if that predicts much better with what was found: an effect that is large beside what the
    base does decides what `on_the_model` looks at."""
    subject = problem.subject
    if not found.accepted.effects or (subject.carries and subject.model.blocks):
        return problem
    other = replace(problem, subject=replace(subject, carries=not subject.carries))
    fit = other.refit(found.accepted.effects)
    now = by_blocks(found.problem, found.accepted).mean_square
    return other if by_blocks(other, fit).mean_square < TUNING.distorted * now else problem


def earlier_drive(problem: Problem, null: JointFit, sigma: float) -> Problem | None:
    """The problem with the drive half a sample or a whole one earlier, where that explains much of
    the misfit; a whole one where it explains all of it, because loops that narrow with the rate
    look early, too. None where a drive one sample later explains as much: something is late.

    Nothing physical leads the drive. A recorder that holds each command and reads at the end of the
    sample does by half a sample, against the straight lines between samples that all models here
    assume; one that writes a reading into the row before does by a whole one.
    """
    found, left = None, excess(problem, null, sigma)
    for samples in (0.5, 1.0):
        data = _with_drive_moved(problem.data, samples)
        moved = replace(problem, data=data, base=rich_base(data))
        leaves = _left_by_base(moved, sigma)
        nothing = max(TUNING.structure_left * sigma, base_error(data)) ** 2
        if samples == 1.0 and leaves > nothing:
            break
        if left - leaves >= max(TUNING.early_share * left, (TUNING.early_size * sigma) ** 2):
            found, left = moved, leaves
    if found is None:
        return None
    late = _with_drive_moved(problem.data, -1.0)
    return found if _left_by_base(replace(found, data=late), sigma) > left else None


def _with_drive_moved(data: Data, samples: float) -> Data:
    """The drive so many samples earlier: a part of one along the way to it, or whole rows."""
    if samples == 0.5:
        u = data.u + 0.5 * np.where(data.starts, 0.0, np.diff(data.u, prepend=0.0))
        return replace(data, u=u, early=samples)
    at = np.clip(np.arange(data.n) + int(samples), 0, data.n - 1)
    at = np.where(data.part[at] == data.part, at, np.arange(data.n))
    return replace(data, u=data.u[at], early=samples)


def _left_by_base(problem: Problem, sigma: float) -> float:
    """Mean square beyond the noise that a loop of any shape leaves."""
    light = problem.light(TUNING.search_rows)
    return excess(light, light.solve([]), sigma)


def fed_by_steps(problem: Problem, null: JointFit, sigma: float) -> Problem:
    """The problem with lags and modes fed by steps, where one of them leaves much less so.

    A loop writes a command and leaves it: where the hysteresis alone is between the drive and what
    is read just before the next command, nothing shows of it; what is behind it begins half a
    sample earlier than straight lines between the samples say. Fitted to these, a mode leaves as
    much again as its own share, and friction is reported beside it.
    """
    if problem.data.early or excess(problem, null, sigma) < (TUNING.stepped_size * sigma) ** 2:
        return problem
    light = problem.light(TUNING.limit_rows)
    start = light.solve([])
    straight, steps = (_least_left(one, start, sigma) for one in (light, light.with_steps()))
    least = max(TUNING.stepped_share * straight, (TUNING.stepped_size * sigma) ** 2)
    return problem.with_steps() if straight - steps > least else problem


def _least_left(problem: Problem, start: JointFit, sigma: float) -> float:
    """Mean square beyond the noise that the best lag or mode alone leaves. A mode that rings
    through a recording is none of the stage's: so a line of the surroundings is copied."""
    shortest_s = float((np.bincount(problem.data.rec) * problem.data.period).min())
    look, left = Screen(problem, start), [excess(problem, start, sigma)]
    for candidate in (c for c in list_candidates(problem.data) if c.key in FED):
        ranked = look.starts(candidate)
        if ranked and ranked[0][0] > 0:
            trial = tried(problem, sigma, start, candidate, ranked[0][1])
            theta = trial.fit.effects[-1].theta
            if candidate.key == "resonance" and not _fades(theta, shortest_s):
                continue
            left.append(excess(problem, trial.fit, sigma))
    return min(left)


def _fades(theta: Sequence[float], recording_s: float) -> bool:
    """Whether a mode's free oscillation is gone long before a recording ends. theta: Hz, damping
    ratio, ..."""
    return bool(2 * np.pi * theta[0] * theta[1] * TUNING.stepped_fades * recording_s > 1.0)


def _search(
    problem: Problem,
    sigma: float,
    null: JointFit,
    say: Progress,
    forbidden: Sequence[str],
    share: float = TUNING.driven_share,
) -> SearchState:
    """The search on a part of the rows, its result fitted to all of them."""
    light = problem.light(TUNING.search_rows)
    start = null if light is problem else light.solve([])
    found = search(light, sigma, start, say, share, forbidden)
    say("fitting all samples", 0.86)
    final = found.accepted
    final = problem.refit(final.effects, rounds=8, settle=0.3 * sigma**2) if final.effects else null
    return replace(found, problem=problem, null=null, accepted=final)


def of_another_stage(bare: Problem, null: JointFit, sigma: float) -> str:
    """What is to be said of a given model that is far off these recordings; "" where it is not."""
    if not bare.subject.given:
        return ""
    n = int(bare.data.rows.sum())
    left = float(np.sqrt(bare.solve([]).sse / n))
    best = max(float(np.sqrt(null.sse / n)), sigma)
    stroke = float(np.ptp(bare.data.y))
    if left < max(TUNING.foreign_share * stroke, TUNING.foreign_times * best):
        return ""
    unit = bare.data.unit
    return (
        f"the model does not fit this stage in its present state: it leaves {small((left, unit))} "
        f"rms of a stroke of {stroke:.3g} {unit}, where a hysteresis fitted here leaves "
        f"{small((best, unit))}; identify a model from these recordings"
    )
