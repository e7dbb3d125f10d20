"""Make the equations of a fit, in lots of rows, and their normal equations.

With D_i = H_i - H_{i+1} (D_n = H_n) the model is z = sum_i s_i(v) D_i, where s_i is the i-th
partial sum of the weights at the rate v: the slope dz/du after the (i-1)-th operator has joined in.
For rates from -R_i to R_i it changes linearly from beta_i to alpha_i,

    s_i(v) = alpha_i (1 + v/R_i) / 2 + beta_i (1 - v/R_i) / 2 ,

so that monotonicity over the whole rate range means alpha_i >= eps and beta_i >= eps. R_i is the
largest rate up to which the slope s_i is bounded: R, the largest rate of all, or the largest rate
at which the drive can reach that slope after a turn (dehyst.models.hysteresis.z_range.find_rates).
The saturation is S(z) = z + sum_j c_j z^j: c_1 = 1 fixes the scale that weights and polynomial
share.

Rows come in lots of limited size, so that only the Jacobian of one lot is held in memory.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dehyst.models.arrays import Ints
from dehyst.models.hysteresis.play import play_step
from dehyst.models.identify.data.rows import Rows
from dehyst.models.identify.dynamics import Filter, rows_behind
from dehyst.models.physics.dynamics import Dynamics
from dehyst.models.recording import Bools, Floats

ROWS_HELD = 8192


class Equations(NamedTuple):
    """d: (n, M) play differences D_i; e: (n, M) v / R_i times these, or (n, 0) if no rate is
    wanted; d and e are filtered by the sensor's lag; y: (n,); group: (n,) number of the recording;
    piece: (n,) stretch of the drive; pace: (n,) v / R; weight: how often each equation counts."""

    d: Floats
    e: Floats
    y: Floats
    group: Ints
    piece: NDArray[np.int8]
    pace: Floats
    weight: float = 1.0


@dataclass(frozen=True)
class Shape:
    """rate: weights depend on the rate; powers: powers of z other than the first, 0 included;
    free_offset: the drive offset about which the rate acts is fitted as well."""

    rate: bool
    powers: tuple[int, ...]
    free_offset: bool = False

    @property
    def even(self) -> bool:
        """Whether there are even powers of z, with which the loop need not be symmetric."""
        return any(p and p % 2 == 0 for p in self.powers)

    @property
    def name(self) -> str:
        """Description in words."""
        kind = "full polynomial" if self.even else "odd polynomial"
        degree = max((1, *self.powers))
        saturation = "no saturation" if degree == 1 else f"{kind} of degree {degree}"
        return f"{'rate-dependent' if self.rate else 'static'}, {saturation}"


class Params(NamedTuple):
    """slopes: (M,) or (2M,) alpha then beta; c: (len(powers),); shifts: (G - 1,) offsets of the
    further recordings relative to the first; lead: (1,) z per v / R if the drive offset of the rate
    is free, else (0,)."""

    slopes: Floats
    c: Floats
    shifts: Floats
    lead: Floats = np.zeros(0)

    def packed(self) -> Floats:
        """Return all parameters in one array."""
        return np.concatenate(self)

    @staticmethod
    def unpacked(p: Floats, like: "Params") -> "Params":
        """Return the parameters in `p`; the inverse of packed()."""
        ends = np.cumsum([part.size for part in like])[:-1]
        return Params(*np.split(p, ends))


@njit(cache=True, nogil=True)
def _run_plays(
    r: Floats,
    h: Floats,
    u: Floats,
    offsets: tuple[float, float],
    fresh: Bools,
    wanted: Bools,
    columns: Floats,
    at: Ints,
) -> int:
    """Run the plays over a lot; write D of the wanted rows with a drive into the first columns and
    their positions into at; return their number. offsets: of the drive, and where the drive had
    been before a reset, relative to that offset.

    Rows that are not wanted are passed over unless the drive turns there: after a drive that went
    one way, a play is where one step from the row played before takes it.
    """
    count, n, before = 0, r.size, np.nan
    for t in range(u.size):
        if fresh[t]:
            h[:] = 0.0
            play_step(r, h, offsets[1])
            before = np.nan
        if np.isnan(u[t]):
            continue
        if not wanted[t] and t + 1 < u.size:
            now, then = u[t], u[t + 1]
            if before <= now <= then or before >= now >= then:
                continue
        before = u[t]
        play_step(r, h, u[t] - offsets[0])
        if wanted[t]:
            for i in range(n - 1):
                columns[count, i] = h[i] - h[i + 1]
            columns[count, n - 1] = h[n - 1]
            at[count] = t
            count += 1
    return count


@njit(cache=True, nogil=True)
def _fill_rates(columns: Floats, shares: Floats, shift: float) -> None:
    """Write v / R_i times D into the columns between those of D and v / R. shift: by how much
    smaller the drive offset is for the rate."""
    n = shares.size
    for t in range(columns.shape[0]):
        share, own = 1.0, columns[t, 2 * n]
        for i in range(n):
            if shares[i] != share:  # most operators share theirs: a division is slow
                share = shares[i]
                own = columns[t, 2 * n] / share
            columns[t, n + i] = columns[t, i] * own
        columns[t, 2 * n - 1] += shift * columns[t, 2 * n]


def make_equations(
    rows: Sequence[Rows],
    picks: Sequence[Bools],
    r: Floats,
    offsets: tuple[float, float],
    rates: Floats,
    sign: float,
    lag: Dynamics | None = None,
    rate: bool = True,
) -> Iterator[Equations]:
    """Yield lots of equations for the picked rows of each recording; the plays see every row.

    offsets: of the drive for the plays, and for the effect of the rate on them (they differ only if
    the plays are settled); rates: (M,) R_i; lag: dynamics of drive or sensor; rate: whether to make
    the rate's columns.
    """
    rate_max = float(rates[-1])
    shares = rates / rate_max if rate_max > 0.0 else np.ones(r.size)
    for number, (one, pick) in enumerate(zip(rows, picks, strict=True)):
        if lag is not None:
            one = rows_behind(lag, one)
        h = np.zeros(r.size)
        began = (offsets[0], one.came_from)
        fresh = np.zeros(one.u.size, dtype=bool)
        fresh[one.resets] = True
        width = r.size * (2 if rate else 1) + 1
        through = Filter(lag, width) if lag is not None and lag.place != "drive" else None
        pace = one.rate / rate_max if rate and rate_max > 0.0 else np.zeros(one.u.size)
        if through is not None:  # where no rate is known, none is assumed
            pace[np.isnan(pace)] = 0.0
        wanted = pick if through is None else np.ones(one.u.size, dtype=bool)
        for start in range(0, one.u.size, ROWS_HELD):
            part = slice(start, min(start + ROWS_HELD, one.u.size))
            most = int(wanted[part].sum())
            columns, at = np.empty((most, width)), np.empty(most, dtype=np.int64)
            count = _run_plays(r, h, one.u[part], began, fresh[part], wanted[part], columns, at)
            columns, at = columns[:count], at[:count]
            columns[:, -1] = pace[part][at]
            if rate:
                _fill_rates(columns, shares, offsets[0] - offsets[1])
            if through is not None:
                through.run(columns, one.t_s[part][at], fresh[part][at])
                keep = pick[part][at]
                columns, at = columns[keep], at[keep]
            d, e = columns[:, : r.size], columns[:, r.size : -1]
            d, e, paces = np.ascontiguousarray(d), np.ascontiguousarray(e), columns[:, -1].copy()
            if at.size:
                group = np.full(at.size, number, dtype=np.int64)
                yield Equations(d, e, sign * one.y[part][at], group, one.piece[part][at], paces)


def gather_equations(equations: Iterable[Equations]) -> list[Equations]:
    """Return the same equations in fewer lots: small lots are joined."""
    out: list[Equations] = []
    few: list[Equations] = []
    size = 0
    for lot in equations:
        few.append(lot)
        size += lot.y.size
        if size >= ROWS_HELD // 2:
            out.append(_join(few))
            few, size = [], 0
    return [*out, _join(few)] if few else out


def _join(lots: Sequence[Equations]) -> Equations:
    if len(lots) == 1:
        return lots[0]
    return Equations(
        np.concatenate([lot.d for lot in lots]),
        np.concatenate([lot.e for lot in lots]),
        np.concatenate([lot.y for lot in lots]),
        np.concatenate([lot.group for lot in lots]),
        np.concatenate([lot.piece for lot in lots]),
        np.concatenate([lot.pace for lot in lots]),
        lots[0].weight,
    )


def sort_by_piece(equations: Sequence[Equations], count: int) -> list[Equations]:
    """Return one lot for each of `count` pieces."""
    d, e, y, group, piece, pace, weight = _join(equations)
    order = np.argsort(piece, kind="stable")
    ends = np.searchsorted(piece[order], np.arange(count + 1))
    rows = [order[a:b] for a, b in pairwise(ends)]
    return [Equations(d[at], e[at], y[at], group[at], piece[at], pace[at], weight) for at in rows]


@njit(cache=True, nogil=True)
def _linearise(lot: Equations, powers: Ints, params: Params, jac: Floats, err: Floats) -> None:
    d, e, group = lot.d, lot.e, lot.group
    slopes, c, shifts, lead = params.slopes, params.c, params.shifts, params.lead
    m = d.shape[1]
    rate = slopes.size == 2 * m
    for t in range(d.shape[0]):
        z = 0.0
        if rate:
            for i in range(m):
                z += 0.5 * (slopes[i] * (d[t, i] + e[t, i]) + slopes[m + i] * (d[t, i] - e[t, i]))
        else:
            for i in range(m):
                z += slopes[i] * d[t, i]
        if lead.size:
            z += lead[0] * lot.pace[t]
        model, gradient = z, 1.0
        at = slopes.size
        for j in range(powers.size):
            p = powers[j]
            power = 1.0
            if p > 0:
                before = z ** (p - 1)
                power = before * z
                gradient += c[j] * p * before
            model += c[j] * power
            jac[t, at + j] = power
        at += powers.size
        for j in range(shifts.size):
            jac[t, at + j] = 1.0 if group[t] == j + 1 else 0.0
        if group[t] > 0:
            model += shifts[group[t] - 1]
        if lead.size:
            jac[t, at + shifts.size] = gradient * lot.pace[t]
        if rate:
            for i in range(m):
                jac[t, i] = 0.5 * gradient * (d[t, i] + e[t, i])
                jac[t, m + i] = 0.5 * gradient * (d[t, i] - e[t, i])
        else:
            for i in range(m):
                jac[t, i] = gradient * d[t, i]
        err[t] = lot.y[t] - model


def linearise(lot: Equations, shape: Shape, params: Params) -> tuple[Floats, Floats]:
    """Return the Jacobian (n, p) of the model's output with respect to the packed parameters, and
    the error (n,) y - model."""
    n = lot.d.shape[0]
    jac = np.empty((n, params.packed().size))
    err = np.empty(n)
    powers = np.array(shape.powers, dtype=np.int64)
    _linearise(lot, powers, params, jac, err)
    return jac, err


TINY = 1e-200  # a sum of squares with which one can still divide


@dataclass(frozen=True)
class Normal:
    """Normal equations about some parameters p0: with J p0 added to the errors, the sum of squares
    at other parameters p is total - 2 right' p + p' gram p. count: number of equations."""

    gram: Floats
    right: Floats
    total: float
    count: int
    misfit: float

    def misfit_at(self, p: Floats) -> float:
        """Return the sum of squares at parameters p according to the linearised equations."""
        return max(0.0, self.total + float(np.dot(p, self.gram @ p - 2.0 * self.right)))

    def noise_at(self, p: Floats) -> float:
        """Return the mean square at parameters p, at least what rounding leaves of it: the sum of
        squares is a difference of numbers as large as the total, and 0 for a column that copies
        another only where the processor rounds so."""
        least = np.finfo(np.float64).eps * abs(self.total)
        return max(self.misfit_at(p), least, TINY) / max(1, self.count)


def measure_misfit(equations: Iterable[Equations], shape: Shape, params: Params) -> float:
    """Return the sum of squared errors at these parameters."""
    return sum(float(np.sum(linearise(lot, shape, params)[1] ** 2)) for lot in equations)


def assemble(equations: Iterable[Equations], shape: Shape, params: Params) -> Normal:
    """Return the normal equations of all lots, linearised at params."""
    p0 = params.packed()
    gram, right = np.zeros((p0.size, p0.size)), np.zeros(p0.size)
    misfit, count = 0.0, 0
    for lot in equations:
        jac, err = linearise(lot, shape, params)
        if lot.weight != 1.0:
            jac *= np.sqrt(lot.weight)
            err *= np.sqrt(lot.weight)
        gram += jac.T @ jac
        right += jac.T @ err
        misfit += float(np.sum(err * err))
        count += err.size
    moved = gram @ p0
    total = misfit + float(np.sum(p0 * (2.0 * right + moved)))
    return Normal(gram, right + moved, total, count, misfit)
