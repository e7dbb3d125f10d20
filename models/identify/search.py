"""Search for a structure: saturation and rate first, then offset and linear dynamics if these show,
all with few operators and few rows."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from dehyst.models.identify.data.outliers import thin
from dehyst.models.identify.data.rows import Rows
from dehyst.models.identify.equations import Equations, Ints, Shape
from dehyst.models.identify.evidence import ProbableStructure, maximise_evidence
from dehyst.models.identify.fit import make_start
from dehyst.models.identify.lags import LagSearch
from dehyst.models.identify.setup import FitSetup
from dehyst.models.identify.structure import Trial, TriedStructure, choose_structure, pays, shows
from dehyst.models.identify.thresholds import space_thresholds
from dehyst.models.identify.tuning import TUNING
from dehyst.models.identify.uncertainty import estimate_noise, fit_trend
from dehyst.models.physics.dynamics import LEAD, Dynamics
from dehyst.models.recording import Bools, Floats
from dehyst.models.signals.rounding import quantum


class Search:
    """The candidates of one setup; with_lags: search for linear dynamics as well; drifts: the
    displacement has drifted, so that the model needs a constant, that of the end."""

    def __init__(
        self,
        setup: FitSetup,
        wanted: Sequence[Shape],
        progress: Callable[[str], None],
        with_lags: bool = True,
        drifts: bool = False,
    ) -> None:
        self.drifts = drifts
        self.setup, self.wanted, self.progress = setup, list(wanted), progress
        self.with_lags = with_lags
        self.r = space_thresholds(TUNING.coarse, setup.span, setup.wide)
        self.picks: list[Bools] = thin(setup.picks, TUNING.rows_compared)
        self.untold: list[Dynamics] = []  # lags whose side, drive or sensor, is not determined
        self.static_because = ""  # why rate-dependence was not chosen although it was tried

    def run(self) -> list[TriedStructure]:
        """Return all candidates, simple ones first."""
        tried: list[TriedStructure] = []
        for number, offset in enumerate(self.setup.offsets):
            shapes = self.wanted
            if number and offset != self.setup.running:  # no offset in a static model
                shapes = [s for s in shapes if s.rate or 2 not in s.powers]
                shapes = [s for s in shapes if s.rate or self.setup.running is not None]
            tried += self._try(shapes, offset, None)
        found = self._find_lags(tried) if self.with_lags else []
        shifted = {c.shape.rate for c in found if c.lag is not None and c.lag.short}
        kept = [replace(c, superseded=c.shape.rate in shifted) for c in tried]
        return kept + found

    def _try(
        self,
        shapes: Sequence[Shape],
        offset: float,
        lag: Dynamics | None,
        loose: bool | None = None,
    ) -> list[TriedStructure]:
        """Score each shape, linearised about the straight fit first and then about the best
        shape."""
        if not shapes:
            return []
        shapes = [replace(s, free_offset=s.rate and self.setup.is_free(offset)) for s in shapes]
        trial = Trial(self.setup, self.picks, self.r, offset, lag, loose)
        out: list[TriedStructure] = []
        for rate in sorted({s.rate for s in shapes}):
            same = [s for s in shapes if s.rate == rate]
            powers = tuple(sorted({p for s in same for p in s.powers}))
            flat = replace(same[0], powers=powers[:1] if powers[:1] == (0,) else ())
            start = make_start(self.r.size, flat, self.setup.slope, len(self.setup.rows))
            trial.linearise(start, flat, powers)
            straight = trial.score(flat, (1.0,))
            trial.linearise(straight.params, flat, powers)
            found: list[TriedStructure] = []
            for turn in range(2):
                for shape in same:
                    self.progress(f"trying: {shape.name}")
                strengths = self.setup.strengths
                strengths = strengths[::2] if turn else strengths[len(strengths) // 2 :][:1]
                found = [trial.score(shape, strengths) for shape in same]
                if turn == 0 and powers != (0,):
                    best = choose_structure(found)
                    trial.linearise(trial.refine(best), best.shape, powers)
            out += found
        return out

    def _bests(self, tried: Sequence[TriedStructure]) -> list[TriedStructure]:
        """Return the chosen static and the chosen rate-dependent candidate."""
        groups = [[c for c in tried if c.shape.rate == rate] for rate in (False, True)]
        return [choose_structure(group) for group in groups if group]

    def choose(self, tried: Sequence[TriedStructure]) -> TriedStructure:
        """Return the chosen structure. Rate-dependence is chosen only if it predicts segments of
        the drive that were held out, because on one loop rate and place are correlated."""
        bests = self._bests(tried)
        best = self._choose_side(bests[0]) if len(bests) == 1 else self._choose_rate(*bests)
        return self._drop_constant(best)

    def _choose_side(self, best: TriedStructure) -> TriedStructure:
        """Return the candidate with its lag on the side that predicts better."""
        if not best.has_lag:
            return best
        same = [s for s in self.wanted if s.rate == best.shape.rate]

        def choose(lag: Dynamics) -> TriedStructure:
            return choose_structure(self._try(same, best.offset, lag))

        sought = LagSearch(self.setup, self.picks, self.r, best)
        best, decided = sought.compare_sides(choose)
        if best.lag is not None and not decided:
            self.untold.append(best.lag)
        return best

    def _choose_rate(self, static: TriedStructure, rate: TriedStructure) -> TriedStructure:
        """Return the static or the rate-dependent candidate, with its lag on the better side."""
        if rate.held.sum() < TUNING.minor * static.held.sum():
            return self._choose_side(rate)
        self.static_because = NO_GAIN
        if not pays(static, rate):
            return self._choose_side(static)
        whole = self.setup.by_ways()
        scored = []
        for one in (static, rate):
            trial = Trial(whole, self.picks, self.r, one.offset, one.lag, one.loose)
            trial.linearise(one.params, one.shape, one.shape.powers)
            scored.append(trial.score(one.shape, whole.strengths[::2]))
        noise = self._measure_noise(rate)
        beyond = _compare_beyond(noise, *scored)
        left = float(scored[1].held.sum() / scored[0].held.sum())
        enough = left < TUNING.most and pays(scored[0], scored[1], clear=0.0)
        enough = enough or beyond < TUNING.minor
        if enough and self._is_no_place(static, rate):
            self.static_because = ""
            return self._choose_side(rate)
        static = self._choose_side(static)
        # with a lag, a static stage is no simpler than one with rate-dependent weights, and the
        # drive's segments need not distinguish the two
        alike = _compare_beyond(noise, static, rate) >= TUNING.minor
        if static.has_lag and not alike and pays(static, rate):
            self.static_because = ""
            return self._choose_side(rate)
        self.static_because = AS_PLACE if enough else NO_SEGMENTS
        return static

    def _is_no_place(self, static: TriedStructure, rate: TriedStructure) -> bool:
        """Return whether the rate predicts more than a static stage with as many unknowns, whose
        slopes depend on the place; also true if the rate removes more than a third of the static
        misfit."""
        if rate.held.sum() < TUNING.most * static.held.sum():
            return True
        return pays(self._score_rival(static), rate)

    def find_ramp(self, found: TriedStructure, period_s: float) -> float:
        """Return the drift of one recording [displacement/s] by a straight line through the offsets
        of the periods of its drive, fitted together with the candidate; 0 if it is not certain. A
        fit without these offsets takes a part of the drift for hysteresis and curve."""
        trial = DriftTrial(self.setup, self.picks, self.r, found, period_s)
        count = trial.like.shifts.size + 1
        if count < FEWEST_PERIODS:
            return 0.0
        params = trial.refine(trial.score(found.shape, self.setup.strengths[::2]))
        offsets = self.setup.sign * np.concatenate([[0.0], params.shifts])
        slope, doubt = fit_trend(offsets)
        (one,) = self.setup.rows
        whole_s = float(one.t_s[-1] - one.t_s[0])
        return slope * count / whole_s if abs(slope) > TUNING.certain * doubt else 0.0

    def outlasts_drift(
        self, found: TriedStructure, tried: Sequence[TriedStructure], period_s: float
    ) -> bool:
        """Return whether dynamics remove the larger part of what every static candidate leaves,
        each period of the drive with its own offset. With one period, a drift, or a change of size
        in a stage of another class, looks like a lag or a rate-dependence. So does creep, which
        trails by the same part of a period at every rate; it also goes on after each change of
        size, so that an equally short lag does not explain all of it. The result from many
        recordings is accepted without this test, as each has its own offset already."""
        if 2 * len(self.setup.rows) > MOST_PERIODS:
            return True

        def left(one: TriedStructure) -> float:
            trial = DriftTrial(self.setup, self.picks, self.r, one, period_s)
            return float(trial.score(one.shape, self.setup.strengths[::2]).held.sum())

        static = [left(c) for c in tried if c.lag is None and not c.shape.rate]
        if not static:
            return True
        least, own = min(static), left(found)
        if found.lag is None or found.lag.delay_s > TRAILS * period_s:
            return own < TUNING.half * least
        noise = self._measure_noise(found) * float(found.sizes.sum())
        return own - noise < TUNING.minor * (least - noise)

    def compare_without_lag(self, found: TriedStructure, tried: Sequence[TriedStructure]) -> float:
        """Return the misfit of a candidate with a lag over that of the best without one, both
        beyond the noise."""
        rate = found.shape.rate
        without = [c for c in tried if not c.has_lag and c.shape.rate == rate]
        if not without:
            return 0.0
        least = min(without, key=lambda c: float(c.held.sum()))
        return _compare_beyond(self._measure_noise(found), least, found)

    def _score_rival(self, static: TriedStructure) -> TriedStructure:
        """Score the static structure with slopes that depend on the place."""
        shape = replace(static.shape, rate=True)
        both = static.params._replace(slopes=np.tile(static.params.slopes, 2))
        trial = PlaceTrial(self.setup, self.picks, self.r, static.offset, static.lag, static.loose)
        trial.linearise(both, shape, shape.powers)
        return trial.score(shape, self.setup.strengths[::2])

    def _measure_noise(self, found: TriedStructure) -> float:
        """Return the noise power in the residuals of a candidate."""
        errors = self.setup.residuals(self.r, found.shape, found.params, found.offset, found.lag)
        rows = self.setup.rows
        noises = [estimate_noise(e, quantum(one.y)) for e, one in zip(errors, rows, strict=True)]
        return float(np.nanmedian(noises)) ** 2

    def _drop_constant(self, best: TriedStructure) -> TriedStructure:
        """Return the candidate without its constant if a de-energised stage shows none (Eq. 3 has
        none): a parameter that is absent should not be estimated."""
        if self.drifts or not self.setup.virgin or 0 not in best.shape.powers:
            return best
        shape = replace(best.shape, powers=tuple(p for p in best.shape.powers if p))
        trial = Trial(self.setup, self.picks, self.r, best.offset, best.lag, best.loose)
        trial.linearise(best.params, best.shape, best.shape.powers)
        without = best
        for loose in {best.loose, False}:  # the bounds may call for a constant that the data do not
            trial.loose = loose
            now, rest = (trial.score(s, (best.strength,)) for s in (best.shape, shape))
            if not rest.invertible or shows(rest, now, TUNING.trace) or pays(rest, now):
                return best
            without = rest if loose == best.loose else without
        return without

    def _find_lags(self, tried: Sequence[TriedStructure]) -> list[TriedStructure]:
        """Return candidates with linear dynamics if the drive has a rate; none for a rate-dependent
        structure that predicts far worse than the best. A static one may do so because it lacks a
        lag, which rate-dependent weights imitate if the drive has two rates."""
        out: list[TriedStructure] = []
        least = min(c.held_rms for c in tried)
        for best in self._bests(tried):
            if self.setup.rate_max <= 0.0:
                continue
            if best.shape.rate and best.held_rms > TUNING.far * least:
                continue
            self.progress("looking for a lag")
            if best.shape.rate:
                out += self._try_derivative(best)
            same = [s for s in self.wanted if s.rate == best.shape.rate]
            for found in LagSearch(self.setup, self.picks, self.r, best).find():
                short = found.lag is not None and found.lag.short
                for loose in (True,) if short else (False, True):
                    out += self._try(same, best.offset, found.lag, loose)
        return out

    def _try_derivative(self, best: TriedStructure) -> list[TriedStructure]:
        """Return candidates whose rate is the derivative at the sample, as for a stage in
        continuous time, instead of the difference from the sample before; none if such a candidate
        fits the recording clearly worse, or half a sample is longer than any lead.

        This is a convention and not a richer model, so the evidence decides.
        """
        period = float(np.median([one.period_s for one in self.setup.rows]))
        if period > TUNING.longest_lag_s:
            return []
        half = Dynamics(LEAD, "drive", (0.5 * period,))
        trial = Trial(self.setup, self.picks, self.r, best.offset, half)
        trial.linearise(best.params, best.shape, best.shape.powers)
        most = best.fitted.sum() * (1.0 + TUNING.trace)
        if trial.score(best.shape, (best.strength,)).fitted.sum() > most:
            return []
        found = self._try([s for s in self.wanted if s.rate], best.offset, half)
        before = self._weigh(best)
        shapes = {best.shape, choose_structure(found).shape}
        at_sample = [self._weigh(c, before.noise) for c in found if c.shape in shapes]
        return found if max(w.evidence for w in at_sample) > before.evidence else []

    def _weigh(self, found: TriedStructure, noise: float | None = None) -> ProbableStructure:
        """Return the evidence for a candidate, linearised about itself."""
        trial = Trial(self.setup, self.picks, self.r, found.offset, found.lag, found.loose)
        trial.linearise(found.params, found.shape, found.shape.powers)
        trial.linearise(trial.refine(found), found.shape, found.shape.powers)
        return maximise_evidence(trial, found.shape, noise)


def _compare_beyond(noise: float, static: TriedStructure, rate: TriedStructure) -> float:
    """Return the rate-dependent misfit over the static misfit, both beyond noise of this power."""
    here, there = (float(c.held.sum() - noise * c.sizes.sum()) for c in (rate, static))
    return max(here, 0.0) / there if there > 0.0 else 1.0


class PlaceTrial(Trial):
    """Trial with slopes that depend on the place of an operator, not on the rate.

    The residual of a static hysteresis of another class correlates with place and with rate alike,
    because a drive passes each place at its own rate. The rate has to predict more than a static
    stage with as many unknowns does: a Preisach plane whose density changes along its diagonal.
    """

    def gather(self, picks: Sequence[Bools]) -> list[Equations]:
        """Return the equations of the picked rows, with the middle of H_i and H_i+1 in place of the
        rate."""
        setup = self.setup
        middle, half = setup.middle - setup.centre(self.offset), 0.5 * setup.span
        out = []
        for lot in super().gather(picks):
            plays = np.cumsum(lot.d[:, ::-1], axis=1)[:, ::-1]
            place = (plays - 0.5 * lot.d - middle) / half
            out.append(lot._replace(e=lot.d * place, pace=np.zeros(lot.pace.size)))
        return out


class DriftTrial(Trial):
    """Trial of one candidate in which each period of the drive has an offset of its own, about the
    candidate's parameters."""

    def __init__(
        self,
        setup: FitSetup,
        picks: Sequence[Bools],
        r: Floats,
        candidate: TriedStructure,
        period_s: float,
    ) -> None:
        self.periods, count = _number_periods(setup.rows, period_s)
        super().__init__(setup, picks, r, candidate.offset, candidate.lag, candidate.loose)
        params = candidate.params._replace(shifts=np.zeros(count - 1))
        self.linearise(params, candidate.shape, candidate.shape.powers)

    def gather(self, picks: Sequence[Bools]) -> list[Equations]:
        """Return the equations of the picked rows, with the number of the period in place of that
        of the recording."""
        lots = super().gather(picks)
        used = [
            number[pick & ~np.isnan(one.u)]
            for one, pick, number in zip(self.setup.rows, picks, self.periods, strict=True)
        ]
        ends = np.cumsum([lot.y.size for lot in lots])[:-1]
        numbers = np.split(np.concatenate(used), ends)
        return [lot._replace(group=at) for lot, at in zip(lots, numbers, strict=True)]


NO_GAIN = "this is not a significant improvement"
NO_SEGMENTS = "but they do not predict whole segments of the drive that were held out"
AS_PLACE = "but slopes that depend on the position predict equally well"

TRAILS = 0.25 * 0.08 / math.log(10.0)
"""Part of a period by which creep of 8 % a decade, as strong as a piezo's may be, trails: an angle
of (pi / 2) 0.08 / ln 10, over the 2 pi of a turn."""
FEWEST_PERIODS = 6
"""Least number of periods whose offsets show a straight drift and not chance."""
MOST_PERIODS = 100
"""Largest number of offsets: if there are more periods, several share one."""


def _number_periods(rows: Sequence[Rows], period_s: float) -> tuple[list[Ints], int]:
    """Return the number of its period for each row of each recording, and the count of all."""
    whole = sum(float(one.t_s[-1] - one.t_s[0]) for one in rows)
    long_s = max(period_s, whole / (MOST_PERIODS - len(rows)))
    numbers, begun = [], 0
    for one in rows:
        count = max(1, int((one.t_s[-1] - one.t_s[0]) / long_s))
        at = (one.t_s - one.t_s[0]) / max(one.t_s[-1] - one.t_s[0], 1e-300) * count
        numbers.append((begun + np.minimum(at, count - 1)).astype(np.int64))
        begun += count
    return numbers, begun
