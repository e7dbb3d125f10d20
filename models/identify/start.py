"""Check whether a recording that seems to begin with a de-energised stage really does.

A drive that starts at zero may follow an hour of exercise. If such a stage were taken for
de-energised, it would begin on the virgin curve, and the fit would bend every operator, and find
lags, to compensate. So the recording is fitted from several starts: de-energised, and as if the
drive had come back to zero from half its range and from all of it. The stage counts as de-energised
unless another start leaves clearly less misfit.

Effects of time would mislead: slow creep costs the virgin curve as much as a wrong start does, and
a lag or a drift hides both. So every fit has a few additional columns for them: relaxations of the
drive by groups of time constants, as in lags and creep, and a slow drift.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dehyst.models.identify.bounded import bounded_solve
from dehyst.models.identify.data.outliers import thin
from dehyst.models.identify.data.rows import Rows
from dehyst.models.identify.equations import Equations, Normal, Params, Shape, linearise
from dehyst.models.identify.fit import make_bounds, make_start
from dehyst.models.identify.setup import FitSetup
from dehyst.models.identify.thresholds import Prior, space_thresholds
from dehyst.models.identify.tuning import TUNING
from dehyst.models.identify.uncertainty import estimate_noise
from dehyst.models.recording import Floats
from dehyst.models.signals.filters import add_relaxation
from dehyst.models.signals.rounding import quantum

POWERS = (0, 2, 3)  # of z, in addition to the first
FAST = (0.5, 1.3, 3.2, 8.0)  # sampling periods: time constants that represent lags and leads
SLOWEST = 3.0  # times the recording's length: the slowest time constant of creep
CREEPS = 3  # groups of relaxations that represent creep
DRIFT = (1, 2, 3)  # powers of time


def start_agrees(setup: FitSetup, rate: bool) -> bool:
    """Return whether no other start fits the recording clearly better than the de-energised one.

    rate: the weights may depend on the rate. True if no de-energised start is assumed.
    """
    if not setup.virgin:
        return True
    size = TUNING.most_rows
    rows = [_cut(one, size) for one in setup.rows]
    picks = thin([pick[:size] for pick in setup.picks], TUNING.rows_compared)
    begun = replace(setup, rows=rows, picks=picks)
    fit = _StartFit(begun, Shape(rate and setup.rate_max > 0.0, POWERS))
    left = fit.misfit(0.0)
    beyond = left - _estimate_noise_power(begun)
    enough = left - max(TUNING.quarter * beyond, TUNING.small * left)
    # a return from an end within half the range displaces narrow operators only
    ways = [way for way in (setup.drive_max, setup.drive_min) if abs(way) > 0.5 * setup.span]
    # half and all of the excursion to that end: a return to zero leaves displaced only operators
    # narrower than the excursion, so the two cover a partial and a full exercise
    return all(fit.misfit(m * way) >= enough for m in (0.5, 1.0) for way in ways)


def _estimate_noise_power(setup: FitSetup) -> float:
    """Return the sum of squares of the readings' noise over the picked rows."""
    noises = [
        estimate_noise(one.y - setup.sign * setup.slope * one.u, quantum(one.y))
        for one in setup.rows
    ]
    counts = [int(np.count_nonzero(pick)) for pick in setup.picks]
    return sum(n * e**2 for n, e in zip(counts, noises, strict=True) if np.isfinite(e))


class _StartFit:
    """Fits of the hysteresis together with effects of time, from any start."""

    def __init__(self, setup: FitSetup, shape: Shape) -> None:
        self._setup, self._shape = setup, shape
        self._r = space_thresholds(TUNING.few_operators, setup.span, whole=True)
        self._prior = Prior(self._r, setup.slope, 0.5 * setup.span)
        parts = [_describe_time(one)[p] for one, p in zip(setup.rows, setup.picks, strict=True)]
        self._beside = np.concatenate(parts)
        self._low = np.r_[-np.inf, np.zeros(CREEPS), np.full(len(DRIFT), -np.inf)]

    def misfit(self, came_from: float) -> float:
        """Return the sum of squared errors if the drive came back from there to zero."""
        rows = [
            replace(one, came_from=came_from) if one.virgin else one for one in self._setup.rows
        ]
        setup = replace(self._setup, rows=rows)
        lots = setup.equations(setup.picks, self._r, 0.0, rate=self._shape.rate)
        flat = Shape(self._shape.rate, (0,))
        begin = make_start(self._r.size, flat, setup.slope, len(rows))
        straight, _ = self._solve(lots, flat, begin)
        c = np.array([float(straight.c[0]), *(0.0 for _ in self._shape.powers[1:])])
        return self._solve(lots, self._shape, straight._replace(c=c))[1]

    def _solve(
        self, lots: Sequence[Equations], shape: Shape, about: Params
    ) -> tuple[Params, float]:
        """Return the parameters of the equations linearised about others, and their misfit."""
        more = self._beside.shape[1]
        p0 = np.concatenate([about.packed(), np.zeros(more)])
        gram, right, misfit, at = np.zeros((p0.size, p0.size)), np.zeros(p0.size), 0.0, 0
        for lot in lots:
            jac, err = linearise(lot, shape, about)
            jac = np.hstack([jac, self._beside[at : at + err.size]])
            gram += jac.T @ jac
            right += jac.T @ err
            misfit += float(err @ err)
            at += err.size
        moved = gram @ p0
        total = misfit + float(p0 @ (2.0 * right + moved))
        normal = Normal(gram, right + moved, total, at, misfit)
        low, high = make_bounds(about, self._setup.limits)
        low, high = np.concatenate([low, self._low]), np.concatenate([high, np.full(more, np.inf)])
        noise = normal.noise_at(bounded_solve(gram, normal.right, low, high)[0])
        whole = self._prior.add_to(normal, shape.rate, 1.0, noise)
        p, _ = bounded_solve(whole.gram, whole.right, low, high)
        return Params.unpacked(p[: p.size - more], about), normal.misfit_at(p)


def _cut(one: Rows, size: int) -> Rows:
    """Return the first rows of a recording."""
    if one.u.size <= size:
        return one
    names = ("t_s", "u", "rate", "y", "use", "settled", "piece")
    parts = {name: getattr(one, name)[:size] for name in names}
    return replace(one, resets=one.resets[one.resets < size], **parts)


def _describe_time(one: Rows) -> Floats:
    """Return the contributions (N, columns) of a lag, creep and a slow drift, in units of the
    drive; 0 where the drive is unknown."""
    known = np.flatnonzero(~np.isnan(one.u))
    t, u = one.t_s[known], one.u[known]
    fresh = np.isin(known, one.resets)
    fresh[0] = True
    steps = np.diff(t, prepend=t[0] - one.period_s)
    length = float(t[-1] - t[0])
    first, last = 10.0 * one.period_s, SLOWEST * length  # longer than FAST
    count = max(CREEPS, round(3.0 * np.log10(last / first)))  # 3 to a decade: their sum is smooth
    groups = [np.array(FAST) * one.period_s]
    groups += np.array_split(np.geomspace(first, last, count), CREEPS)
    columns = np.zeros((one.u.size, len(groups) + len(DRIFT)))
    for place, taus in enumerate(groups):
        out = add_relaxation(
            u[:, None].copy(), taus, steps, fresh, 1.0 / taus.size, float(taus.size)
        )
        columns[known, place] = out[:, 0] - u
    ago = 2.0 * (t - t[0]) / length - 1.0
    for place, power in enumerate(DRIFT, len(groups)):
        columns[known, place] = np.ptp(u) * ago**power
    return columns
