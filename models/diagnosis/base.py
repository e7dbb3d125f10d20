"""The rich rate-independent base: all that a memory of the drive's path can produce.

Columns, for the drive scaled to x in -1..1 over its range:
    H_i, H_i^2 ... H_i^5  play operators with polynomial envelopes (12 thresholds)
    Z_j, Z_j x, Z_j^2, Z_j x^2, Z_j^3    Dahl operators (7 lengths): loops of Duhem and
                          Bouc-Wen kind, which plays do not span
    x^4, x^5              and one offset for each recording
What such a base can fit is hysteresis of some shape, whatever its class; its residual depends on
time, frequency or other channels. It never sees the rate, so lags remain in the residual.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from dehyst.models.model import Hysteresis
from dehyst.models.signals.filters import dahl, plays
from dehyst.models.signals.joined import Data, Floats, Ints
from dehyst.models.signals.pasts import begin_dahl, begin_plays

# fractions of the drive's range
THRESHOLDS = np.array([0, 0.01, 0.025, 0.05, 0.08, 0.12, 0.17, 0.23, 0.3, 0.37, 0.45, 0.55])
LENGTHS = np.array([0.005, 0.015, 0.04, 0.1, 0.2, 0.4, 0.8])
POWERS_OF_Z = 5  # highest power of z, for the saturation


@dataclass(frozen=True)
class Base:
    """Operators of the rich base, with the drive scale that they were laid out for."""

    low: float
    span: float
    thresholds: Floats
    lengths: Floats
    keep: Ints  # indices of the rich base's columns in this one

    @property
    def width(self) -> int:
        """Number of columns."""
        return int(self.keep.size)

    @property
    def _all(self) -> int:
        return 5 * self.thresholds.size + 5 * self.lengths.size + 2

    def full(self, weights: Floats) -> Floats:
        """Return weights of all the rich base's columns, 0 where this base has none."""
        out = np.zeros(self._all)
        out[self.keep] = weights
        return out

    @property
    def priors(self) -> Floats:
        """(width,) ridge of the columns, by their power: the higher the power, the less certain its
        prediction for a new waveform. Set by held-out recordings of stages of three other classes;
        a factor of ten either way changes little."""
        n, m = self.thresholds.size, self.lengths.size
        power = np.r_[np.repeat([1, 2, 3, 4, 5], n), np.repeat([1, 2, 2, 3, 3], m), 4, 5]
        return np.select([power == 1, power <= 3], [1e-7, 1e-5], 3e-5)[self.keep]

    def scaled(self, v: Floats) -> Floats:
        """Return the drive scaled to -1..1 over the recorded range."""
        return (v - (self.low + 0.5 * self.span)) * (2.0 / self.span)

    def columns(self, v: Floats, starts: Ints, rows: Ints | None = None) -> Floats:
        """Return (N, width) columns for a drive v (N,), or only the given rows."""
        rows = np.arange(v.size) if rows is None else rows
        if self.width == 0:
            return np.zeros((rows.size, 0))
        x = self.scaled(v)
        # plays start at the drive's low end, the state of a de-energised stage
        h = plays(2.0 * self.thresholds, x + 1.0, starts) - 1.0
        z = dahl(2.0 * self.lengths, x, starts)
        out = np.empty((rows.size, self._all))
        _fill(out, x, h, z, rows)
        return out if self.width == self._all else np.ascontiguousarray(out[:, self.keep])

    def combine(self, v: Floats, starts: Ints, weights: Floats) -> Floats:
        """Return columns(v) @ weights (N,) without building the columns."""
        if self.width == 0:
            return np.zeros(v.size)
        x = self.scaled(v)
        return _combine(x, starts, 2.0 * self.thresholds, 2.0 * self.lengths, self.full(weights))


def rich_base(data: Data) -> Base:
    """Return the rich base laid out over the recordings' drive range."""
    every = np.arange(5 * THRESHOLDS.size + 5 * LENGTHS.size + 2)
    return Base(data.u_min, data.span, THRESHOLDS, LENGTHS, every)


def compact_base(data: Data) -> Base:
    """Return plays and a cubic of the drive: all that a few loops of one waveform can support."""
    n = THRESHOLDS.size
    return Base(data.u_min, data.span, THRESHOLDS, LENGTHS, np.r_[0:n, n, 2 * n])


def no_base(data: Data) -> Base:
    """Return an empty base: the model in use alone."""
    return Base(data.u_min, data.span, THRESHOLDS, LENGTHS, np.zeros(0, dtype=np.int64))


@dataclass(frozen=True)
class NumbersBase(Base):
    """First-order change of the model in use when its parameters change, within its class.

    y = P(z), z = sum_i b_i H_i: the columns are P'(z) H_i with the model's thresholds, and powers
    of z (Gauss-Newton about the model).
    """

    hysteresis: Hysteresis

    @property
    def width(self) -> int:
        """Number of columns."""
        return self.hysteresis.n + POWERS_OF_Z - 1

    @property
    def priors(self) -> Floats:
        """(width,) ridge of the columns."""
        return np.full(self.width, 1e-9)

    def columns(self, v: Floats, starts: Ints, rows: Ints | None = None) -> Floats:
        """Return (N, width) columns for a drive v (N,), or only the given rows."""
        one = self.hysteresis
        h = plays(one.r, v - one.u_offset, starts)[slice(None) if rows is None else rows]
        z = h @ one.b
        slope = sum(p * c * z ** (p - 1) for p, c in enumerate(one.c.tolist()) if p)
        size = max(float(np.abs(z).max()), 1e-300)
        bent = [(z / size) ** p for p in range(2, POWERS_OF_Z + 1)]
        return np.column_stack([h * np.reshape(slope, (-1, 1)), *bent])

    def combine(self, v: Floats, starts: Ints, weights: Floats) -> Floats:
        """Return columns(v) @ weights (N,)."""
        return self.columns(v, starts) @ weights


def numbers_base(data: Data, hysteresis: Hysteresis) -> Base:
    """Return the base of a hysteresis' own class."""
    return NumbersBase(**vars(no_base(data)), hysteresis=hysteresis)


@dataclass(frozen=True)
class ModelPrior:
    """Target for the base where nothing was recorded: columns (m, width), target (m,)."""

    columns: Floats
    target: Floats

    def add_to(self, gram: Floats, moment: Floats, first: int) -> None:
        """Add these rows to normal equations in which the base's columns begin at `first`."""
        if self.target.size:
            own = slice(first, first + self.columns.shape[1])
            gram[own, own] += self.columns.T @ self.columns
            moment[own] += self.columns.T @ self.target


NO_MODEL_PRIOR = ModelPrior(np.zeros((0, 0)), np.zeros(0))


@njit(cache=True, nogil=True)
def _fill(out: Floats, x: Floats, h: Floats, z: Floats, rows: Ints) -> None:
    n, m = h.shape[1], z.shape[1]
    for at in range(rows.size):
        t = rows[at]
        xt = x[t]
        for i in range(n):
            a = h[t, i]
            out[at, i] = a
            out[at, n + i] = a * a
            out[at, 2 * n + i] = a * a * a
            out[at, 3 * n + i] = a * a * a * a
            out[at, 4 * n + i] = a * a * a * a * a
        k = 5 * n
        for j in range(m):
            a = z[t, j]
            out[at, k + j] = a
            out[at, k + m + j] = a * xt
            out[at, k + 2 * m + j] = a * a
            out[at, k + 3 * m + j] = a * xt * xt
            out[at, k + 4 * m + j] = a * a * a
        out[at, k + 5 * m] = xt**4
        out[at, k + 5 * m + 1] = xt**5


@njit(cache=True, nogil=True)
def _combine(x: Floats, starts: Ints, r: Floats, length: Floats, w: Floats) -> Floats:
    n, m = r.size, length.size
    h = np.zeros(n)
    z = np.zeros(m)
    out = np.empty(x.size)
    times = np.zeros(m, np.int64)  # 2, 3: the next length is that multiple; no exponential needed
    for j in range(m - 1):
        ratio = length[j + 1] / length[j]
        if abs(ratio - round(ratio)) < 1e-12:
            times[j] = round(ratio)
    lowest, highest = x.min(), x.max()
    for t in range(x.size):
        xt = x[t]
        du = 0.0
        if starts[t]:
            begin_plays(h, r, starts[t], lowest + 1.0, highest + 1.0)
            begin_dahl(z, length, starts[t], lowest, highest, xt)
        else:
            du = xt - x[t - 1]
        total = w[5 * n + 5 * m] * xt**4 + w[5 * n + 5 * m + 1] * xt**5
        for i in range(n):
            h[i] = max(xt + 1.0 - r[i], min(xt + 1.0 + r[i], h[i]))
            a = h[i] - 1.0
            high = w[2 * n + i] + a * (w[3 * n + i] + a * w[4 * n + i])
            total += a * (w[i] + a * (w[n + i] + a * high))
        s = 1.0 if du > 0 else -1.0
        k = 5 * n
        decay = 1.0
        for j in range(m - 1, -1, -1):
            if du != 0.0:
                if times[j] == 2:
                    decay *= decay
                elif times[j] == 3:
                    decay *= decay * decay
                else:
                    decay = np.exp(-abs(du) / length[j])
                z[j] = s + (z[j] - s) * decay
            a = z[j]
            total += a * (
                w[k + j]
                + xt * (w[k + m + j] + xt * w[k + 3 * m + j])
                + a * (w[k + 2 * m + j] + a * w[k + 4 * m + j])
            )
        out[t] = total
    return out
