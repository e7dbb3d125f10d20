"""The diagnosis from recordings to verdict. See the steps in the package's text."""

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from dehyst.models.cascade.history import replay_recording
from dehyst.models.diagnosis.base import no_base, rich_base
from dehyst.models.diagnosis.data.between import with_path_between
from dehyst.models.diagnosis.data.colour import is_coloured
from dehyst.models.diagnosis.data.excerpt import excerpt
from dehyst.models.diagnosis.data.locate import hot_spots, locate
from dehyst.models.diagnosis.data.noise import noise_rms
from dehyst.models.diagnosis.data.prepare import prepare, were_de_energised
from dehyst.models.diagnosis.data.survey import (
    BUTTERFLY,
    FEW_PLACES,
    ONE_SIDE,
    comes_back,
    follows,
    left_of,
    survey,
)
from dehyst.models.diagnosis.evidence import by_blocks
from dehyst.models.diagnosis.find import (
    Progress,
    earlier_drive,
    fed_by_steps,
    find_above_noise,
    of_another_stage,
    on_the_model,
    on_the_other,
)
from dehyst.models.diagnosis.findings.asked_again import AskedAgain
from dehyst.models.diagnosis.findings.decide import (
    next_experiment,
    unknown,
    verdict_of,
)
from dehyst.models.diagnosis.findings.episodes import Episode, find_episodes, tell_time
from dehyst.models.diagnosis.findings.limits import limits
from dehyst.models.diagnosis.findings.reported import without_kind
from dehyst.models.diagnosis.findings.shape import not_contained, not_written
from dehyst.models.diagnosis.findings.sightings import accept, retell, sightings
from dehyst.models.diagnosis.findings.weigh import conclude, with_episode
from dehyst.models.diagnosis.fit import Problem
from dehyst.models.diagnosis.handout import Handed, hand_out
from dehyst.models.diagnosis.judge import (
    CandidateTrial,
    SearchState,
    base_error,
    excess,
    tells_what_is_late,
)
from dehyst.models.diagnosis.left_out import HeldOutErrors
from dehyst.models.diagnosis.pasts import begin_as_found, explained_heads, rows_with_heads
from dehyst.models.diagnosis.result import Diagnosis, FitView
from dehyst.models.diagnosis.subject import identify_plain, take_subject
from dehyst.models.diagnosis.tuning import TUNING
from dehyst.models.model import Model
from dehyst.models.recording import Recording
from dehyst.models.signals.joined import Bools, Data, Floats


def diagnose(
    recordings: Sequence[Recording],
    model: Model | None = None,
    progress: Progress | None = None,
    several: Callable[..., Iterable[Any]] = map,
    with_limits: bool = True,
) -> Diagnosis:
    """Find the physics that the model in use leaves out.

    recordings: of one stage, with displacement. model: the model in use; None: the plain modified
    Prandtl-Ishlinskii model is identified here. progress(text, fraction) is called now and then.
    several: how candidates are tried: `map`, or the map of a pool of threads, of which each needs a
    design of all samples. with_limits: whether to tell what would have been seen, which takes about
    half of the time. Raises BadRecording where the recordings cannot be diagnosed, BadInput where
    the model cannot be run on them.
    """
    say = progress or (lambda text, fraction: None)
    say("preparing", 0.0)
    whole = prepare(recordings, were_de_energised(recordings))
    say("the model in use", 0.02)
    data = begin_as_found(excerpt(whole))
    subject = identify_plain(recordings, data) if model is None else take_subject(model, data)
    problem = Problem(data, rich_base(data), subject, several)
    null = problem.solve([])
    sigma = noise_rms(data, null.residual(data))
    bare = Problem(data, no_base(data), replace(subject, carries=True), several)
    foreign = of_another_stage(bare, null, sigma)
    if foreign:
        say(foreign, 0.1)
    say("base fitted", 0.1)
    early = earlier_drive(problem, null, sigma)
    if early is not None:
        data, problem, null = early.data, early, early.solve([])
    standing = on_the_model(problem, null)
    if standing is not problem:
        problem, null = standing, standing.solve([])
    problem = fed_by_steps(problem, null, sigma)
    finer = with_path_between(problem.data, sigma)
    if finer is not problem.data:
        problem = replace(problem, data=finer)
        null = problem.solve([])
        sigma = noise_rms(finer, null.residual(finer))
    data = problem.data
    # what acts for a part of the time is reported with that time; no other physics explains it
    episode = find_episodes(data, null.residual(data), sigma)
    if episode is not None:
        data = replace(data, y=data.y - episode.removed)
        problem = replace(problem, data=data)
        null = problem.solve([])
    found = find_above_noise(problem, null, say)
    turned = on_the_other(problem, found.search)
    if turned is not problem:
        problem, null = turned, turned.solve([])
        found = find_above_noise(problem, null, say)
    known = explained_heads(found.search.problem, found.search.accepted, found.search.sigma)
    if known:
        # With what was found, the past is known: the heads count, and show what began before. The
        # other rows say what that is: in the heads the hysteresis' past shows as well.
        data = replace(data, rows=rows_with_heads(data, known))
        whole = replace(whole, rows=rows_with_heads(whole, known))
        problem, bare = (
            replace(problem, data=data),
            replace(bare, data=replace(bare.data, rows=data.rows)),
        )
        null = problem.solve([])
        first = found.search
        found = find_above_noise(problem, null, say, first.passed_over)
        if first.passed_over:  # explained no more: a near-tie, and it stays one
            rounds = [*found.search.rounds, *first.rounds]
            found = replace(found, search=replace(found.search, rounds=rounds))
    sigma = found.search.sigma
    unexplained = by_blocks(problem, null).mean_square
    explained = by_blocks(found.search.problem, found.search.accepted).mean_square
    butterfly = comes_back(data) and explained > TUNING.follows_late * unexplained
    if butterfly or not follows(data, min(unexplained, explained)):
        # out of the class: what the drive causes cannot be distinguished from the loop
        found = replace(found, search=without_kind(found.search, lambda c: c.driven))
    seen = sightings(data, sigma)
    for candidate, sighting in seen:
        other = accept(found.over_rich, candidate, sighting)
        if candidate.key in other.accepted.effect_names:
            found = replace(found, search=other)
    shown = {c.key for c, _ in seen} & set(found.search.accepted.effect_names)
    few = "" if tells_what_is_late(problem, sigma) else FEW_PLACES
    warnings = [text for text in (foreign, BUTTERFLY if butterfly else "", few) if text]
    diagnosis = _conclude(
        recordings, whole, bare, found.search, episode, warnings, shown, with_limits, say
    )
    for candidate, sighting in seen:
        findings = retell(diagnosis.findings, candidate, sighting)
        diagnosis = replace(diagnosis, findings=findings)
    return diagnosis


def _conclude(
    recordings: Sequence[Recording],
    recorded: Data,
    bare: Problem,
    found: SearchState,
    episode: Episode | None,
    warnings: list[str],
    shown: Collection[str],
    with_limits: bool,
    say: Progress,
) -> Diagnosis:
    """recorded: all samples; bare, found: of those that were fitted, found without the episode;
    shown: keys of effects that a recording shows directly, beside any fit."""
    sigma, subject = found.sigma, bare.subject
    say("holding out", 0.88)
    weighed = conclude(bare, found, shown, episode)
    problem, final, findings = weighed.problem, weighed.final, list(weighed.findings)
    say("intervals and rivals", 0.92)
    data = problem.data
    residual = final.residual(data)
    at_first = float(np.sqrt(max(weighed.bare - sigma**2, 0.0)))
    left = float(np.sqrt(excess(problem, final, sigma)))
    whole_noise = sigma
    late = find_episodes(data, residual, sigma) if episode is None else None
    if late is not None:
        residual = residual - late.removed
        findings = with_episode(findings, late, weighed, sigma)
        n = int(data.rows.sum())
        left = float(np.sqrt(max(np.sum(residual[data.rows] ** 2) / n - sigma**2, 0.0)))
    grown = any({"from_s", "until_s"} & f.where.keys() for f in findings)
    if left > TUNING.structure_left * sigma and not grown and is_coloured(data, residual, sigma):
        # all that is left is noise
        whole_noise = float(np.sqrt(np.mean(residual[data.rows] ** 2)))
        at_first = float(np.sqrt(max(weighed.bare - whole_noise**2, 0.0)))
        left = 0.0
    unexplained = by_blocks(found.problem, found.null).mean_square
    beside = float(np.sqrt(excess(found.problem, found.null, sigma)))
    floor = max(whole_noise, base_error(data) / TUNING.structure_left)
    verdict = verdict_of(findings, left, at_first, beside, floor)
    if verdict == "partly":
        fewer = _without_the_doubtful(found, left)
        if fewer is not found:
            return _conclude(
                recordings, recorded, bare, fewer, episode, warnings, shown, with_limits, say
            )
    unexplained = min(unexplained, by_blocks(found.problem, found.accepted).mean_square)
    if not follows(data, unexplained) and not shown:
        findings, verdict = [f for f in findings if f.name != "shape"], "unknown"
    bare_left = left_of(recorded, subject.whole(recorded))
    in_use = HeldOutErrors(weighed.bare, weighed.bare, float(np.sqrt(weighed.bare)))
    if BUTTERFLY in warnings:  # nothing that follows it can be inverted
        handed = Handed(subject.model, in_use, in_use)
    else:
        handed = hand_out(recorded, bare, weighed, sigma)
    findings = [
        f if f.name == "shape" or f.key in handed.contains else not_written(f) for f in findings
    ]
    if verdict in ("unknown", "partly"):
        where: dict[str, Any] = dict(hot_spots(locate(data, residual, sigma)))
        when, times = tell_time(data, residual, sigma)
        share = max(0.0, 1.0 - sum(f.share for f in findings))
        rest = unknown(left, min(share, 1.0), where, data.unit, when)
        findings = [*findings, replace(rest, where={**where, **times})]
    if verdict == "explained" and not handed.explains(whole_noise):
        verdict = "partly"
    say("limits", 0.96)
    untold = {n for f in findings for n in (f.name, *f.ambiguous_with)}
    wanted = with_limits and verdict in ("clean", "explained")
    limited = tuple(limits(found, untold, AskedAgain(found).names)) if wanted else ()
    if not handed.contains_shape:
        findings = [not_contained(f) for f in findings]
    views = tuple(_views(recorded, recordings, (subject.model, handed.model)))
    rms: dict[str, Any] = {
        "model": {v.name: _rms((v.displacement - v.base)[v.held_out]) for v in views},
        "augmented": {v.name: _rms((v.displacement - v.augmented)[v.held_out]) for v in views},
        "heldout_model": float(np.sqrt(handed.held_in_use.mean_square)),
        "heldout_augmented": float(np.sqrt(handed.held.mean_square)),
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
        next_experiment=ONE_SIDE
        if BUTTERFLY in warnings
        else next_experiment(
            verdict, findings, sorted({x.name for x in limited if x.value is None})
        ),
        model=handed.model,
        base_model=subject.model,
        views=views,
        locate=locate(recorded, bare_left, sigma),
        tried=tuple(_tried(found.counted, found)),
    )


def _without_the_doubtful(found: SearchState, left: float) -> SearchState:
    """Without what may well be a part of what is left: slow changes, and what began before the
    recording where that takes little. left: rms without a name."""
    fewer = without_kind(found, lambda c: c.slow)
    before, after = (excess(s.problem, s.accepted, s.sigma) for s in (fewer, found))
    if before - after < (TUNING.past_beside * left) ** 2:
        return fewer
    return without_kind(found, lambda c: c.slow and not c.past)


def _tried(n: int, found: SearchState) -> list[dict[str, str]]:
    """For each round: root mean square that each candidate's refit removes."""
    return [{t.candidate.key: _describe_trial(t, n) for t in trials} for trials in found.rounds]


def _describe_trial(t: CandidateTrial, n: int) -> str:
    text = f"{float(np.sqrt(max(t.gain, 0.0) / n)):.4g}"
    if t.constancy is not None:
        by = " ".join(f"{a:.2f}" for a in t.constancy.by_recording)
        text += f" spread {t.constancy.spread:.2f} wrong {t.constancy.wrong:.2f} [{by}]"
    return text + (f" ({t.refused})" if t.refused else "")


def _views(data: Data, recordings: Sequence[Recording], models: Sequence[Model]) -> list[FitView]:
    """Each recording with what the model in use and the written one, simulated on it as it is, say
    of it; data: all samples."""
    out = []
    for i, one in enumerate(recordings):
        k = (data.rec == i) & (data.raw_index >= 0)
        said = [replay_recording(m, one).predicted[data.raw_index[k]] for m in models]
        y, counted = data.y[k], data.rows[k]
        base, full = (x + _level(y - x, counted) for x in said)
        out.append(FitView(one.name, data.t[k], data.u[k], y, base, full, counted))
    return out


def _level(error: Floats, counted: Bools) -> float:
    """Mean over the rows that count; 0 where there is none."""
    return float(np.nanmean(error[counted])) if counted.any() else 0.0


def _rms(x: Floats) -> float:
    x = x[np.isfinite(x)]
    return float(np.sqrt(np.mean(x**2))) if x.size else 0.0
