"""Determine the frequency at which a drive repeats itself, and that of its fastest part."""

import numpy as np

from dehyst.models.signals.error_size import rms
from dehyst.models.signals.joined import Floats, Ints

FASTEST = 1e-3  # fraction of the power of the drive's rate above the fastest part

REPEATS = 0.03  # largest rms of drive minus drive one period before, over the drive's rms
REACH = 2  # samples to either side that are searched
NEARBY = 0.02  # largest relative error of the best shift that is due to the ends


def period_samples(u: Floats) -> int:
    """Return the shift [samples] at which a drive (N,) best matches itself, up to half its length;
    0: none."""
    return _best_match(u)[0]


def _best_match(u: Floats) -> tuple[int, int]:
    """Return (shift of the best match, smallest shift at which a match is not due to slow motion);
    0: none."""
    n = u.size
    x = u - u.mean()
    spectrum = np.abs(np.fft.rfft(x, 2 * n)) ** 2
    match = np.fft.irfft(spectrum)[: n // 2 + 1] / np.arange(n, n - n // 2 - 1, -1)
    low = int(np.argmax(match < 0.5 * match[0]))
    return (low + int(np.argmax(match[low:])) if low else 0), low


def fundamental_hz(u: Floats, dt: float) -> float:
    """Return the frequency [Hz] of a drive (N,) that repeats itself, sampled every dt [s]; 0 if it
    does not.

    The shift over many periods, divided by their number, resolves a fraction of a sample.
    """
    lag, low = _best_match(u)
    if lag == 0 or np.ptp(u) == 0:
        return 0.0
    lag = _settled(u, lag)
    # a period need not be a whole number of samples
    most = REPEATS * float(np.std(u)) + 0.5 * rms(np.diff(u))
    if lag < max(4, low) or _unlike(u, lag) > most:  # samples
        return 0.0
    for parts in range(lag // max(4, 2 * low), 1, -1):  # the best match may be several periods long
        shorter = round(lag / parts)
        if _unlike(u, shorter) < most:
            lag = _best(u, shorter)
            break
    period = float(lag)
    count = 2
    while count * period < 0.7 * u.size:  # the rest is enough to compare
        # an error of half a sample becomes one sample for twice the periods
        period = _best(u, round(count * period)) / count
        count *= 2
    return 1.0 / (period * dt)


def fastest_hz(u: Floats, part: Ints, dt: float) -> float:
    """Return the frequency [Hz] above which the rate of a drive (N,), sampled every dt [s], has
    hardly any power; the highest over its parts (N,)."""
    highest = 0.0
    for p in np.unique(part):
        rate = np.diff(u[part == p])
        if rate.size < 16 or not rate.any():  # samples: too few bins
            continue
        power = np.cumsum(np.abs(np.fft.rfft(rate * np.hanning(rate.size))) ** 2)
        edge = int(np.searchsorted(power, (1.0 - FASTEST) * power[-1]))
        highest = max(highest, edge / (rate.size * dt))
    return highest


def _unlike(u: Floats, lag: int) -> float:
    d = u[lag:] - u[:-lag]
    return rms(d)


def _settled(u: Floats, lag: int) -> int:
    """Return the nearby lag at which a drive (N,) differs least from itself. With few, finely
    sampled periods, the ends bias the best match."""
    first, reach = lag, NEARBY * lag
    while (nearer := _best(u, lag)) != lag and abs(nearer - first) <= reach:
        lag = nearer
    return lag


def _best(u: Floats, lag: int) -> int:
    lags = range(max(1, lag - REACH), min(u.size - 2, lag + REACH) + 1)
    return min(lags, key=lambda k: _unlike(u, k))
