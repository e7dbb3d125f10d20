"""Holds under feedback: the reading rests, and the drive climbs to keep it there.

There the drive is the effect and the displacement the cause, so no fit of the displacement to
the drive can show it. But a controller that holds the reading writes what the stage would do into
its drive: against the last move, in proportion to the logarithm of time.
"""

from dataclasses import dataclass

import numpy as np

from dehyst.models.signals.joined import Data, Floats

STILL = 5e-4  # of the reading's range, and
STILL_NOISE = 4.0  # noise rms: what the reading may move in a hold
LEAST_S = 1.0  # a hold's least length, and
LEAST_SAMPLES = 200
STRAIGHT = 0.98  # part of the drive's variance in the hold that the logarithm must explain
AGAINST_LINE = 0.5  # of a straight line's misfit, that the logarithm may leave at most
GAINS = (0.002, 0.06)  # per decade, that a ceramic shows
BLOCKS = 400
EARLY = 0.03  # of the hold, that the settling of the loop may take


@dataclass(frozen=True)
class Hold:
    """gain: per decade of time, of the move before, from low to high by the parts of the hold;
    start, end: of the hold [s]."""

    gain: float
    low: float
    high: float
    start_s: float
    end_s: float

    @property
    def seconds(self) -> float:
        """How long the hold is."""
        return self.end_s - self.start_s


def longest_hold(data: Data, sigma: float) -> Hold | None:
    """The longest hold in which a controller works against what creeps on, or None."""
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
    """First and last index of stretches in which block means of the reading do not move."""
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
    """Signed move of the drive to its value at an index, from the farthest value before on the
    way without a turn of more than a twentieth of the range."""
    margin = 0.05 * float(np.ptp(u))
    best = 0.0
    for v in (u[at] - u[:at][::-1]).tolist():
        if abs(v) > abs(best) and (best == 0.0 or v * best > 0 or abs(best) < margin):
            best = v
        elif abs(best) > margin and abs(best) - v * np.sign(best) > margin:
            break
    return float(best)


def _gains(t: Floats, u: Floats, move: float) -> tuple[float, float, float] | None:
    """Creep gain from the drive (N,) in a hold behind a move, with its interval from the early
    and the late half in the logarithm; None where it does not fit."""
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
    half = max(abs(parts[0] - parts[1]), 0.05 * gain)
    return gain, gain - half, gain + half


def _fit(x: Floats, u: Floats) -> tuple[float, float]:
    """Slope and sum of squares of the misfit of a straight line."""
    a = x - x.mean()
    d = u - u.mean()
    slope = float(a @ d) / max(float(a @ a), 1e-300)
    return slope, float(np.sum((d - slope * a) ** 2))
