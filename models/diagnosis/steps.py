"""The diagnosis from recordings to verdict. See the steps in the package's text."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dehyst.models.diagnosis.augment import augmented
from dehyst.models.diagnosis.base import compact_base, no_base, rich_base
from dehyst.models.diagnosis.colour import is_coloured
from dehyst.models.diagnosis.decide import (
    in_rank,
    named,
    next_experiment,
    shared_out,
    unknown,
    verdict_of,
)
from dehyst.models.diagnosis.episodes import Episode, find_episodes, tell_time
from dehyst.models.diagnosis.evidence import by_blocks
from dehyst.models.diagnosis.excerpt import excerpt
from dehyst.models.diagnosis.fit import JointFit, Problem
from dehyst.models.diagnosis.judge import CandidateTrial, SearchState, base_error, excess
from dehyst.models.diagnosis.limits import limits
from dehyst.models.diagnosis.locate import hot_spots, locate
from dehyst.models.diagnosis.noise import noise_rms
from dehyst.models.diagnosis.prepare import prepare
from dehyst.models.diagnosis.result import Diagnosis, Finding, View
from dehyst.models.diagnosis.search import search
from dehyst.models.diagnosis.shape import Correction, measure_correction, shape_finding
from dehyst.models.diagnosis.sightings import accept, retell, sightings
from dehyst.models.diagnosis.subject import Subject, identify_plain, take_model
from dehyst.models.diagnosis.survey import BUTTERFLY, comes_back, follows, left_of, survey
from dehyst.models.diagnosis.told import only_told, without_driven, worth_telling
from dehyst.models.diagnosis.tuning import TUNING
from dehyst.models.model import Model
from dehyst.models.physics.candidate import small
from dehyst.models.recording import Recording
from dehyst.models.signals.joined import Data, Floats

Progress = Callable[[str, float], None]


def diagnose(
    recordings: Sequence[Recording],
    model: Model | None = None,
    progress: Progress | None = None,
    several: Callable[..., Iterable[Any]] = map,
) -> Diagnosis:
    """Find the physics that the model in use leaves out.

    recordings: of one stage, with displacement. model: the model in use; None: the plain modified
    Prandtl-Ishlinskii model is identified here. progress(text, fraction) is called now and then.
    several: how candidates are tried: `map`, or the map of a pool of threads, of which each needs a
    design of all samples. Raises BadRecording where the recordings cannot be diagnosed, BadInput
    where the model cannot be run on them.
    """
    say = progress or (lambda text, fraction: None)
    say("preparing", 0.0)
    whole = prepare(recordings)
    say("the model in use", 0.02)
    data = excerpt(whole)
    subject = identify_plain(recordings, data) if model is None else take_model(model, data)
    problem = Problem(data, rich_base(data), subject, several)
    null = problem.solve([])
    sigma = noise_rms(data, null.residual(data))
    bare = Problem(data, no_base(data), replace(subject, carries=True), several)
    foreign = of_another_stage(bare, null, sigma)
    if foreign:
        say(foreign, 0.1)
    say("base fitted", 0.1)
    early = held_drive(problem, null, sigma)
    if early is not None:
        data, problem, null = early.data, early, early.solve([])
    other = on_the_model(problem, null)
    if other is not problem:
        problem, null = other, other.solve([])
    found = find_above_noise(problem, null, say)
    sigma = found.search.sigma
    unexplained = by_blocks(problem, null).mean_square
    explained = by_blocks(found.search.problem, found.search.accepted).mean_square
    butterfly = comes_back(data) and explained > TUNING.follows_late * unexplained
    if butterfly or not follows(data, min(unexplained, explained)):
        # out of the class: what the drive causes cannot be told from the loop
        found = replace(found, search=without_driven(found.search))
    seen = sightings(data, sigma)
    for candidate, sighting in seen:
        other = accept(found.over_rich, candidate, sighting)
        if candidate.key in other.accepted.effect_names:
            found = replace(found, search=other)
    shown = bool({c.key for c, _ in seen} & set(found.search.accepted.effect_names))
    warnings = [text for text in (foreign, BUTTERFLY if butterfly else "") if text]
    diagnosis = _conclude(whole, bare, found.search, warnings, shown, say)
    for candidate, sighting in seen:
        findings = retell(diagnosis.findings, candidate, sighting)
        diagnosis = replace(diagnosis, findings=findings)
    return diagnosis


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
        f"the model is not of this stage, or of another state of it: it leaves "
        f"{small((left, unit))} rms of a stroke of {stroke:.3g} {unit}, where a hysteresis fitted "
        f"here leaves {small((best, unit))}; identify a model from these recordings"
    )


@dataclass(frozen=True)
class Found:
    """The search's result, and the same over the rich base."""

    search: SearchState
    over_rich: SearchState


def find(problem: Problem, sigma: float, null: JointFit, say: Progress) -> Found:
    """The effects over the rich base, or over a compact one where the rich one is too rich for what
    was recorded."""
    found = over_rich = _search(problem, sigma, null, say)
    in_sample = null.sse / int(problem.data.rows.sum())
    if by_blocks(problem, null).mean_square > TUNING.compact_doubt**2 * in_sample:
        plain = replace(problem, base=compact_base(problem.data))
        other = _search(plain, sigma, plain.solve([]), say, share=TUNING.compact_share)
        rich_error = by_blocks(problem, found.accepted).mean_square
        if by_blocks(plain, other.accepted).mean_square < rich_error:
            found = other
    told = only_told(worth_telling(found))
    return Found(told, told if found is over_rich else only_told(worth_telling(over_rich)))


def find_above_noise(problem: Problem, null: JointFit, say: Progress) -> Found:
    """The same with the noise of what it leaves: where the drive fills the band, what an effect
    leaves in it stands for noise until the effect is known."""
    sigma = noise_rms(problem.data, null.residual(problem.data))
    found = find(problem, sigma, null, say)
    left = noise_rms(problem.data, found.search.accepted.residual(problem.data))
    if left > TUNING.noise_again * sigma:
        return found
    again = find(problem, left, null, say)
    first, second = (by_blocks(f.search.problem, f.search.accepted) for f in (found, again))
    if second.mean_square < first.mean_square - (TUNING.helps * left) ** 2:
        return again
    return Found(replace(found.search, sigma=left), replace(found.over_rich, sigma=left))


def on_the_model(problem: Problem, null: JointFit) -> Problem:
    """The problem with the identified model under the base, where that alone foretells better than
    the base does: then no effect has distorted it, and the base need not find it again."""
    if problem.subject.carries:
        return problem
    data = problem.data
    carried = replace(problem, subject=replace(problem.subject, carries=True))
    alone = replace(carried, base=no_base(data)).solve([]).sse / int(data.rows.sum())
    return carried if alone < by_blocks(problem, null).mean_square else problem


def held_drive(problem: Problem, null: JointFit, sigma: float) -> Problem | None:
    """The problem with the drive half a sample earlier, where that explains much of the misfit.

    Nothing physical leads the drive: a recorder that holds each command and reads at the end of
    the sample does, against the straight lines between samples that all models here assume.
    """
    data = problem.data
    step = np.diff(data.u, prepend=data.u[0])
    step[data.starts] = 0.0
    shifted = replace(data, u=data.u + 0.5 * step, early=True)
    whole = replace(problem, data=shifted, base=rich_base(shifted))
    light = whole.light(TUNING.search_rows)
    fit = light.solve([])
    before = excess(problem, null, sigma)
    fall = before - excess(light, fit, sigma)
    if fall < max(TUNING.early_share * before, (TUNING.early_size * sigma) ** 2):
        return None
    return whole


def _search(
    problem: Problem,
    sigma: float,
    null: JointFit,
    say: Progress,
    share: float = TUNING.driven_share,
) -> SearchState:
    """The search on a part of the rows, its result fitted to all of them."""
    light = problem.light(TUNING.search_rows)
    found = search(light, sigma, null if light is problem else light.solve([]), say, share)
    say("fitting all samples", 0.86)
    final = found.accepted
    final = problem.refit(final.effects, rounds=8, settle=0.3 * sigma**2) if final.effects else null
    return replace(found, problem=problem, null=null, accepted=final)


@dataclass(frozen=True)
class Weighed:
    """What is concluded: findings with shares, what was fitted, and mean squares on held-out
    samples (all of the model in use: it was not fitted here)."""

    findings: tuple[Finding, ...]
    problem: Problem
    final: JointFit
    bare: float
    held: float


def weigh(bare: Problem, found: SearchState, shown: bool) -> Weighed:
    """What helps against the model in use, on held-out samples; nothing where it all does not,
    unless a recording shows an effect directly."""
    data, sigma = bare.data, found.sigma
    alone = bare.solve([])
    first = alone.sse / int(data.rows.sum())
    held = by_blocks(found.problem, found.accepted).mean_square
    nothing = Weighed((), bare, alone, first, first)
    if held > first - (TUNING.helps * sigma) ** 2 and not shown:
        return nothing
    correction = measure_correction(found.problem, found.accepted, first, held)
    shape = _has_shape(correction, first, sigma)
    findings = named(found.problem, found, held) if found.accepted.effects else []
    if not findings and not shape:
        return nothing
    if shape:
        findings.append(
            shape_finding(found.problem, found.accepted, sigma, correction, correction.gain)
        )
    removed = float(np.clip((first - held) / max(first - sigma**2, 1e-300), 0.0, 1.0))
    told = tuple(shared_out(findings, removed))
    return Weighed(told, found.problem, found.accepted, first, held)


def with_episode(
    findings: Sequence[Finding], episode: Episode, weighed: Weighed, sigma: float
) -> list[Finding]:
    """Findings with one that is there for a part of the time."""
    explainable = max(weighed.bare - sigma**2, 1e-300)
    taken = sum(f.share for f in findings)
    share = min(episode.finding.share / explainable, 1.0 - taken)
    return in_rank([*findings, replace(episode.finding, share=share)])


def _has_shape(correction: Correction, first: float, sigma: float) -> bool:
    least = max((TUNING.shape_size * sigma) ** 2, TUNING.shape_share * (first - sigma**2))
    return correction.gain > least


def _conclude(
    recorded: Data,
    bare: Problem,
    found: SearchState,
    warnings: list[str],
    shown: bool,
    say: Progress,
) -> Diagnosis:
    """recorded: all samples; bare, found: of those that were fitted; shown: a recording shows an
    effect directly, beside any fit."""
    sigma, subject = found.sigma, bare.subject
    say("holding out", 0.88)
    weighed = weigh(bare, found, shown)
    problem, final, findings = weighed.problem, weighed.final, list(weighed.findings)
    say("intervals and rivals", 0.92)
    data = problem.data
    residual = final.residual(data)
    at_first = float(np.sqrt(max(weighed.bare - sigma**2, 0.0)))
    left = float(np.sqrt(excess(problem, final, sigma)))
    whole_noise = sigma
    episode = find_episodes(data, residual, sigma)
    if episode is not None:
        residual = residual - episode.removed
        findings = with_episode(findings, episode, weighed, sigma)
        n = int(data.rows.sum())
        left = float(np.sqrt(max(np.sum(residual[data.rows] ** 2) / n - sigma**2, 0.0)))
    if left > TUNING.structure_left * sigma and is_coloured(data, residual, sigma):
        # all that is left is noise
        whole_noise = float(np.sqrt(np.mean(residual[data.rows] ** 2)))
        at_first = float(np.sqrt(max(weighed.bare - whole_noise**2, 0.0)))
        left = 0.0
    unexplained = by_blocks(found.problem, found.null).mean_square
    beside = float(np.sqrt(excess(found.problem, found.null, sigma)))
    floor = max(whole_noise, base_error(data) / TUNING.structure_left)
    verdict = verdict_of(findings, left, at_first, beside, floor)
    unexplained = min(unexplained, by_blocks(found.problem, found.accepted).mean_square)
    if not follows(data, unexplained) and not shown:
        findings, verdict = [f for f in findings if f.name != "shape"], "unknown"
    if verdict in ("unknown", "partly"):
        where: dict[str, Any] = dict(hot_spots(locate(data, residual, sigma)))
        when, times = tell_time(data, residual, sigma)
        share = max(0.0, 1.0 - sum(f.share for f in findings))
        rest = unknown(left, min(share, 1.0), where, data.unit, when)
        findings = [*findings, replace(rest, where={**where, **times})]
    say("limits", 0.96)
    untold = {n for f in findings for n in (f.name, *f.ambiguous_with)}
    limited = tuple(limits(found, untold)) if verdict in ("clean", "explained") else ()
    whole = augmented(problem, final)
    views = tuple(_views(recorded, subject, whole))
    heldout = max(weighed.held, 0.0)
    rms: dict[str, Any] = {
        "model": {v.name: _rms((v.displacement - v.base)[v.held_out]) for v in views},
        "augmented": {v.name: _rms((v.displacement - v.augmented)[v.held_out]) for v in views},
        "heldout_model": float(np.sqrt(weighed.bare)),
        "heldout_augmented": float(np.sqrt(heldout)),
    }
    quality = survey(recorded, data, (sigma, whole_noise), unexplained, warnings)
    say("done", 1.0)
    return Diagnosis(
        verdict=verdict,
        data=quality,
        noise=whole_noise,
        unit=data.unit,
        drive_unit=data.drive_unit,
        findings=tuple(findings),
        would_have_seen=limited,
        rms=rms,
        next_experiment=next_experiment(
            verdict, findings, sorted({x.name for x in limited if x.value is None})
        ),
        model=whole,
        base_model=subject.model,
        views=views,
        locate=locate(recorded, left_of(recorded, subject.whole(recorded)), sigma),
        tried=tuple(_tried(found.counted, found)),
    )


def _tried(n: int, found: SearchState) -> list[dict[str, str]]:
    """For each round: root mean square that each candidate's refit removes."""
    return [{t.candidate.key: _told(t, n) for t in trials} for trials in found.rounds]


def _told(t: CandidateTrial, n: int) -> str:
    text = f"{float(np.sqrt(max(t.gain, 0.0) / n)):.4g}"
    if t.constancy is not None:
        by = " ".join(f"{a:.2f}" for a in t.constancy.by_recording)
        text += f" spread {t.constancy.spread:.2f} wrong {t.constancy.wrong:.2f} [{by}]"
    return text + (f" ({t.refused})" if t.refused else "")


def _views(data: Data, subject: Subject, whole: Model) -> list[View]:
    """Each recording with what both models, simulated, say of it."""
    base = data.y - left_of(data, subject.whole(data))
    full = data.y - left_of(data, replace(subject, model=whole).whole(data))
    out = []
    for i, name in enumerate(data.names):
        k = (data.rec == i) & (data.raw_index >= 0)
        out.append(View(name, data.t[k], data.u[k], data.y[k], base[k], full[k], data.rows[k]))
    return out


def _rms(x: Floats) -> float:
    return float(np.sqrt(np.mean(x**2))) if x.size else 0.0
