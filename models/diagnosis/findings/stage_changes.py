"""A sudden change of the stage in mid-record: a preload that slips, a load that is taken off, a
gauge that is moved or switched to another range.

From one sample on, the displacement has another gain and another level. Slow physics (creep, drift)
fits a part of that in each recording, and does not predict the next.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from dehyst.models.diagnosis.effects import LastingSpan, Span
from dehyst.models.diagnosis.findings.episodes import Episode
from dehyst.models.diagnosis.fit import Problem
from dehyst.models.diagnosis.joint_fit import JointFit, solve_ridged
from dehyst.models.diagnosis.judge import misfit_beyond_noise
from dehyst.models.diagnosis.result import Finding
from dehyst.models.diagnosis.screen import Screen
from dehyst.models.diagnosis.tuning import TUNING
from dehyst.models.physics import list_candidates
from dehyst.models.physics.candidate import format_length
from dehyst.models.signals.error_size import rms
from dehyst.models.signals.joined import Data, Floats

EDGE = 0.1  # of a recording's counted rows, at either end, where no change is looked for
TIMES = 24  # that are tried at once, in ever shorter parts


@dataclass(frozen=True)
class _Change:
    """A time from which on the stage has another gain and level. fall: estimated decrease of the
    sum of squares."""

    span: Span
    fall: float


@dataclass(frozen=True)
class _Fitted:
    """Changes with their gains and mean levels. removed: (N,) what they add; remaining: mean square
    beyond the noise that they leave."""

    changes: tuple[_Change, ...]
    sizes: Floats
    removed: Floats
    remaining: float


def find_stage_change(problem: Problem, null: JointFit, sigma: float) -> Episode | None:
    """Return a sudden change of gain and level that leaves little of what the base leaves (null:
    its fit), and at most half of what slow physics leaves: one that lasts through the recordings
    made after it, else at most one in each recording; None where there is none. Of a ramp, the best
    step removes three quarters of the power."""
    left = misfit_beyond_noise(problem, null, sigma)
    if left < (TUNING.strong * sigma) ** 2:
        return None
    light = problem.with_fewer_rows(TUNING.limit_rows)
    screen = Screen(light, light.solve([]))
    x = screen.output - screen.output.mean()
    for changes in _possible_changes(screen, x):
        fitted = _fit(problem, null, sigma, x, changes)
        if fitted is None or fitted.remaining > TUNING.minor * left:
            continue
        if fitted.remaining <= TUNING.half * _least_by_slow_physics(screen, sigma):
            return _report(problem.data, fitted, left)
    return None


def _possible_changes(screen: Screen, x: Floats) -> Iterator[tuple[_Change, ...]]:
    """Yield the one change that lasts and explains most, where more recordings come after it, and
    all those of single recordings."""
    last = len(screen.problem.data.names) - 1
    every = [_best_change(screen, x, LastingSpan(i, 0.0, True, False)) for i in range(last)]
    if every:
        yield (max(every, key=lambda one: one.fall),)
    least = TUNING.crumb * float(screen.r @ screen.r)
    own = [_best_change(screen, x, Span(i, 0.0, True, False)) for i in range(last + 1)]
    yield tuple(one for one in own if one.fall > least)


def _fit(
    problem: Problem, null: JointFit, sigma: float, x: Floats, changes: tuple[_Change, ...]
) -> _Fitted | None:
    """Return the changes, fitted together; without those whose gain or level is not known: where
    little of the recording counts or moves on one side of the time. None where none is left."""
    data = problem.data
    if not changes:
        return None
    since = [one.span.rows(data).astype(float) for one in changes]
    each = np.concatenate([np.column_stack([s * x, s]) for s in since], axis=1)
    own, rest = problem.projector(null)(each), null.residual(data)[problem.row_index]
    ridge = np.full(own.shape[1], TUNING.ridge)
    amplitudes, inverse = solve_ridged(own.T @ own, own.T @ rest, ridge)
    free = rest.size - null.design.shape[1] - own.shape[1]
    mean_square = float(np.sum((rest - own @ amplitudes) ** 2)) / max(free, 1)
    errors = np.sqrt(mean_square * np.diag(inverse))
    known = []
    for k, one in enumerate(changes):
        there = one.span.rows(data) & data.rows
        pair = slice(2 * k, 2 * k + 2)
        size = rms(each[there][:, pair] @ amplitudes[pair])
        unsure = errors[pair] * [rms(x[there]), 1.0]
        if max(unsure) < TUNING.quarter * size:
            known.append(one)
    if len(known) < len(changes):
        return _fit(problem, null, sigma, x, tuple(known))
    remaining = max(mean_square - sigma**2, 0.0)
    return _Fitted(changes, amplitudes.reshape(-1, 2), each @ amplitudes, remaining)


def _report(data: Data, fitted: _Fitted, left: float) -> Episode:
    """Return the finding of the changes. left: mean square without them, beyond the noise."""
    texts = []
    for one, (more, level) in zip(fitted.changes, fitted.sizes, strict=True):
        after = ", and in what was recorded after it," if isinstance(one.span, LastingSpan) else ""
        texts.append(
            f"at {one.span.at_s:.3g} s of {data.names[one.span.recording]}{after} its gain changes "
            f"by {100.0 * more:+.2g} % and its mean level by "
            f"{format_length((float(level), data.unit))}"
        )
    first = max(fitted.changes, key=lambda one: one.fall).span
    share = left - fitted.remaining
    finding = Finding(
        name="unknown",
        key="unknown",
        place="stage",
        title="A sudden change of the stage",
        equation="y -> (1 + g) y + o from a time on",
        source="",
        share=share,
        evidence={"removed_rms": float(np.sqrt(share))},
        parameters={},
        ambiguous_with=(),
        where={"recording": data.names[first.recording], "from_s": first.at_s},
        says=(
            f"The stage changes suddenly: {'; '.join(texts)}. No model predicts this: look for "
            "what was moved, loaded or switched then (mounting, preload, the gauge's range)."
        ),
    )
    return Episode(finding, fitted.removed, of_stage=True)


def _least_by_slow_physics(screen: Screen, sigma: float) -> float:
    """Return the least mean square beyond the noise that a slow candidate leaves, estimated."""
    problem = screen.problem
    slow = [
        screen.starts(c) for c in list_candidates(problem.data) if c.slow and not c.beside_model
    ]
    gain = max((ranked[0][0] for ranked in slow if ranked), default=0.0)
    free = max(screen.rows.size - screen.current.design.shape[1], 1)
    return max((float(screen.r @ screen.r) - gain) / free - sigma**2, 0.0)


def _best_change(screen: Screen, x: Floats, kind: Span) -> _Change:
    """Return the change of gain (of x, (N,)) and level in a recording that explains most, at the
    best time of a span."""
    data = screen.problem.data
    t = data.t[(data.rec == kind.recording) & data.rows]
    best = _Change(kind, 0.0)
    if not t.size:
        return best
    low, high = (float(q) for q in np.quantile(t, (EDGE, 1.0 - EDGE)))
    both = np.column_stack([x, np.ones(data.n)])
    while high - low > 2.0 * data.period:  # samples show no finer time
        spans = [replace(kind, at_s=at) for at in np.linspace(low, high, TIMES).tolist()]
        inside = np.stack([span.rows(data) for span in spans], axis=1)
        gains, _ = screen.gains_in(both, screen.split_samples(inside))
        at = int(np.argmax(gains))
        best = _Change(spans[at], float(gains[at]))
        step = (high - low) / (TIMES - 1)
        low, high = max(best.span.at_s - step, low), min(best.span.at_s + step, high)
    return best
