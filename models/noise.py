"""How much of a residual is noise, how wide a band a drive has, and honest parameter intervals."""

from collections.abc import Iterable, Sequence

import numpy as np
from scipy.linalg import eigh

from dehyst.models.equations import Block, Params, Shape, add_products, jacobian, symmetric
from dehyst.models.recording import Bools, Floats

CLUSTERS = 150


def rough_rms(residual: Floats) -> float:
    """Rms of the part of a residual that changes from sample to sample (white noise: all of it).

    residual: (N,), NaN where unknown. From second differences, var(e[i-1] - 2 e[i] + e[i+1]) = 6
    var(e) for white noise, with the median so that lone outliers do not count. Noise that a
    filter has made smooth is underestimated; NaN when fewer than ten triples are known.
    """
    second = np.diff(residual, 2)
    second = second[~np.isnan(second)]
    if second.size < 10:
        return float("nan")
    return 1.4826 * float(np.median(np.abs(second))) / np.sqrt(6.0)


def drive_band_hz(u: Floats, period_s: float, share: float = 0.999) -> float | None:
    """Frequency below which `share` of the drive's power lies [Hz]; gaps are joined for this."""
    known = u[~np.isnan(u)]
    if known.size < 16:
        return None
    known = known[: 1 << 18]
    power = np.abs(np.fft.rfft((known - known.mean()) * np.hanning(known.size))) ** 2
    if power.sum() <= 0.0:
        return None
    at = int(np.searchsorted(np.cumsum(power), share * power.sum()))
    return float(max(at, 1) / (known.size * period_s))


def parameter_covariance(
    blocks: Iterable[Block], shape: Shape, params: Params, free: Bools, total: int
) -> Floats:
    """(p, p) covariance of the free parameters, zero for those on their bound.

    The sandwich (J'J)^-1 (sum over stretches of time of g g') (J'J)^-1 with g = J'e of one
    stretch: residuals that hang together in time, noise or misfit, widen the intervals as they
    should; the formula for white noise would make them too narrow.
    total: number of equations, which sets the stretch length.
    """
    size = params.packed().size
    gram, middle = np.zeros((size, size)), np.zeros((size, size))
    unused = np.zeros(size)
    stretch = max(1, total // CLUSTERS)
    open_score, filled = np.zeros(size), 0
    for block in blocks:
        jac, err = jacobian(block, shape, params)
        add_products(jac, err, gram, unused)
        start = 0
        while start < err.size:
            stop = min(err.size, start + stretch - filled)
            open_score += np.sum(jac[start:stop] * err[start:stop, None], axis=0)
            filled += stop - start
            start = stop
            if filled == stretch:
                middle += np.outer(open_score, open_score)
                open_score, filled = np.zeros(size), 0
    gram = symmetric(gram)
    at = np.flatnonzero(free)
    out = np.zeros((size, size))
    scale = np.sqrt(np.maximum(np.diag(gram)[at], 1e-300))
    values, vectors = eigh(gram[np.ix_(at, at)] / np.outer(scale, scale))
    values = np.maximum(values, 1e-12)
    inverse = (vectors / values) @ vectors.T / np.outer(scale, scale)
    out[np.ix_(at, at)] = inverse @ middle[np.ix_(at, at)] @ inverse
    return out


def autocorrelation(residual: Floats, lags: Sequence[int]) -> Floats:
    """Correlation of a residual (NaN where unknown) with itself at the given lags."""
    e = residual - np.nanmean(residual)
    power = float(np.nanmean(e * e))
    return np.array([np.nanmean(e[k:] * e[: e.size - k]) / power if power else 0.0 for k in lags])
