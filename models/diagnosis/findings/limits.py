"""Exclusion limits: how small an effect these recordings would have shown, for each candidate.

The first guess is the strength whose contribution, with everything else refitted, reaches the size
at which the search accepts. Then the effect is put into the reading at that strength, and the
candidate is screened, refitted and judged as in the search; where it is refused, at half as
much again, some times. A strength that is never accepted is no limit. What stays below at every
sensible strength cannot be seen in these recordings at all, and the limit says so.
"""

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from dehyst.models.diagnosis.fit import Problem
from dehyst.models.diagnosis.judge import SearchState, excess, judge, least_size, tried
from dehyst.models.diagnosis.result import Limit
from dehyst.models.diagnosis.screen import Screen, contribution_of
from dehyst.models.diagnosis.tuning import TUNING
from dehyst.models.physics import library
from dehyst.models.physics.candidate import Candidate, Probe
from dehyst.models.signals.joined import Floats

CANNOT = "the drive of these recordings cannot show it"
SURELY = 1.05  # times the least size
TRIES, FACTOR = 4, 1.5
ROWS = 8_000  # counted when asking again


@dataclass(frozen=True)
class Guess:
    """A candidate at a strength: the probe; None: its drive cannot show it."""

    candidate: Candidate
    probe: Probe | None

    def limit(self, value: float | None) -> Limit:
        """As it is told."""
        c = self.candidate
        label = f"{c.name} ({c.channel})" if c.channel else ""
        if value is None:
            why = f"{label}: {CANNOT}" if label else CANNOT
            return Limit(c.name, None, c.limit_unit, c.limit_side, why)
        return Limit(c.name, value, c.limit_unit, c.limit_side, label)


def limits(found: SearchState, untold: Collection[str] = ()) -> list[Limit]:
    """One limit for each name in the library that was not found, the tightest of its kinds.

    untold: names for which there is none, as they stand in a tie with what was found.
    """
    problem, sigma = found.problem, found.sigma
    look = Screen(problem, found.accepted)
    named = {e.candidate.name for e in found.accepted.effects} | set(untold)
    left = excess(problem, found.accepted, sigma)
    guesses: dict[tuple[str, str], list[Guess]] = {}
    for c in library(problem.data):
        if c.name in named or not c.probes(problem.data):
            continue
        least = (least_size(c) * sigma) ** 2
        if c.driven:
            least = max(least, TUNING.driven_share * left)
        guess = _guess(look, c, SURELY * float(np.sqrt(least)))
        guesses.setdefault((c.name, c.channel), []).append(guess)
    light = problem.light(ROWS)
    out = []
    for kinds in guesses.values():
        shown = [g for g in kinds if g.probe is not None]
        shown.sort(key=lambda g: g.probe.value * (1 if g.candidate.limit_side == "above" else -1))  # type: ignore[union-attr]
        if not shown:
            out.append(kinds[0].limit(None))
            continue
        value = _checked(light, found, look, shown[0])
        if value is not None:
            out.append(shown[0].limit(value))
    return out


def _checked(light: Problem, found: SearchState, look: Screen, guess: Guess) -> float | None:
    """The strength at which the candidate is accepted, once it is put in; None: at none."""
    c, probe = guess.candidate, guess.probe
    assert probe is not None
    for _ in range(TRIES):
        if would_be_seen(light, found, c, contribution_of(look, c, probe)):
            return float(probe.value)
        probe = _stronger(c, probe, FACTOR)
        if any(
            not p.low <= v <= p.high
            for p, v in zip(c.params_at(probe.theta), probe.theta, strict=True)
        ):
            return None
    return None


def would_be_seen(light: Problem, found: SearchState, c: Candidate, added: Floats) -> bool:
    """Whether a candidate is accepted where the reading has so much more (N,) in it."""
    sigma = found.sigma
    there = replace(light, data=replace(light.data, y=light.data.y + added))
    current = there.solve(found.accepted.effects, light.output_of(found.accepted))
    n = int(there.data.rows.sum())
    state = SearchState(there, sigma, current, current, counted=n, share=found.share)
    starts = Screen(there, current).starts(c)
    if not starts:
        return False
    trial = tried(there, sigma, current, c, starts[0][1])
    return not judge(state, trial, excess(there, current, sigma)).refused


def _stronger(c: Candidate, probe: Probe, factor: float) -> Probe:
    """The same with so many times the strength."""
    up = factor if c.limit_side == "above" else 1.0 / factor
    if c.mode == "columns":
        amplitudes = tuple(up * a for a in probe.amplitudes)
        return Probe(up * probe.value, probe.theta, amplitudes)
    at = [k for k, v in enumerate(probe.theta) if np.isclose(v, probe.value)]
    theta = tuple(up * v if k in at else v for k, v in enumerate(probe.theta))
    return Probe(up * probe.value, theta, probe.amplitudes)


def _guess(look: Screen, c: Candidate, least: float) -> Guess:
    """The strength whose contribution beside the fit has the least rms."""
    probes = c.probes(look.problem.data)
    sizes = []
    for probe in probes:
        x = contribution_of(look, c, probe)[:, None]
        sizes.append(float(np.sqrt(np.mean(look.projected(x) ** 2))))
        if sizes[-1] > 3 * least:
            break
    if c.mode == "columns":  # linear in the amplitude
        if sizes[0] < 1e-12:
            return Guess(c, None)
        return Guess(c, _stronger(c, probes[0], least / sizes[0]))
    reached = [k for k, size in enumerate(sizes) if size >= least]
    if not reached:
        return Guess(c, None)
    k = reached[0]
    if k == 0 or sizes[k - 1] <= 0:
        return Guess(c, probes[k])
    part = float(np.clip(np.log(least / sizes[k - 1]) / np.log(sizes[k] / sizes[k - 1]), 0, 1))
    low, high = probes[k - 1], probes[k]
    theta = tuple(
        a * (b / a) ** part if a > 0 and b > 0 else b
        for a, b in zip(low.theta, high.theta, strict=True)
    )
    return Guess(c, Probe(low.value * (high.value / low.value) ** part, theta))
