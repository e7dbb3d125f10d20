"""The colour of the noise: misfit that is the same at all times and places and has no lines.

What is left after the best fit counts as noise where its power does not depend on time, drive,
rate or the way since the last turn, and where its spectrum falls smoothly: nothing then says that
the drive has to do with it. It is told as coloured noise, not as structure.
"""

from itertools import pairwise

import numpy as np

from dehyst.models.diagnosis.locate import since_turn
from dehyst.models.signals.joined import Data, Floats
from dehyst.models.signals.lines import find_lines

GROUPS = 8  # in each respect
EVEN = 0.6  # power in every group, at least and at most one over it, of the mean
MEMORY = 4.0  # times what independent samples would scatter, is allowed beside
OCTAVES = 10
PEAK = 2.5  # times the band below it, that no band's density may reach


def is_coloured(data: Data, residual: Floats, sigma: float) -> bool:
    """Whether what is left (N,) is noise of another colour than white."""
    rows = data.rows
    e = residual[rows]
    correlation = _correlation_samples(e)
    rate = np.abs(np.diff(data.u, prepend=data.u[0]) / data.dt)[rows]
    for place in (data.t, data.u, since_turn(data)):
        if not _is_even(e, place[rows], correlation):
            return False
    for i in range(len(data.names)):
        if not _is_even(
            residual[rows & (data.rec == i)], data.t[rows & (data.rec == i)], correlation
        ):
            return False
    still = rate < 1e-3 * float(rate.max())
    if 0.1 < np.mean(still) < 0.9 and not _is_even(e, still.astype(float), correlation):
        return False
    return _falls(data, residual) and not find_lines(data, residual)


def _correlation_samples(e: Floats) -> float:
    """Samples over which a residual hangs together: the integral of its autocorrelation."""
    x = e - e.mean()
    n = 1 << int(np.ceil(np.log2(2 * x.size)))
    own = np.fft.irfft(np.abs(np.fft.rfft(x, n)) ** 2)[: x.size // 4]
    own = own / max(float(own[0]), 1e-300)
    end = int(np.argmax(own < 0.05)) or own.size
    return float(1.0 + 2.0 * np.sum(own[1:end]))


def _is_even(e: Floats, place: Floats, correlation: float) -> bool:
    """Whether the power and the mean are the same in all groups, by chance allowing."""
    if e.size < 20 * GROUPS:
        return False
    edges = np.quantile(place, np.linspace(0, 1, GROUPS + 1)[1:-1])
    group = np.searchsorted(edges, place, side="right")
    count = np.bincount(group, minlength=GROUPS).astype(float)
    power = np.bincount(group, e**2, GROUPS) / np.maximum(count, 1)
    mean = np.bincount(group, e, GROUPS) / np.maximum(count, 1)
    whole = float(np.mean(e**2))
    free = np.maximum(count / correlation, 1.0)
    chance = MEMORY * np.sqrt(2.0 / free)
    good = count > 0.02 * e.size
    low, high = EVEN / (1.0 + chance), (1.0 / EVEN) * (1.0 + chance)
    off = np.abs(mean) > MEMORY * np.sqrt(whole / free)
    return bool(np.all((power > low * whole)[good] & (power < high * whole)[good] & ~off[good]))


def _falls(data: Data, residual: Floats) -> bool:
    """Whether the density falls from octave to octave, without a peak, in the longest part."""
    part = int(np.argmax(np.bincount(data.part)))
    e = residual[data.part == part]
    power = np.abs(np.fft.rfft((e - e.mean()) * np.hanning(e.size))) ** 2
    edges = power.size / 2.0 ** np.arange(OCTAVES, -1, -1)
    density = [
        float(np.mean(power[max(int(a), 2) : int(b)]))
        for a, b in pairwise(edges)
        if int(b) - max(int(a), 2) >= 8
    ]
    return all(b < PEAK * min(density[:k]) for k, b in enumerate(density) if k)
