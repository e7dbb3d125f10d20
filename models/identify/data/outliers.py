"""Find lone wild values of a signal, and draw a random part of its rows."""

from collections.abc import Sequence

import numpy as np
from numba import njit

from dehyst.models.identify.tuning import TUNING
from dehyst.models.recording import Bools, Floats
from dehyst.models.signals.lone import measure_jumps

PAUSE = 4.0
"""Sampling periods: what changes across a longer pause is no glitch."""
SAMPLED = 200_000
"""Values that suffice for a quantile; more only take time."""
LONE = 3.0
"""Deviation over the steps of the drive nearby from which a lone value is wild: the peak of a
sawtooth before its flyback deviates by two."""


def remove_glitches(name: str, t: Floats, u: Floats, notes: list[str]) -> Floats:
    """Return the drive u (N,) with lone wild values as NaN; a glitch would stay in the memory of
    every operator. t: (N,) times."""
    wild = np.zeros(u.size, dtype=bool)
    for _ in range(2):  # twice: of two adjacent glitches one hides the other
        known = ~np.isnan(u) & ~wild
        if not known.any():
            return u
        found = _find_glitches(u if known.all() else u[known]) & ~_beside_a_pause(t[known])
        wild[known] = wild[known] | found
        if not found.any():
            break
    count = int(np.count_nonzero(wild))
    if count == 0 or count > 0.05 * u.size:
        return u
    notes.append(f"{name}: {count} isolated drive outliers were left out")
    u = u.copy()
    u[wild] = np.nan
    return u


def _beside_a_pause(t: Floats) -> Bools:
    """Return the two rows (N,) before and after each pause."""
    steps, beside = np.diff(t), np.zeros(t.size, dtype=bool)
    if steps.size:
        last = np.flatnonzero(steps > PAUSE * np.median(steps))
        for k in (-1, 0, 1, 2):
            beside[np.clip(last + k, 0, t.size - 1)] = True
    return beside


def _find_glitches(v: Floats) -> Bools:
    """Return the values (N,) that are far from the five around them and not explained by the steps
    of the drive.

    The tip of a triangle has a jump of 2 / 3 of its deviation, and the neighbours of a glitch have
    a smaller jump.
    """
    off = measure_deviation(v)
    np.abs(off, out=off)
    some = np.nanquantile(sample(v), [0.02, 0.98])
    limit = TUNING.wild * 1.4826 * float(np.median(sample(off)))
    limit = max(limit, TUNING.trace * float(np.ptp(some)))
    jumps = measure_jumps(v)
    np.abs(jumps, out=jumps)
    largest = np.ones(v.size, dtype=bool)  # of the five around it
    for step in (1, 2):
        largest[step:] &= jumps[step:] >= jumps[:-step]
        largest[:-step] &= jumps[:-step] >= jumps[step:]
    steps = _measure_steps(v)
    lone = (jumps > 0.85 * off) & largest & (off > LONE * steps)
    return (off > limit) & (lone | (off > TUNING.far * steps))


@njit(cache=True, nogil=True)
def measure_deviation(x: Floats) -> Floats:
    """Return the distance (N,) of each value from the median of the five values around it; NaN
    stays NaN."""
    out = np.zeros(x.size)
    five = np.empty(5)
    for i in range(x.size):
        a = min(max(i - 2, 0), x.size - 5) if x.size >= 5 else 0
        m = 0
        for j in range(a, min(a + 5, x.size)):
            if not np.isnan(x[j]):
                p = m
                while p > 0 and five[p - 1] > x[j]:
                    five[p] = five[p - 1]
                    p -= 1
                five[p] = x[j]
                m += 1
        if np.isnan(x[i]):
            out[i] = np.nan
        elif m >= 3:
            middle = five[m // 2] if m % 2 else 0.5 * (five[m // 2 - 1] + five[m // 2])
            out[i] = x[i] - middle
    return out


@njit(cache=True, nogil=True)
def _measure_steps(x: Floats) -> Floats:
    """Return the median size (N,) of the six steps nearest to each value, without the two at the
    value itself."""
    out = np.zeros(x.size)
    six = np.empty(6)
    for i in range(x.size):
        m = 0
        for j in (i - 3, i - 2, i - 1, i + 2, i + 3, i + 4):
            if 1 <= j < x.size and j != i:
                step = abs(x[j] - x[j - 1])
                p = m
                while p > 0 and six[p - 1] > step:
                    six[p] = six[p - 1]
                    p -= 1
                six[p] = step
                m += 1
        if m:
            out[i] = six[m // 2] if m % 2 else 0.5 * (six[m // 2 - 1] + six[m // 2])
    return out


def sample(x: Floats) -> Floats:
    """Return at most SAMPLED values of x, at random: a stride could be in step with the drive."""
    if x.size <= SAMPLED:
        return x
    return x[np.random.default_rng(0).integers(0, x.size, SAMPLED)]


def thin(picks: Sequence[Bools], limit: int) -> list[Bools]:
    """Return about `limit` of the picked rows at most, at random."""
    total = sum(int(np.count_nonzero(p)) for p in picks)
    if total <= limit:
        return list(picks)
    rng = np.random.default_rng(0)
    share = np.float32(limit / total)
    return [p & (rng.random(p.size, dtype=np.float32) < share) for p in picks]
