"""Decide on the verdict and the model that is written: Searched -> Judged."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dehyst.models.diagnosis.data.colour import is_coloured
from dehyst.models.diagnosis.data.locate import hot_spots, locate
from dehyst.models.diagnosis.data.survey import BUTTERFLY_WARNING, has_response_to_drive
from dehyst.models.diagnosis.evidence import blockwise_held_out_error
from dehyst.models.diagnosis.findings.decide import (
    decide_verdict,
    has_unknown,
    report_unknown,
    sort_by_strength,
)
from dehyst.models.diagnosis.findings.episodes import (
    Episode,
    describe_residual_change,
    find_episodes,
)
from dehyst.models.diagnosis.findings.reported import without_effects_of_kind
from dehyst.models.diagnosis.findings.shape import mark_not_written
from dehyst.models.diagnosis.findings.weigh import Conclusion, conclude, with_episode
from dehyst.models.diagnosis.held_out import HeldOutErrors
from dehyst.models.diagnosis.intervals import are_times_known
from dehyst.models.diagnosis.judge import SearchState, base_error, misfit_beyond_noise
from dehyst.models.diagnosis.result import Finding, Progress
from dehyst.models.diagnosis.searched import Searched
from dehyst.models.diagnosis.tuning import TUNING
from dehyst.models.diagnosis.written_model import (
    WrittenModel,
    choose_written_model,
    is_determined,
)
from dehyst.models.signals.error_size import rms
from dehyst.models.signals.joined import Data, Floats


@dataclass(frozen=True)
class Judged:
    """The verdict and its basis. found: the accepted effects; fitted: the samples they were found
    from; noise: rms, of all that is taken as noise; unexplained: mean square of held-out samples
    that a memory of the drive of any shape leaves; written: the model that is written."""

    searched: Searched
    found: SearchState
    fitted: Data
    verdict: str
    findings: tuple[Finding, ...]
    noise: float
    unexplained: float
    written: WrittenModel


@dataclass(frozen=True)
class _Weighed:
    """One evaluation of the effects found. residual: (N,) what the findings leave; left: its rms
    beyond the noise; removed: mean square of a line that is present for part of the time, which the
    findings contain and no model does; noise: rms."""

    found: SearchState
    conclusion: Conclusion
    findings: tuple[Finding, ...]
    residual: Floats
    left: float
    removed: float
    noise: float
    verdict: str


def reach_verdict(searched: Searched, say: Progress) -> Judged:
    """Decide which of the effects found are named, the verdict, and the model that contains
    them."""
    one = _weigh(searched, searched.found, say)
    while one.verdict == "partly" and (fewer := _without_the_doubtful(one)) is not one.found:
        one = _weigh(searched, fewer, say)
    bare, found, noise = searched.bare, one.found, one.noise
    data = one.conclusion.problem.data
    unexplained = min(
        blockwise_held_out_error(found.problem, fit) for fit in (found.null, found.accepted)
    )
    lost = not has_response_to_drive(data, unexplained) and not searched.shown
    verdict = "unknown" if lost else one.verdict
    first = one.conclusion.bare
    in_use = HeldOutErrors(first, ())
    written = WrittenModel(bare.diagnosed.model, in_use, in_use)
    if BUTTERFLY_WARNING not in searched.warnings:  # no model of a butterfly can be inverted
        as_read = _with_stage_change(one.conclusion, searched.episode)
        written = choose_written_model(searched.whole, bare, as_read, found.sigma)
    refuted = _refuted(found, written) - searched.shown
    needless = {f.key for f in one.findings if f.key in refuted and _is_needless(f, written, noise)}
    if needless:  # the rest explains it all
        rest = without_effects_of_kind(found, lambda c: c.key in needless)
        return reach_verdict(replace(searched, found=rest), say)
    at_harmonics = {
        e.candidate.key for e in found.accepted.effects if not is_determined(e, searched.whole)
    }
    findings = [
        f
        if f.name in ("shape", "unknown") or f.key in written.contains
        else mark_not_written(f, f.key in at_harmonics)
        for f in one.findings
        if not (lost and f.name == "shape") and not (f.key in refuted and f.share < TUNING.minor)
    ]
    if verdict in ("unknown", "partly") and not has_unknown(findings):
        findings.append(_rest(data, one, sum(f.share for f in findings)))
    if verdict == "explained" and not (
        written.explains(noise, one.removed)
        and are_times_known(found.problem, found.accepted)
        and not is_shape_known_here_only(data, written, findings)
    ):
        verdict = "partly"
    ranked = tuple(sort_by_strength(findings))
    return Judged(searched, found, data, verdict, ranked, noise, unexplained, written)


def _weigh(searched: Searched, found: SearchState, say: Progress) -> _Weighed:
    """Return the findings of the effects found with their shares, what they leave, and the
    verdict."""
    sigma = found.sigma
    say("holding out", 0.88)
    weighed = conclude(searched.bare, found, searched.shown, searched.episode)
    say("intervals and rivals", 0.92)
    data, findings = weighed.problem.data, weighed.findings
    residual = weighed.final.residual(data)
    left = misfit_beyond_noise(weighed.problem, weighed.final, sigma)
    late = find_episodes(data, residual, sigma) if searched.episode is None else None
    if late is not None:
        residual = residual - late.removed
        findings = with_episode(findings, late, weighed, sigma)
        n = int(data.rows.sum())
        left = max(float(np.sum(residual[data.rows] ** 2)) / n - sigma**2, 0.0)
    line = late if searched.episode is None else searched.episode
    removed = 0.0 if line is None or line.of_stage else rms(line.removed[data.rows]) ** 2
    left, noise = float(np.sqrt(left)), sigma
    grown = any({"from_s", "until_s"} & f.where.keys() for f in findings)
    if left > TUNING.strong * sigma and not grown and is_coloured(data, residual, sigma):
        # the whole residual is noise
        left, noise = 0.0, rms(residual[data.rows])
    at_first = float(np.sqrt(max(weighed.bare - noise**2, 0.0)))
    any_loop = float(np.sqrt(misfit_beyond_noise(found.problem, found.null, sigma)))
    floor = max(noise, base_error(data) / TUNING.strong)
    verdict = decide_verdict(findings, left, at_first, any_loop, floor)
    return _Weighed(found, weighed, findings, residual, left, removed, noise, verdict)


def _without_the_doubtful(one: _Weighed) -> SearchState:
    """Return the search's result without effects that may well be part of the residual: slow
    changes, and also those that began before the recording where they remove little."""
    found = one.found
    fewer = without_effects_of_kind(found, lambda c: c.slow)
    before, after = (misfit_beyond_noise(s.problem, s.accepted, s.sigma) for s in (fewer, found))
    if before - after < (TUNING.half * one.left) ** 2:
        return fewer
    return without_effects_of_kind(found, lambda c: c.slow and not c.past)


def _refuted(found: SearchState, written: WrittenModel) -> set[str]:
    """Return the keys of effects of the drive without which the written model predicts no worse
    what it was not fitted to: where such an effect is small, it fits what the others leave."""
    if not written.gained:
        return set()
    driven = {e.candidate.key for e in found.accepted.effects if e.candidate.driven}
    return driven - set(written.contains)


def _is_needless(finding: Finding, written: WrittenModel, noise: float) -> bool:
    """Return whether the written model, which does not contain it, leaves less than half of what
    the effect is said to explain. noise: rms."""
    before, left = (
        max(held.mean_square - noise**2, 0.0) for held in (written.held_in_use, written.held)
    )
    return finding.share >= TUNING.minor and left < TUNING.half * finding.share * before


def is_shape_known_here_only(
    data: Data, written: WrittenModel, findings: Sequence[Finding]
) -> bool:
    """Return whether more than a small part of the misfit is the loop's shape, of which a single
    recording says nothing for another waveform, or which the written model does not contain."""
    shapes = [f.share for f in findings if f.name == "shape"]
    here_only = len(data.names) == 1 or not written.contains_shape
    return here_only and max(shapes, default=0.0) >= TUNING.minor


def _with_stage_change(conclusion: Conclusion, episode: Episode | None) -> Conclusion:
    """Return the conclusion with its fit of the readings as they are, where a change of the stage
    was subtracted from them."""
    if episode is None or not episode.of_stage:
        return conclusion
    problem = conclusion.problem
    data = problem.data
    problem = replace(problem, data=replace(data, y=data.y + episode.removed))
    return replace(conclusion, problem=problem, final=problem.refit(conclusion.final.effects))


def _rest(data: Data, one: _Weighed, named: float) -> Finding:
    """Return the finding for what nothing explains. named: sum of the shares of the named
    findings."""
    sigma = one.found.sigma
    where: dict[str, Any] = dict(hot_spots(locate(data, one.residual, sigma)))
    when, times = describe_residual_change(data, one.residual, sigma)
    rest = report_unknown(one.left, min(max(0.0, 1.0 - named), 1.0), where, data.unit, when)
    return replace(rest, where={**where, **times})
