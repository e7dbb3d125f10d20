"""Find which linear dynamics, if any, a recording needs in addition to its hysteresis.

A lag changes every term of the model, so each trial rebuilds its equations, with few operators and
few rows. A shift by a fraction of a sample is searched with narrow operators free, because these
show it best; a longer lag or delay with all of them bounded, because free operators would imitate
its effect: a reading that continues after the drive has turned.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from dehyst.models.identify.data.rows import Rows
from dehyst.models.identify.dynamics import SAME
from dehyst.models.identify.setup import FitSetup
from dehyst.models.identify.structure import Trial, TriedStructure, pays, predicts_better, shows
from dehyst.models.identify.thresholds import regrid, space_thresholds
from dehyst.models.identify.tuning import TUNING
from dehyst.models.physics.dynamics import DELAY, LAG, SECOND, Dynamics
from dehyst.models.recording import Bools, Floats

PLACES = ("drive", "sensor")
GOLDEN = (3.0 - 5.0**0.5) / 2.0  # smaller part of a golden section
DELAYS = (0.5, 1.5, 5.0, 15.0)  # sampling periods, by factors of 3: the search refines between
LAGS = (0.5, 3.0, 12.0, 40.0, 120.0, 360.0)  # sampling periods, by factors of 3 to 6, likewise


class LagSearch:
    """Fits with one linear dynamics for a given structure."""

    def __init__(
        self, setup: FitSetup, picks: Sequence[Bools], r: Floats, candidate: TriedStructure
    ) -> None:
        self.setup, self.picks, self.r, self.candidate = setup, picks, r, candidate
        self.fine = space_thresholds(TUNING.few_operators, setup.span)
        fine = regrid(candidate.params, r, self.fine, candidate.shape)
        trial = Trial(setup, picks, self.fine, candidate.offset)
        trial.linearise(fine, candidate.shape, candidate.shape.powers)
        finest = trial.score(candidate.shape, TUNING.strengths[:1]).params
        self.begin = {True: (self.fine, finest), False: (r, candidate.params)}
        self.noise = float(candidate.fitted.sum() / candidate.sizes.sum())
        longest = TUNING.half * setup.span / max(map(_find_mean_rate, setup.rows))
        self.longest = min(longest, TUNING.longest_lag_s)
        periods = [one.period_s for one in setup.rows]
        self.period = float(np.median(periods))
        # what is held from a sample on is a period late, which must be one for all recordings
        alike = np.ptp(periods) <= SAME * self.period
        self.steps_late_s = (0.0, self.period) if alike else (0.0,)

    def find(self) -> list[TriedStructure]:
        """Return the candidate with each of the dynamics that the recording may need: the best of
        the drive, and a lag of the sensor, of second order too if it pays; empty where none helps.

        A shift by a fraction of a sample needs a gain in the fit alone; a longer lag must predict
        held-out stretches clearly better, because a lag also gains a little where the hysteresis is
        of another class than the model's. Which side it is on may not show yet, since the structure
        was chosen without a lag. A lag within one sample shows neither side, and is the drive's.
        Rows further apart than the longest lag show none.
        """
        if self.period > TUNING.longest_lag_s:
            return []
        without = {loose: self._misfit(None, loose) for loose in (True, False)}
        shift = self._find_delay(True, without[True], without[True] * (1.0 - TUNING.trace))
        # the bounded fit must beat the one without a lag, and the held-out error of the free
        # operators by a third of the margin (TUNING.minor) that the final decision requires
        known = float(self.candidate.held.sum())
        near = 1.0 - TUNING.minor / 3.0
        enough = min(without[False] * (1.0 - TUNING.trace), near * known)
        delay = self._find_delay(False, without[False], enough)
        drive, sensor = (self._find_lag(place, enough) for place in PLACES)
        second = self._find_second(sensor) if sensor is not None else None
        of_drive = [self._score(lag) for lag in (shift, delay, drive) if lag is not None]
        longer = [lag for lag in (sensor, second) if lag is not None and lag.delay_s > self.period]
        of_sensor = [self._score(lag) for lag in longer]
        at_drive, at_sensor = (
            [c for c in group if c.lag is not None and self._helps(c, c.lag)]
            for group in (of_drive, of_sensor)
        )
        first = at_sensor[:1]
        higher = [c for c in at_sensor[1:] if pays(first[0], c, clear=0.0)]
        return sorted(at_drive, key=lambda c: c.held_rms)[:1] + first + higher

    def _helps(self, scored: TriedStructure, lag: Dynamics) -> bool:
        if not lag.delay_s > TUNING.far * self._measure_jitter(scored):
            return False
        if lag.delay_s > self.period:
            now = self.candidate
            better = scored.fitted.sum() < now.fitted.sum()
            return bool(better and scored.held.sum() < (1.0 - TUNING.minor) * now.held.sum())
        shape, lightest = self.candidate.shape, TUNING.strengths[:1]
        here, there = (self._trial(x, True).score(shape, lightest) for x in (None, lag))
        return shows(here, there)

    def _measure_jitter(self, scored: TriedStructure) -> float:
        """Return the timing jitter of the readings, as estimated from the fit [s]: from the part of
        the error from row to row that grows with the speed (the error of a wrong structure is
        smooth). If readings are late by chance, they are also late on average."""
        setup, (r, _) = self.setup, self.begin[False]
        error = setup.residuals(r, scored.shape, scored.params, scored.offset, scored.lag)
        powers, speeds = [], []
        for one, e, pick in zip(setup.rows, error, self.picks, strict=True):
            at = np.flatnonzero(~np.isnan(e))
            speed = np.gradient(one.y[at] - e[at], one.t_s[at])[1:]
            keep = (pick[at][1:] & pick[at][:-1]) & (np.diff(at) == 1)
            powers.append(0.5 * np.diff(e[at])[keep] ** 2)
            speeds.append(speed[keep] ** 2)
        x, y = np.concatenate(speeds), np.concatenate(powers)
        if not x.size:  # no two consecutive readings, which would show it
            return 0.0
        x = x - x.mean()
        return float(np.sqrt(max(0.0, float(x @ y) / max(float(x @ x), 1e-300))))

    def _score(self, lag: Dynamics) -> TriedStructure:
        """Score the structure with this lag by its prediction."""
        trial, shape = self._trial(lag, False), self.candidate.shape
        return trial.score(shape, TUNING.strengths[::2])

    def compare_sides(
        self, choose: Callable[[Dynamics], TriedStructure]
    ) -> tuple[TriedStructure, bool]:
        """Return the candidate with its lag on the side that predicts better, each side with its
        own structure, input and time constant; and whether it is better by more than chance.

        The lag is assigned to the drive if both sides predict equally. choose: returns the
        structure for given dynamics.
        """
        given = self.candidate
        assert given.lag is not None
        if given.lag.delay_s <= self.period:
            return given, False
        one = Dynamics(LAG, "drive", (given.lag.delay_s,))
        before, behind = (self._choose_input(replace(one, place=at), choose) for at in PLACES)
        assert behind.lag is not None
        late = self._refine(replace(one, kind=DELAY), choose)
        second = choose(self._find_second(behind.lag, behind))
        of_drive, of_sensor = [before, late], [behind, second]
        (of_drive if given.lag.place == "drive" else of_sensor).append(given)
        drive, sensor = (min(group, key=lambda c: c.held_rms) for group in (of_drive, of_sensor))
        assert sensor.lag is not None
        richer = sensor.lag.kind == SECOND  # than a lag or a delay
        better = pays(drive, sensor, clear=0.0) if richer else predicts_better(sensor, drive)
        if better:
            return sensor, True
        # a delay is the same before and after the hysteresis
        decided = drive.lag is not None and drive.lag.sided
        return drive, decided and predicts_better(drive, sensor)

    def _choose_input(
        self, lag: Dynamics, choose: Callable[[Dynamics], TriedStructure]
    ) -> TriedStructure:
        """Return the best candidate with a lag of this kind and side, whose input moves in lines,
        or in steps if that predicts better by more than chance: steps held since the sample before,
        or from each sample on."""
        lines = self._refine(lag, choose)
        steps = [self._refine(replace(lag, held=True, late_s=s), choose) for s in self.steps_late_s]
        better = [c for c in steps if predicts_better(c, lines)]
        return min([lines, *better], key=lambda c: c.held_rms)

    def _refine(
        self, lag: Dynamics, choose: Callable[[Dynamics], TriedStructure]
    ) -> TriedStructure:
        """Alternately choose the structure for a lag and search the lag for that structure: a
        structure that was chosen without a lag partly imitates it."""
        found = choose(lag)
        for _ in range(TUNING.rounds):
            (before,) = lag.theta
            trials = (before / TUNING.near, before, TUNING.near * before)
            near = sorted({min(tau, self.longest) for tau in trials})

            def cost(tau: float, like: Dynamics = lag, about: TriedStructure = found) -> float:
                return self._misfit(replace(like, theta=(tau,)), False, about)

            tau = _search(cost, near, 3)  # steps: the next round refines it
            if tau is None:
                break
            lag = replace(lag, theta=(tau,))
            found = choose(lag)
            if abs(tau / before - 1.0) < TUNING.crumb:
                break
        return found

    def _trial(
        self,
        lag: Dynamics | None,
        fine: bool,
        split: bool = True,
        about: TriedStructure | None = None,
    ) -> Trial:
        c = about or self.candidate
        r, params = self.begin[fine] if about is None else (self.r, c.params)
        trial = Trial(self.setup, self.picks, r, c.offset, lag, split=split, rate=c.shape.rate)
        trial.linearise(params, c.shape, c.shape.powers)
        return trial

    def _misfit(
        self, lag: Dynamics | None, loose: bool, about: TriedStructure | None = None
    ) -> float:
        """Return the misfit with a lag. about: the structure and its parameters; None: the given
        candidate."""
        c = about or self.candidate
        strength = TUNING.strengths[0] if loose else min(c.strength, TUNING.strengths[2])
        trial = self._trial(lag, loose, False, about)
        return trial.misfit(c.shape, strength, self.noise, loose)

    def _find_delay(self, loose: bool, without: float, enough: float) -> Dynamics | None:
        def make(periods: float) -> Dynamics | None:
            return Dynamics(DELAY, "drive", (periods * self.period,)) if periods > 0.0 else None

        grid = self._grid(DELAYS)
        best = _search(lambda x: self._misfit(make(x), loose), grid, 6, enough, {0.0: without})
        return None if best is None else make(best)

    def _grid(self, periods: Sequence[float]) -> list[float]:
        most = max(self.longest / self.period, periods[0])
        shorter = [p for p in periods if p < most]
        return [*shorter, min(most, periods[-1])]

    def _find_lag(self, place: str, enough: float) -> Dynamics | None:
        def make(log: float) -> Dynamics:
            return Dynamics(LAG, place, (float(np.exp(log)) * self.period,))

        best = _search(lambda x: self._misfit(make(x), False), np.log(self._grid(LAGS)), 6, enough)
        return make(best) if best is not None else None

    def _find_second(self, first: Dynamics, about: TriedStructure | None = None) -> Dynamics:
        def make(log_f: float, damping: float) -> Dynamics:
            theta = (float(np.exp(log_f)), float(damping))
            return replace(first, kind=SECOND, place="sensor", theta=theta)

        # it is as late as the lag at low frequencies, damping / (pi f), and 0.7 hardly overshoots
        log_f, damping = float(np.log(0.7 / (np.pi * first.theta[0]))), 0.7
        near, damped = np.log((0.6, 1.0, 1.7)), (TUNING.half, 0.8, 1.3)  # factors of f; damping

        def cost(log_f: float, damping: float) -> float:
            return self._misfit(make(log_f, damping), False, about)

        for _ in range(2):  # along one of the two, then the other, twice
            by_f = _search(partial(cost, damping=damping), log_f + near, 3)
            log_f = log_f if by_f is None else by_f
            by_z = _search(partial(cost, log_f), damped, 3)
            damping = damping if by_z is None else by_z
        return make(log_f, max(damping, TUNING.half))


def _find_mean_rate(one: Rows) -> float:
    """Return the total travel of a drive over its duration [drive unit/s]: for a drive in steps
    this is the rate at which its levels change, not the slope of its edges."""
    known = ~np.isnan(one.u)
    way = float(np.abs(np.diff(one.u[known])).sum())
    return max(way, 1e-300) / float(np.ptp(one.t_s[known]))


def _search(
    cost: Callable[[float], float],
    grid: Sequence[float] | Floats,
    steps: int,  # golden sections: 3 leave a quarter of the interval, 6 a twentieth
    enough: float = np.inf,
    known: dict[float, float] | None = None,
) -> float | None:
    """Return the minimum of the cost: the best of a grid, refined between its neighbours; None if
    the best of the grid is not below `enough`. known: costs that need not be computed."""
    known = {} if known is None else known
    for v in grid:
        known[float(v)] = cost(float(v))
    best = min(known, key=lambda v: known[v])
    if known[best] >= enough:
        return None
    for _ in range(steps):
        order = sorted(known)
        at = order.index(best)
        left = order[at - 1] if at > 0 else best
        right = order[at + 1] if at + 1 < len(order) else best
        wide = right if right - best > best - left else left
        new = _vertex(known, left, best, right)
        if not left < new < right or abs(new - best) < 0.05 * abs(wide - best):  # no progress
            new = best + GOLDEN * (wide - best)
        known[new] = cost(new)
        best = min(known, key=lambda v: known[v])
    return best


def _vertex(known: dict[float, float], left: float, middle: float, right: float) -> float:
    """Return the vertex of the parabola through three points."""
    if left == middle or right == middle:
        return middle
    a, b = known[left] - known[middle], known[right] - known[middle]
    x, y = left - middle, right - middle
    below = 2.0 * (a * y - b * x)
    return middle + (a * y * y - b * x * x) / below if below != 0.0 else middle
