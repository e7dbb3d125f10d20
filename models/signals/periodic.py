"""Does the drive repeat itself, and at which frequency? How fast is its fastest part?"""

import numpy as np

from dehyst.models.signals.joined import Floats, Ints

FASTEST = 1e-3  # of the power of the drive's rate, that lies above its fastest part

REPEATS = 0.03  # rms of drive minus drive one period before, over the drive's rms
REACH = 2  # samples to either side
NEARBY = 0.02  # of a shift: by so much the ends may draw the best match aside


def period_samples(u: Floats) -> int:
    """Shift of the best match of a drive (N,) with itself, up to half its length; 0: none."""
    return _best_match(u)[0]


def _best_match(u: Floats) -> tuple[int, int]:
    """(shift of the best match, shift from which on a match is more than slowness); 0: none."""
    n = u.size
    x = u - u.mean()
    spectrum = np.abs(np.fft.rfft(x, 2 * n)) ** 2
    match = np.fft.irfft(spectrum)[: n // 2 + 1] / np.arange(n, n - n // 2 - 1, -1)
    low = int(np.argmax(match < 0.5 * match[0]))
    return (low + int(np.argmax(match[low:])) if low else 0), low


def fundamental_hz(u: Floats, dt: float) -> float:
    """Frequency of a drive (N,) that repeats itself, sampled every dt [s]; 0 where it does not.

    A match many periods on, divided by their number, gives it to a part of a sample.
    """
    lag, low = _best_match(u)
    if lag == 0 or np.ptp(u) == 0:
        return 0.0
    lag = _settled(u, lag)
    # a period need not be a whole number of samples
    most = REPEATS * float(np.std(u)) + 0.5 * float(np.sqrt(np.mean(np.diff(u) ** 2)))
    if lag < max(4, low) or _unlike(u, lag) > most:
        return 0.0
    for parts in range(lag // max(4, 2 * low), 1, -1):  # the best match may be several periods on
        shorter = round(lag / parts)
        if _unlike(u, shorter) < most:
            lag = _best(u, shorter)
            break
    period = float(lag)
    count = 2
    while count * period < 0.7 * u.size:
        # half a sample at half as many periods is one sample here
        period = _best(u, round(count * period)) / count
        count *= 2
    return 1.0 / (period * dt)


def fastest_hz(u: Floats, part: Ints, dt: float) -> float:
    """Frequency above which a drive (N,), sampled every dt [s], has hardly any of its rate's power;
    the highest of its parts (N,)."""
    highest = 0.0
    for p in np.unique(part):
        rate = np.diff(u[part == p])
        if rate.size < 16 or not rate.any():
            continue
        power = np.cumsum(np.abs(np.fft.rfft(rate * np.hanning(rate.size))) ** 2)
        edge = int(np.searchsorted(power, (1.0 - FASTEST) * power[-1]))
        highest = max(highest, edge / (rate.size * dt))
    return highest


def _unlike(u: Floats, lag: int) -> float:
    d = u[lag:] - u[:-lag]
    return float(np.sqrt(np.mean(d * d)))


def _settled(u: Floats, lag: int) -> int:
    """The lag nearby at which a drive (N,) is most like itself: of few periods that are finely
    sampled, the ends draw the best match to one side."""
    first, reach = lag, NEARBY * lag
    while (nearer := _best(u, lag)) != lag and abs(nearer - first) <= reach:
        lag = nearer
    return lag


def _best(u: Floats, lag: int) -> int:
    lags = range(max(1, lag - REACH), min(u.size - 2, lag + REACH) + 1)
    return min(lags, key=lambda k: _unlike(u, k))
