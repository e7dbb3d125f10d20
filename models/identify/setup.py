"""The setup shared by all fits to some recordings: rows, ranges, sign, bounds.

It makes the equations, the model that given parameters represent, and the residuals of every row.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.polynomial import Polynomial

from dehyst.models.cascade.simulate import simulate
from dehyst.models.errors import BadRecording
from dehyst.models.hysteresis.z_range import find_least_slope, find_rates
from dehyst.models.identify.data.folds import assign_pieces
from dehyst.models.identify.data.outliers import measure_deviation, sample, thin
from dehyst.models.identify.data.rows import (
    Rows,
    find_acceleration,
    find_drive_range,
    find_rate_range,
)
from dehyst.models.identify.equations import (
    Equations,
    Ints,
    Params,
    Shape,
    gather_equations,
    make_equations,
)
from dehyst.models.identify.tuning import TUNING
from dehyst.models.model import Hysteresis, Model, Validity
from dehyst.models.physics.dynamics import Dynamics
from dehyst.models.recording import Bools, Floats
from dehyst.models.signals.lone import (
    BOTH,
    DRIVEN,
    JUMP,
    measure_driven_jumps,
    measure_jumps,
    measure_peaks,
)
from dehyst.models.units import how_many

TWO = 0.3
"""Least jump of a wild reading, as a share of its deviation: each of two in succession has a third,
the peak of a mode that rings over ten rows a twentieth."""
INNER = (0.02, 0.98)
"""Quantiles of a reading between which its usual range lies."""


@dataclass(frozen=True)
class FitSetup:
    """The setup that all candidates share.

    picks: rows of each recording that are used as equations; sign: of the displacement's change
    with the drive; limits: lowest and highest slope allowed, or None; slope: the mean slope;
    rate_max, acceleration_max: largest rate of the drive and largest change of the rate; period_s:
    the longest sampling period; virgin: at least one recording begins de-energised; folds: number
    of folds; running: offset for a drive that comes from far away, or None; by_turns: after a turn,
    a slope is bounded up to the rate that the drive can have there, not up to the largest rate.
    """

    rows: Sequence[Rows]
    picks: Sequence[Bools]
    drive_min: float
    drive_max: float
    rate_max: float
    acceleration_max: float
    period_s: float
    sign: float
    slope: float
    limits: tuple[float, float] | None
    virgin: bool
    folds: int
    notes: tuple[str, ...] = ()
    running: float | None = None
    by_turns: bool = False

    @property
    def offsets(self) -> tuple[float, ...]:
        """Drive offsets to try for the rate-dependence: the de-energised state; if the recording
        begins elsewhere, also the middle of the range, about which the offset is fitted; if
        everything depends on the start, also the offset of a drive that comes from far away."""
        if self.virgin:
            return (0.0,)
        reach = TUNING.far * self.span
        found = (self.middle, 0.0) if 0.0 < abs(self.middle) <= reach else (self.middle,)
        return found if self.running is None else (*found, self.running)

    @property
    def wide(self) -> bool:
        """Whether operators wider than half the range move, so that thresholds must reach the
        range."""
        return self.virgin or self.running is not None

    @property
    def middle(self) -> float:
        """The middle of the drive range."""
        return 0.5 * (self.drive_min + self.drive_max)

    def centre(self, offset: float) -> float:
        """Return the drive offset of the plays: the middle of the range if the plays are settled,
        so that z is small and its powers are well distinguished; else the offset itself."""
        return offset if self.virgin or self.running is not None else self.middle

    def is_free(self, offset: float) -> bool:
        """Return whether the offset of the rate-dependence is fitted about this offset."""
        return not self.virgin and self.running is None and offset == self.middle

    @property
    def strengths(self) -> tuple[float, ...]:
        """Strengths of the prior to try; only strong ones if little of a loop is recorded."""
        return TUNING.strengths if self.running is None else TUNING.strengths[-2:]

    def by_ways(self) -> "FitSetup":
        """Return the setup with whole segments of the drive, from turn to turn, held out."""
        rows = [replace(one) for one in self.rows]
        folds = assign_pieces(rows, self.picks, self.drive_min, self.drive_max, 1)
        return replace(self, rows=rows, folds=folds)

    @property
    def span(self) -> float:
        """Drive range."""
        return self.drive_max - self.drive_min

    def rates(self, r: Floats) -> Floats:
        """Return the largest rate (n,) up to which the slope after each operator is bounded."""
        acceleration = self.acceleration_max if self.by_turns else None
        return find_rates(r, self.rate_max, acceleration, self.period_s)

    def equations(
        self,
        picks: Sequence[Bools],
        r: Floats,
        offset: float,
        lag: Dynamics | None = None,
        rate: bool = True,
    ) -> list[Equations]:
        """Return the equations of the picked rows, held in memory."""
        return gather_equations(
            make_equations(
                self.rows,
                picks,
                r,
                (self.centre(offset), offset),
                self.rates(r),
                self.sign,
                lag,
                rate,
            )
        )

    def hysteresis(self, r: Floats, shape: Shape, params: Params, offset: float) -> Hysteresis:
        """Return the model that the parameters represent.

        Once the plays are settled, a drive offset that is smaller by x than their centre gives z +
        x (p + q v); p is the slope of all operators together and q its change with the rate. The
        equations contain the effect of q; if the offset is free, they contain g v / R instead, and
        x = g / (R q). The saturation, S(z - x p), reverses the effect of p.
        """
        n = r.size
        if shape.rate:
            alpha, beta = params.slopes[:n], params.slopes[n:]
            p, q = 0.5 * (alpha + beta), 0.5 * (alpha - beta) / self.rates(r)
        else:
            p, q = params.slopes, np.zeros(n)
        c = np.zeros(max((1, *shape.powers)) + 1)
        c[1] = 1.0
        for power, value in zip(shape.powers, params.c, strict=True):
            c[power] = value
        x = (self.centre(offset) - offset) if shape.rate else 0.0
        if shape.free_offset:
            far = TUNING.far * self.span
            g = float(params.lead[0]) / self.rate_max
            if abs(g) > far * abs(q[-1]):  # offset too far: raise q[-1]
                q = q + (np.copysign(abs(g) / far, q[-1]) - q[-1]) * (r == r[-1])
            x = g / float(q[-1]) if g else 0.0
        if x:
            c = np.asarray(Polynomial(c)(Polynomial([-x * p[-1], 1.0])).coef, np.float64)
        offset = self.centre(offset) - x
        return Hysteresis(
            r=r,
            b=np.diff(p, prepend=0.0),
            k=np.diff(q, prepend=0.0),
            c=self.sign * c,
            u_offset=offset,
        )

    def margin(self, r: Floats, shape: Shape, params: Params, offset: float) -> float:
        """Return the least slope of the saturation over the reach of the model, relative to its
        mean."""
        h = self.hysteresis(r, shape, params, offset)
        return find_least_slope(
            h, self.drive_min, self.drive_max, self.rates(r) if shape.rate else 0.0
        )

    def model(
        self, r: Floats, shape: Shape, params: Params, offset: float, lag: Dynamics | None = None
    ) -> Model:
        """Return the model as it is written, without its error estimates."""
        return Model(
            self.hysteresis(r, shape, params, offset),
            Validity(self.drive_min, self.drive_max),
            blocks=lag.blocks if lag is not None else (),
        )

    def residuals(
        self,
        r: Floats,
        shape: Shape,
        params: Params,
        offset: float,
        lag: Dynamics | None = None,
    ) -> tuple[Floats, ...]:
        """Return y - model of each recording, (N,), NaN where there is no equation. The written
        model itself is run; the shifts of the further recordings are subtracted."""
        model = self.model(r, shape, params, offset, lag)
        out = []
        for one, shift in zip(self.rows, (0.0, *(self.sign * params.shifts)), strict=True):
            error = np.full(one.u.size, np.nan)
            resets = [*one.resets, one.u.size]
            whole = not np.isnan(one.u).any()
            for start, stop in pairwise(resets):  # after a long gap the stage's state is reset
                at: slice | Ints = slice(start, stop)
                if not whole:
                    at = start + np.flatnonzero(~np.isnan(one.u[start:stop]))
                predicted = simulate(model, one.t_s[at], one.u[at])
                np.subtract(one.y[at] - shift if shift else one.y[at], predicted, out=predicted)
                error[at] = predicted
            error[~one.use] = np.nan
            out.append(error)
        return tuple(out)

    def without_outliers(self, residuals: Sequence[Floats]) -> tuple["FitSetup", int]:
        """Return the setup without the rows of lone wild readings, and the number of these rows.

        A reading is wild if its residual is far from those of its neighbours, on the same side of
        both, while the displacement itself jumps and the drive does not; or if it differs by more
        than a twentieth of the range from those around it, alone or together with that of a
        neighbour. Misfit is not taken for wild readings: there the model jumps, or neither does, or
        the stage rings, or follows an edge late.
        """
        picks, count = [], 0
        left = [np.abs(measure_jumps(e)) for e in residuals]
        middle = np.concatenate([some[some > 0.0] for some in map(sample, left)])
        usual = TUNING.rows_compared
        chances = np.log(max(usual, sum(e.size for e in residuals))) / np.log(usual)
        scatter = float(np.median(middle)) / JUMP if middle.size else 0.0
        limit = TUNING.wild * np.sqrt(chances) * scatter
        for pick, e, jump, one in zip(self.picks, residuals, left, self.rows, strict=True):
            off = np.abs(measure_deviation(e))
            size = float(np.ptp(np.nanquantile(sample(one.y), INNER)))
            jumps = np.minimum(np.abs(measure_jumps(one.y)), measure_peaks(e)) > BOTH * off
            jumps |= (off > TUNING.small * size) & (jump > TWO * off)
            with np.errstate(invalid="ignore"):
                jumps &= measure_driven_jumps(one.y, one.u) < DRIVEN * off
                wild = pick & jumps & (off > max(limit, TUNING.trace * size))
            number = int(np.count_nonzero(wild))
            if 0 < number <= TUNING.small * pick.size:
                count += number
                pick = pick & ~wild
            picks.append(pick)
        return (replace(self, picks=picks), count) if count else (self, 0)


def set_up(rows: Sequence[Rows], monotone: bool, trust_start: bool = True) -> FitSetup:
    """Make the setup of some recordings.

    trust_start: accept a start that looks de-energised as such; if False, or if it does not look
    so, rows that depend on the start are left out unless too few remain. Raises BadRecording when
    there are too few usable rows.
    """
    rows = [replace(one) for one in rows]  # this setup writes its own stretches into them
    notes: list[str] = []
    low, high = find_drive_range(rows)
    rate_max = find_rate_range(rows)
    acceleration_max = find_acceleration(rows, rate_max)
    allowed, beyond = [], 0
    for one in rows:
        with np.errstate(invalid="ignore"):
            slow = np.abs(one.rate) <= rate_max * (1 + 1e-9)
        beyond += int(np.count_nonzero(one.use & ~slow))
        far = _find_far_outside(one.y)
        if far.any():
            left = how_many(int(np.count_nonzero(far)), "displacement")
            notes.append(f"{one.name}: {left} far outside the rest left out")
        allowed.append(one.use & slow & ~far)
    if beyond:
        left = how_many(beyond, "row was", "rows were")
        notes.append(f"{left} left out, because rates that high are too rare")
    virgin = any(one.virgin for one in rows) and trust_start
    known = [_memory_is_known(one, one.virgin and trust_start) for one in rows]
    picks, running = [use & k for use, k in zip(allowed, known, strict=True)], None
    settled, total = (sum(int(np.count_nonzero(m)) for m in ms) for ms in (picks, allowed))
    # from a known start the rows before a pause suffice; without one, more must have settled
    least = TUNING.minor if virgin else 0.3
    if settled < max(least * total, TUNING.fewest_rows):
        picks = allowed
        if not virgin:
            running = _find_running_offset(rows[0].u, high - low)
        notes.append(
            "the drive reaches its full range late; the stage's state at the start is assumed"
        )
    count = sum(int(np.count_nonzero(p)) for p in picks)
    if count < TUNING.fewest_rows:
        raise BadRecording(f"{rows[0].name}: {count} usable rows are too few to identify from")
    some = thin(picks, TUNING.rows_fitted)
    u = np.concatenate([one.u[p] for one, p in zip(rows, some, strict=True)])
    y = np.concatenate([one.y[p] for one, p in zip(rows, some, strict=True)])
    slope = _fit_mean_slope(u, y)
    if slope < 0:
        notes.append(
            "the displacement falls as the drive rises; the negative sign is in the saturation"
        )
    size = max(abs(slope), 1e-12 * float(np.ptp(y)) / (high - low), 1e-300)
    limits = (TUNING.crumb * size, TUNING.far * size) if monotone else None
    sign = -1.0 if slope < 0 else 1.0
    folds = assign_pieces(rows, picks, low, high)
    return FitSetup(
        rows,
        picks,
        low,
        high,
        rate_max,
        acceleration_max,
        max(one.period_s for one in rows),
        sign,
        size,
        limits,
        virgin,
        folds,
        tuple(notes),
        running,
    )


def _memory_is_known(one: Rows, virgin: bool) -> Bools:
    """Return the rows (N,) that do not depend on an unknown memory. virgin: the start is known.
    After a long gap, in which the drive may have been anywhere, no memory is known."""
    first_gap = int(one.resets[1]) if one.resets.size > 1 else one.u.size
    return one.settled | ((np.arange(one.u.size) < first_gap) & virgin)


def _find_running_offset(u: Floats, span: float) -> float:
    """Return the offset about which every operator starts as if the drive had come from far away,
    in the direction in which it first continues."""
    known = u[~np.isnan(u)]
    away = known[np.argmax(np.abs(known - known[0]) > TUNING.small * span)] - known[0]
    return float(known[0] - np.sign(away) * span)


def _find_far_outside(y: Floats) -> Bools:
    """Return the readings (N,) that lie outside the usual range by more than the width of that
    range; NaN does not."""
    low, high = np.nanquantile(sample(y), INNER)
    with np.errstate(invalid="ignore"):
        return (y < low - (high - low)) | (y > high + (high - low))


def _fit_mean_slope(u: Floats, y: Floats) -> float:
    """Return the slope of a straight line through (u, y), fitted without wild values."""
    inner = ~_find_far_outside(y)
    u, y = u[inner], y[inner]
    du = u - u.mean()
    power = float(du @ du)
    return float(du @ (y - y.mean())) / power if power > 0.0 else 0.0
