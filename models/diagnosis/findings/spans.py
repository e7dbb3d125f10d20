"""Find an effect that begins, or ends, within a recording: of each candidate, the time from which,
or until which, it explains most."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from dehyst.models.diagnosis.effects import Effect, LastingSpan, Span, Theta
from dehyst.models.diagnosis.judge import (
    CandidateTrial,
    SearchState,
    judge,
    misfit_beyond_noise,
    try_candidate,
)
from dehyst.models.diagnosis.screen import SamplePieces, Screen
from dehyst.models.diagnosis.search import search_one_more
from dehyst.models.diagnosis.tuning import TUNING
from dehyst.models.physics import list_candidates
from dehyst.models.physics.candidate import Candidate
from dehyst.models.signals.joined import Data

TIMES = 16  # of each recording that are tried first,
FINER = 8  # and between two of these, around the best
SETTLES = 3  # times that the values and the time are fitted in turn


def with_span(found: SearchState) -> SearchState:
    """Return a search's result in which one effect is present for part of the time, if it leaves
    only a small part of what the effects found leave; else unchanged."""
    problem, sigma = found.problem, found.sigma
    left = misfit_beyond_noise(problem, found.accepted, sigma)
    if left < (TUNING.strong * sigma) ** 2:
        return found
    light = problem.with_fewer_rows(TUNING.limit_rows)
    null = light.solve([])
    screen = Screen(light, null)
    ranked = sorted(_best_spans(screen), key=lambda one: -one[0])[: TUNING.shortlist]
    most = max((gain for gain, *_ in ranked), default=0.0)
    if most < TUNING.quarter * float(screen.r @ screen.r):
        return found  # it must leave little: an estimate at one of a few times shows half of that
    bare = replace(found, problem=light, null=null, accepted=null, rounds=(), picked=())
    # next to a base, a column that begins is the same as its negative until then
    both = [
        (c, theta, one)
        for gain, c, theta, span in ranked
        if gain > TUNING.half * most
        for one in ((span, span.rest) if c.mode == "columns" else (span,))
    ]
    # how lags and modes are fed was chosen with effects that are present all the time
    feeds = [light] if light.data.early else [light.with_zero_order_hold(x) for x in (False, True)]
    each = [_with_best(replace(bare, problem=fed), both) for fed in feeds]
    state = min(each, key=lambda one: one.accepted.sse)
    if state.accepted is null:
        return found
    state = search_one_more(state, TUNING.shortlist)
    if misfit_beyond_noise(state.problem, state.accepted, sigma) > TUNING.quarter * left:
        return found  # the last fit takes away a part of this, not half
    problem = problem.with_zero_order_hold(state.problem.data.stepped)
    final = problem.refit_closely(state.accepted.effects, sigma)
    if misfit_beyond_noise(problem, final, sigma) > TUNING.minor * left:
        return found  # a part of any change in time looks like some effect that begins
    counted = int(light.data.rows.sum())
    return replace(state, problem=problem, null=found.null, accepted=final, counted=counted)


def _with_best(bare: SearchState, starts: Sequence[tuple[Candidate, Theta, Span]]) -> SearchState:
    """Return a search without effects with the best of some in its span; unchanged where none
    passes, or where it leaves as much as when it is present all the time."""
    problem, sigma, null = bare.problem, bare.sigma, bare.null
    at_first = misfit_beyond_noise(problem, null, sigma)
    judged = [judge(bare, _settle(bare, *one), at_first) for one in starts]
    good = [t for t in judged if not t.refused and _is_its_own(t, problem.data)]
    if not good:
        return bare
    best = max(good, key=lambda t: t.worth)
    always = try_candidate(problem, sigma, null, best.candidate, best.fit.effects[0].theta)
    lasting, part = (misfit_beyond_noise(problem, t.fit, sigma) for t in (always, best))
    if part > TUNING.half * lasting:
        return bare
    return replace(bare, accepted=best.fit, rounds=(tuple(judged),), picked=(best.candidate.key,))


def _spans(data: Data, times: int) -> Iterator[Span]:
    for i in range(len(data.names)):
        t = data.t[data.rec == i]
        for at_s in np.linspace(t[0], t[-1], times + 2)[1:-1].tolist():
            for begins in (True, False):
                yield from _extents(data, i, at_s, begins)


def _extents(data: Data, i: int, at_s: float, begins: bool) -> Iterator[Span]:
    """Yield the spans that begin, or end, at a time of a recording: with none of the other
    recordings, with all, and, where these are two, with those on the same side of it in time."""
    last = len(data.names) - 1
    for others in (False, True)[: min(last + 1, 2)]:
        yield Span(i, at_s, begins, others)
    if 0 < i < last:
        yield LastingSpan(i, at_s, begins, False)


def _best_spans(screen: Screen) -> Iterator[tuple[float, Candidate, Theta, Span]]:
    """Yield each candidate with the start and the span of the largest estimated gain."""
    data = screen.problem.data
    spans = list(_spans(data, TIMES))
    parts = _split_by_span(screen, spans)
    for c in list_candidates(data):
        # what fits a part of any change in time has no time of its own
        if c.slow or c.refines or c.key.rpartition("-")[2].isdecimal():
            continue
        starts = [tuple(s) for s in c.starts(data, screen.residual)]
        each = [one for theta in starts for one in _gains(screen, Effect(c, theta), spans, parts)]
        if each:
            gain, amount, theta, span = max(each, key=lambda one: one[0])
            yield gain, c, c.scaled(theta, amount), span


def _split_by_span(screen: Screen, spans: Sequence[Span]) -> SamplePieces:
    data = screen.problem.data
    return screen.split_samples(np.stack([span.rows(data) for span in spans], axis=1))


def _gains(
    screen: Screen, effect: Effect, spans: Sequence[Span], parts: SamplePieces
) -> list[tuple[float, float, Theta, Span]]:
    """Return the estimated gain and amount of an effect in each span."""
    x = screen.contribution(effect)
    if x.shape[1] == 0 or not np.any(x):
        return []
    gains, amounts = screen.gains_in(x, parts)
    if effect.candidate.mode != "columns":
        gains = np.where(amounts > 0.0, gains, 0.0)
    return [
        (float(gain), float(amount), effect.theta, span)
        for gain, amount, span in zip(gains, amounts, spans, strict=True)
    ]


def _settle(bare: SearchState, c: Candidate, theta: Theta, span: Span) -> CandidateTrial:
    """Return a candidate's trial in the span near this one that fits best."""
    problem, sigma, null = bare.problem, bare.sigma, bare.null
    screen = Screen(problem, null)
    best = try_candidate(problem, sigma, null, c, theta, span)
    here = problem.data.t[problem.data.rec == span.recording]
    width = float(np.ptp(here)) / (TIMES + 1)
    for _ in range(SETTLES):
        fitted = best.fit.effects[0]
        assert fitted.span is not None
        width /= FINER / 2
        near = fitted.span.at_s + width * np.arange(-FINER, FINER + 1)
        spans = [replace(fitted.span, at_s=float(at)) for at in near if here[0] < at < here[-1]]
        if not spans:
            break
        each = _gains(screen, replace(fitted, span=None), spans, _split_by_span(screen, spans))
        if not each:
            break
        at = max(each, key=lambda one: one[0])[3]
        trial = try_candidate(problem, sigma, null, c, fitted.theta, at)
        if trial.gain <= best.gain:
            break
        best = trial
    # estimates do not decide where the effect is small, as that of a mode in a slow recording
    settled = best.fit.effects[0]
    assert settled.span is not None
    extents = _extents(problem.data, span.recording, settled.span.at_s, span.begins)
    others = [
        try_candidate(problem, sigma, null, c, settled.theta, extent)
        for extent in extents
        if extent != settled.span
    ]
    return max([best, *others], key=lambda t: t.gain)


def _is_its_own(trial: CandidateTrial, data: Data) -> bool:
    """Return whether an effect is not a line: a mode that rings for long copies a line of the
    surroundings."""
    effect = trial.fit.effects[0]
    ring = effect.candidate.free_oscillation(effect.theta)
    assert effect.span is not None
    inside = effect.span.rows(data) & (data.rec == effect.span.recording)
    return ring is None or ring[1] * TUNING.minor * float(np.ptp(data.t[inside])) > 1.0
