"""Decide what improves on the model in use, on held-out samples."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dehyst.models.diagnosis.evidence import blockwise_held_out_error
from dehyst.models.diagnosis.findings.decide import (
    distribute_share,
    report_effects,
    sort_by_strength,
)
from dehyst.models.diagnosis.findings.episodes import Episode
from dehyst.models.diagnosis.findings.shape import measure_correction, shape_finding
from dehyst.models.diagnosis.fit import Problem
from dehyst.models.diagnosis.joint_fit import JointFit
from dehyst.models.diagnosis.judge import SearchState
from dehyst.models.diagnosis.result import Finding
from dehyst.models.diagnosis.tuning import TUNING


@dataclass(frozen=True)
class Conclusion:
    """The conclusion: findings with shares, the fit, and mean squares on held-out samples (bare: of
    the model in use, on all samples, because it was not fitted here)."""

    findings: tuple[Finding, ...]
    problem: Problem
    final: JointFit
    bare: float
    held: float


def conclude(
    bare: Problem, found: SearchState, shown: Collection[str], episode: Episode | None = None
) -> Conclusion:
    """Decide what improves on the model in use, on held-out samples. Where nothing does, the
    findings are those that a recording shows directly (shown: their keys), and the model in use
    stays as it is. episode: what was subtracted before the search."""
    sigma = found.sigma
    n = int(bare.data.rows.sum())
    first = bare.solve([]).sse / n
    freed = replace(bare, data=replace(bare.data, y=found.problem.data.y))
    alone = freed.solve([])
    without = alone.sse / n
    held = blockwise_held_out_error(found.problem, found.accepted)
    if found.accepted.effects and held > without - (TUNING.trace * sigma) ** 2:
        # the base overfits more than it explains: the effects are fitted to the model in use
        # without the base
        over_it = freed.refit(found.accepted.effects, start=alone)
        found = replace(found, problem=freed, null=alone, accepted=over_it)
        held = blockwise_held_out_error(found.problem, found.accepted)
    in_part = [] if episode is None else [episode.finding]
    nothing = Conclusion(_shared(in_part, first, without, sigma), freed, alone, first, without)
    if held > without - (TUNING.trace * sigma) ** 2:
        seen = (
            [f for f in report_effects(found.problem, found, held) if f.key in shown]
            if shown
            else []
        )
        return replace(
            nothing, findings=(*[replace(f, share=0.0) for f in seen], *nothing.findings)
        )
    correction = measure_correction(found.problem, found.accepted, without, held)
    findings = _without_echoes(report_effects(found.problem, found, held))
    rest = without - held - sum(f.share for f in findings)
    if rest > TUNING.most * (without - held) and correction.rms**2 > TUNING.quarter * rest:
        # the effects are a small part of what is explained: the rest is the base's, as far as its
        # correction is that large; without the effects it would have absorbed them
        correction = replace(correction, gain=max(correction.gain, rest))
    least = max((TUNING.clear * sigma) ** 2, TUNING.crumb * (without - sigma**2))
    shape = bool(found.problem.base.width) and correction.gain > least
    if not findings and not shape:
        return nothing
    if shape:
        findings.append(
            shape_finding(found.problem, found.accepted, sigma, correction, correction.gain)
        )
    shared = _shared([*findings, *in_part], first, held, sigma)
    return Conclusion(shared, found.problem, found.accepted, first, held)


def _shared(
    findings: Sequence[Finding], first: float, held: float, sigma: float
) -> tuple[Finding, ...]:
    removed = float(np.clip((first - held) / max(first - sigma**2, 1e-300), 0.0, 1.0))
    return tuple(distribute_share(findings, removed))


def with_episode(
    findings: Sequence[Finding], episode: Episode, weighed: Conclusion, sigma: float
) -> tuple[Finding, ...]:
    """Return the findings with one that is present for part of the time."""
    explainable = max(weighed.bare - sigma**2, 1e-300)
    taken = sum(f.share for f in findings)
    share = min(episode.finding.share / explainable, 1.0 - taken)
    return tuple(sort_by_strength([*findings, replace(episode.finding, share=share)]))


def _without_echoes(findings: Sequence[Finding]) -> list[Finding]:
    """Return the findings without small ones that could as well be a larger one: such a finding is
    what the library's form of the larger one leaves."""
    return [
        f
        for f in findings
        if not any(
            o.name in f.ambiguous_with and f.share < TUNING.quarter * o.share for o in findings
        )
    ]
