"""Near-ties: what else would explain the same misfit about as well as an accepted effect."""

from dataclasses import dataclass

from dehyst.models.diagnosis.effects import Effect
from dehyst.models.diagnosis.fit import Problem
from dehyst.models.diagnosis.joint_fit import JointFit
from dehyst.models.diagnosis.judge import SearchState, effect_of, misfit_beyond_noise
from dehyst.models.diagnosis.screen import Screen
from dehyst.models.diagnosis.tuning import TUNING
from dehyst.models.physics import list_candidates
from dehyst.models.physics.candidate import Candidate, may_be_confused


@dataclass(frozen=True)
class RivalEffect:
    """Another candidate in the place of an effect, all else refitted; loss: by how much its mean
    square misfit exceeds that with the effect."""

    key: str
    name: str
    place: str
    loss: float


def rivals(found: SearchState, effect: Effect) -> list[RivalEffect]:
    """Return the candidates that do as well in the place of an accepted effect, best first."""
    final, sigma = found.accepted, found.sigma
    problem = found.problem.with_fewer_rows(found.counted)
    final = problem.solve(final.effects, problem.output_of(final))
    n = int(problem.data.rows.sum())
    rest = [e for e in final.effects if e is not effect]
    without = problem.without(final, effect)
    gain = (without.sse - final.sse) / n
    limit = max(
        (TUNING.visible * sigma) ** 2,
        TUNING.crumb * gain,
        TUNING.near * misfit_beyond_noise(problem, final, sigma),
    )
    limit = min(limit, TUNING.quarter * gain)  # where much is left, a rival must still remove most
    taken = {e.candidate.key for e in final.effects}
    seen: dict[str, Effect] = {}
    for trials in found.rounds:
        keys = {t.candidate.key for t in trials}
        if not keys & {effect.candidate.key, *effect.candidate.refines}:
            continue
        for t in trials:
            key = t.candidate.key
            same = key in (effect.candidate.key, *effect.candidate.refines)
            as_well = effect.candidate.name in t.candidate.contains  # whichever is true
            if same or key in taken or key in seen or t.impossible or as_well:
                continue
            if t.gain / found.counted < 0.6 * gain:  # of it: a refit seldom adds the rest
                continue
            seen[key] = next(e for e in t.fit.effects if e.candidate.key == key)
    screen, untried = Screen(problem, without), set[str]()
    for c in _list_confusable(found, effect):
        starts = screen.starts(c)
        if starts and starts[0][0] > TUNING.half * gain * n:
            seen[c.key] = Effect(c, starts[0][1])
            untried.add(c.key)
    out = []
    for key, other in seen.items():
        fit = problem.refit([*rest, other], rounds=4, start=without)  # enough to compare
        loss = (fit.sse - final.sse) / n
        one = effect_of(fit, key)
        amplitudes = fit.amplitudes_of(one)
        if key in untried and one.candidate.implausible(one.theta, amplitudes, problem.data):
            continue
        if loss < limit and _can_replace(problem, fit, effect, gain * n):
            c = other.candidate
            out.append(RivalEffect(key, c.name, c.place, loss))
    return sorted(out, key=lambda r: r.loss)


def _list_confusable(found: SearchState, effect: Effect) -> list[Candidate]:
    """Return the candidates that may be confused with an effect's and whose names no round tried in
    any form: forms with a larger estimated gain may have kept them off the shortlist."""
    own = effect.candidate
    names = {t.candidate.name for trials in found.rounds for t in trials}
    names |= {e.candidate.name for e in found.accepted.effects}
    return [
        c
        for c in list_candidates(found.problem.data)
        if c.name not in (own.name, *names)
        and not c.refines
        and own.name not in c.contains
        and may_be_confused(c, own)
    ]


def _can_replace(problem: Problem, fit: JointFit, effect: Effect, gain: float) -> bool:
    """Return whether a rival replaces the effect: added to the rival, the effect removes only a
    fraction of what it removes alone. gain: fall of the sum of squares by the effect."""
    both = problem.solve([*fit.effects, effect], problem.output_of(fit))
    return fit.sse - both.sse < TUNING.half * gain
