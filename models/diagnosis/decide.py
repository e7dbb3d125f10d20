"""Which candidates are accepted: screen, joint refit, price, tiers, repeat, prune.

Gains are sums of squares over the counted rows, in displacement units squared, always after
everything else was refitted.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from dehyst.models.diagnosis.candidates import library
from dehyst.models.diagnosis.candidates.interface import Candidate, Context
from dehyst.models.diagnosis.data import Floats
from dehyst.models.diagnosis.fit import Effect, Fitted, Problem, _ordered

MAX_EFFECTS = 5
SHORTLIST = 4  # candidates that get the full nonlinear refit in each round


@dataclass(frozen=True)
class Trial:
    """A candidate's best joint refit in one round."""

    candidate: Candidate
    fit: Fitted
    gain: float  # fall of the sum of squares


@dataclass
class Search:
    """Everything the search has learned; `rounds` keeps the trials for the report."""

    problem: Problem
    sigma: float
    null: Fitted
    accepted: Fitted
    rounds: list[list[Trial]] = field(default_factory=list)
    rejected: list[Trial] = field(default_factory=list)


def excess(problem: Problem, fit: Fitted, sigma: float) -> float:
    """Mean square misfit beyond the noise, >= 0 [displacement unit squared]."""
    n = int(problem.data.rows.sum())
    free = n - fit.design.shape[1]
    return max(0.0, fit.sse / max(free, 1) - sigma**2)


def screen(problem: Problem, current: Fitted, candidate: Candidate) -> list[tuple[float, tuple]]:
    """Estimated gain of a candidate from each start, by its first-order effect with the base
    refitted; best first."""
    data = problem.data
    residual = current.residual(data)
    r = problem.counted(residual)
    out = problem.output_of(current)
    scores = []
    for theta in candidate.starts(data, residual):
        effect = Effect(candidate, tuple(theta))
        if candidate.mode == "columns":
            x = candidate.columns(data, Context(data.u, out), theta)
        else:
            there = _simulate(problem, current, _ordered([*current.effects, effect]), out)
            x = (there - current.prediction)[:, None]
        xp = problem.counted(problem.project(current, x))
        a = xp.T @ xp
        g = xp.T @ r
        if candidate.mode != "columns":
            amount = float(g[0] / a[0, 0]) if a[0, 0] > 0 else 0.0
            gain = float(g[0] ** 2 / a[0, 0]) if amount > 0 else 0.0
        else:
            gain = float(g @ np.linalg.pinv(a, rcond=1e-10, hermitian=True) @ g)
        scores.append((gain, tuple(theta)))
    scores.sort(key=lambda s: -s[0])
    return scores


def _simulate(problem: Problem, current: Fitted, effects: Sequence[Effect], out: Floats) -> Floats:
    """Prediction with the current weights and one more effect (its additive part absent)."""
    known = {e.candidate.key: a for e, a in zip(current.effects, current.amplitudes, strict=True)}
    amplitudes = tuple(known.get(e.candidate.key, np.zeros(0)) for e in effects)
    return problem.simulate(replace(current, amplitudes=amplitudes), effects, out)


def search(
    problem: Problem,
    sigma: float,
    null: Fitted,
    progress: Callable[[str, float], None] | None = None,
) -> Search:
    """Accept effects one by one until none pays."""
    state = Search(problem, sigma, null, null)
    everything = library(problem.data)
    for number in range(MAX_EFFECTS):
        current = state.accepted
        left = excess(problem, current, sigma)
        have = {e.candidate.key for e in current.effects}
        pool = [c for c in everything if c.key not in have and _next_of_its_kind(c, have)]
        scored = []
        for c in pool:
            starts = screen(problem, current, c)
            if starts:
                scored.append((starts[0][0], c, starts))
        scored.sort(key=lambda s: -s[0])
        trials = []
        for _, c, starts in scored[:SHORTLIST]:
            fit = problem.refit([*current.effects, Effect(c, starts[0][1])], start=current)
            trials.append(Trial(c, fit, current.sse - fit.sse))
            if progress is not None:
                progress(f"trying {c.key}", min(0.9, 0.15 + 0.15 * number))
        trials.sort(key=lambda t: -t.gain)
        state.rounds.append(trials)
        chosen = next((t for t in trials if acceptable(state, t, left)), None)
        if chosen is None:
            break
        state.accepted = chosen.fit
    return state


def _next_of_its_kind(candidate: Candidate, have: set[str]) -> bool:
    """Repeatable kinds (modes) come in order: the second only behind the first."""
    if "-" not in candidate.key or not candidate.repeatable:
        return True
    stem, number = candidate.key.rsplit("-", 1)
    return (stem if number == "2" else f"{stem}-{int(number) - 1}") in have


def acceptable(state: Search, trial: Trial, left: float) -> bool:
    """The two tiers: causes beside the drive on evidence, causes driven by it on size too."""
    data = state.problem.data
    n = int(data.rows.sum())
    effect = next(e for e in trial.fit.effects if e.candidate.key == trial.candidate.key)
    amplitudes = trial.fit.amplitudes[trial.fit.effects.index(effect)]
    if trial.candidate.implausible(effect.theta, amplitudes, data):
        return False
    mean_square = trial.gain / n
    count = len(effect.theta) + amplitudes.size
    if trial.gain < 12.0 * state.sigma**2 * max(count, 1):
        return False
    if not trial.candidate.driven:
        return mean_square > (0.08 * state.sigma) ** 2
    return mean_square > 0.2 * left and mean_square > (0.2 * state.sigma) ** 2
