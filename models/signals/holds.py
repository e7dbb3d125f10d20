"""Measure creep in holds under feedback: the reading is constant, and the drive compensates.

Here the drive is the effect and the displacement the cause, so that no fit of the displacement to
the drive can show creep. But the drive of a controller that holds the reading shows what the stage
would do: it moves against the last move, in proportion to the logarithm of time.
"""

from dataclasses import dataclass

import numpy as np

from dehyst.models.signals.joined import Data, Floats

STILL = 5e-4  # motion of the reading allowed in a hold, of its range; or, if that is more,
STILL_NOISE = 4.0  # in noise rms
LEAST_S = 1.0  # least length of a hold [s], and
LEAST_SAMPLES = 200  # in samples
STRAIGHT = 0.98  # least fraction of the drive's variance in the hold that the logarithm explains
AGAINST_LINE = 0.5  # largest misfit of the logarithm, relative to that of a straight line
GAINS = (0.002, 0.06)  # range of the creep of a ceramic, per decade
BLOCKS = 400  # number of blocks to which the reading is averaged
EARLY = 0.03  # first part of the hold, left out because the control loop settles


@dataclass(frozen=True)
class Hold:
    """gain: creep per decade of time relative to the move before; low, high: its interval, from the
    two halves of the hold; start_s, end_s: of the hold [s]."""

    gain: float
    low: float
    high: float
    start_s: float
    end_s: float

    @property
    def seconds(self) -> float:
        """Length of the hold [s]."""
        return self.end_s - self.start_s


def longest_hold(data: Data, sigma: float) -> Hold | None:
    """Return the longest hold in which a controller compensates creep, or None."""
    found = []
    for p in np.unique(data.part):
        here = np.flatnonzero(data.part == p)
        t, u, y = data.t[here], data.u[here], data.y[here]
        limit = max(STILL * float(np.ptp(data.y)), STILL_NOISE * sigma)
        for a, b in _holds(t, y, limit):
            gains = _gains(t[a:b], u[a:b], _move_before(u, a))
            if gains:
                found.append(Hold(*gains, float(t[a]), float(t[b - 1])))
    return max(found, key=lambda h: h.seconds) if found else None


def _holds(t: Floats, y: Floats, limit: float) -> list[tuple[int, int]]:
    """Return (first, last) indices of stretches in which block means of the reading stay within
    `limit`; last is exclusive."""
    each = max(1, y.size // BLOCKS)
    count = y.size // each
    mean = y[: count * each].reshape(count, each).mean(axis=1)
    out, a = [], 0
    for b in range(1, count + 1):
        if b < count and abs(mean[b] - np.median(mean[a:b])) <= limit:
            continue
        first, last = a * each, b * each
        if last - first >= LEAST_SAMPLES and t[last - 1] - t[first] >= LEAST_S:
            out.append((first, last))
        a = b
    return out


def _move_before(u: Floats, at: int) -> float:
    """Return the signed move of the drive to its value at an index, from the farthest earlier value
    without a turn of more than a twentieth of the range in between."""
    margin = 0.05 * float(np.ptp(u))
    best = 0.0
    for v in (u[at] - u[:at][::-1]).tolist():
        if abs(v) > abs(best) and (best == 0.0 or v * best > 0 or abs(best) < margin):
            best = v
        elif abs(best) > margin and abs(best) - v * np.sign(best) > margin:
            break
    return float(best)


def _gains(t: Floats, u: Floats, move: float) -> tuple[float, float, float] | None:
    """Return the creep gain from the drive (N,) in a hold after a move, and its interval from the
    early and the late half on the logarithmic scale; None if the logarithm does not fit."""
    elapsed = t - t[0]
    late = elapsed > EARLY * elapsed[-1]
    x, v = np.log10(elapsed[late]), u[late]
    slope, misfit = _fit(x, v)
    spread = float(np.sum((v - v.mean()) ** 2))
    if move == 0.0 or spread <= 0 or misfit > (1 - STRAIGHT) * spread:
        return None
    if misfit > AGAINST_LINE * _fit(elapsed[late], v)[1]:
        return None
    gain = -slope / move
    if not GAINS[0] < gain < GAINS[1]:
        return None
    first = x < 0.5 * (x[0] + x[-1])
    parts = [-_fit(x[k], v[k])[0] / move for k in (first, ~first)]
    half = max(abs(parts[0] - parts[1]), 0.05 * gain)  # two halves may agree by chance
    return gain, gain - half, gain + half


def _fit(x: Floats, u: Floats) -> tuple[float, float]:
    """Return the slope of the least-squares line and the sum of squares of its misfit."""
    a = x - x.mean()
    d = u - u.mean()
    slope = float(a @ d) / max(float(a @ a), 1e-300)
    return slope, float(np.sum((d - slope * a) ** 2))
