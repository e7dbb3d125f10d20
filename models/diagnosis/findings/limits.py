"""Exclusion limits: how small an effect these recordings would have shown, for each candidate.

The first guess is the strength whose contribution, with everything else refitted, is large enough
that the search certainly accepts it. Then the effect is added to the reading at that strength, and
the search continues from what was found; where the effect is not reported, it is tried once more,
stronger. If the effect is not reported at any strength, there is no limit. There is none either for
effects that a found one could be mistaken for: the search on other recordings may choose them
instead. Effects of the drive get no limit if more than the noise is left of what the drive causes,
because they would compete with that, or if three or more effects were found, which may hide
another. The reported limit is somewhat larger, because a stage's effect is not exactly the
library's. An effect that stays too small to be accepted at every sensible strength cannot be seen
in these recordings at all, and the limit says so.
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

import numpy as np

from dehyst.models.diagnosis.joint_fit import JointFit
from dehyst.models.diagnosis.judge import SearchState, can_distinguish_lag, misfit_beyond_noise
from dehyst.models.diagnosis.result import Limit
from dehyst.models.diagnosis.screen import Screen, contribution_of
from dehyst.models.diagnosis.tuning import TUNING
from dehyst.models.physics import list_candidates
from dehyst.models.physics.candidate import Candidate, Probe, may_be_confused
from dehyst.models.signals.error_size import rms
from dehyst.models.signals.joined import Floats

CANNOT = "the drive of these recordings cannot show it"
TRIES = 2  # strengths: the first guess, and a stronger one after a miss
STEP = 2.0  # factor of an amplitude, about that between probes; number of such steps:
RAISED, STRONGER = 0.5, 0.5  # after a miss, and from the found to the reported value
Seen = Callable[[Candidate, Floats], Collection[str]]


@dataclass(frozen=True)
class Guess:
    """A candidate at a strength: the probe, and its (fractional) index among the candidate's
    probes; None: the drive cannot show it."""

    candidate: Candidate
    probe: Probe | None
    place: float = 0.0

    def limit(self, value: float | None, leaves_out: str = "") -> Limit:
        """Return the limit as reported. leaves_out: what it does not hold for."""
        c = self.candidate
        label = f"{c.name} ({c.channel})" if c.channel else leaves_out
        if value is None:
            why = f"{label}: {CANNOT}" if label else CANNOT
            return Limit(c.name, None, c.limit_unit, c.limit_side, why)
        return Limit(c.name, value, c.limit_unit, c.limit_side, label)


def limits(found: SearchState, untold: Collection[str], seen: Seen) -> list[Limit]:
    """Return one limit for each name in the library that was not found, the tightest of its kinds.

    untold: names without a limit, as they are in a near-tie with what was found. seen(candidate,
    added): names that are found when (N,) `added` of the candidate is added to the reading.
    """
    problem, sigma = found.problem, found.sigma
    screen = Screen(problem, found.accepted)
    named = {e.candidate.name for e in found.accepted.effects} | set(untold)
    left = misfit_beyond_noise(problem, found.accepted, sigma)
    kinds: dict[tuple[str, str], list[Candidate]] = {}
    hidden = not can_distinguish_lag(problem, sigma)
    loud = left > sigma**2
    loud |= len(found.accepted.effects) >= TUNING.few
    for c in list_candidates(problem.data):
        if c.name in named or not c.probes(problem.data):
            continue
        if (c.driven and loud) or _has_lookalike(c, found.accepted):
            continue
        kinds.setdefault((c.name, c.channel), []).append(c)

    def tightest(some: Sequence[Candidate]) -> Limit | None:
        # late effects replace each other there
        if problem.has_few_distinct_moments and some[0].late:
            return Guess(some[0], None).limit(None) if hidden else None
        ring = some[0].free_oscillation(some[0].probes(problem.data)[0].theta)
        if problem.is_single_loop and ring:  # its ring is locked to the loop
            return Guess(some[0], None).limit(None)
        shown = []
        for c in some:
            least = ((TUNING.strong if c.driven else TUNING.clear) * sigma) ** 2
            if c.driven:
                least = max(least, TUNING.minor * left)
            guess = _guess(screen, c, float(np.sqrt(least)))
            if guess.probe is not None:
                above = c.limit_side == "above"
                shown.append((guess.probe.value if above else -guess.probe.value, guess))
        if not shown:
            return Guess(some[0], None).limit(None)
        guess = min(shown, key=lambda one: one[0])[1]
        value = _checked(screen, guess, seen)
        leaves_out = guess.candidate.limit_caveat(problem.data)
        return None if value is None else guess.limit(value, leaves_out)

    return [one for one in problem.several(tightest, kinds.values()) if one is not None]


def _has_lookalike(c: Candidate, accepted: JointFit) -> bool:
    """Return whether a found effect could take the candidate's place, or part of it: what looks
    alike, and, if a found effect is caused by the drive, all that resembles a hysteresis of another
    shape."""
    return any(
        may_be_confused(c, e.candidate) or (c.static and e.candidate.driven)
        for e in accepted.effects
    )


def _checked(screen: Screen, guess: Guess, seen: Seen) -> float | None:
    """Return a strength somewhat above that at which the candidate is found when it is added; None
    if it is found at none, or if no probe is stronger."""
    c, here = guess.candidate, guess
    for _ in range(TRIES):
        if here.probe is None:
            return None
        if c.name in seen(c, contribution_of(screen, c, here.probe)):
            stronger = _stronger(screen, here, STRONGER).probe
            return None if stronger is None else float(stronger.value)
        here = _stronger(screen, here, RAISED)
    return None


def _stronger(screen: Screen, guess: Guess, steps: float) -> Guess:
    """Return the same, stronger by that number of steps; beyond the strongest probe there is
    none."""
    c, probe = guess.candidate, guess.probe
    if c.mode != "columns":
        return _at(screen, c, guess.place + steps)
    assert probe is not None
    return Guess(c, _amplified(probe, STEP**steps))


def _amplified(probe: Probe, factor: float) -> Probe:
    return Probe(factor * probe.value, probe.theta, tuple(factor * a for a in probe.amplitudes))


def _at(screen: Screen, c: Candidate, place: float) -> Guess:
    """Return the guess at a fractional index between two of the candidate's probes."""
    probes = c.probes(screen.problem.data)
    k = min(int(place), len(probes) - 2)
    if place > len(probes) - 1 or k < 0:
        return Guess(c, None)
    low, high = probes[k], probes[k + 1]
    pairs = zip((low.value, *low.theta), (high.value, *high.theta), strict=True)
    value, *theta = (
        a * (b / a) ** (place - k) if a > 0 and b > 0 else a + (b - a) * (place - k)
        for a, b in pairs
    )
    return Guess(c, Probe(value, tuple(theta)), place)


def _guess(screen: Screen, c: Candidate, least: float) -> Guess:
    """Return the strength whose contribution, with the fit projected out, has an rms of `least`."""
    probes = c.probes(screen.problem.data)
    sizes = []
    for probe in probes:
        x = contribution_of(screen, c, probe)[:, None]
        sizes.append(rms(screen.projected(x)))
        if sizes[-1] > 3 * least:  # stronger probes are not needed
            break
    if c.mode == "columns":  # linear in the amplitude
        if sizes[0] < 1e-12:  # rounding: the drive does not excite it
            return Guess(c, None)
        return Guess(c, _amplified(probes[0], least / sizes[0]))
    reached = [k for k, size in enumerate(sizes) if size >= least]
    if not reached:
        return Guess(c, None)
    k = reached[0]
    if k == 0 or sizes[k - 1] <= 0:
        return _at(screen, c, float(k))
    part = float(np.clip(np.log(least / sizes[k - 1]) / np.log(sizes[k] / sizes[k - 1]), 0, 1))
    return _at(screen, c, k - 1 + part)
