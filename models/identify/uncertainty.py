"""Estimate the noise in a residual, the bandwidth of a drive, and the parameters' intervals."""

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.polynomial import Polynomial
from scipy.linalg import eigh
from scipy.special import stdtrit

from dehyst.models.identify.equations import (
    Equations,
    Normal,
    Params,
    Shape,
    linearise,
)
from dehyst.models.identify.tuning import TUNING
from dehyst.models.recording import Bools, Floats
from dehyst.models.signals.error_size import Z95
from dehyst.models.signals.rounding import rounding_rms

LONG, PARTS = 1_000_000, 20  # rows used of a longer residual, and their number of parts
LARGEST_LEVERAGE = 0.99
"""Upper limit of the leverage of one stretch: 1 - leverage stays positive if one stretch alone
determines a parameter."""

MANY, FARTHEST, PLAINLY = 100, 8, 0.7
"""Least number of differences for medians to be compared; largest distance in samples between which
differences are taken (one of the distances from 1 to 8 is within a ninth of a period of a whole
number of periods, whatever the period); and the ratio of medians that white noise does not reach by
chance."""
OUTLYING = 6.0
"""Standard deviations of the noise beyond which a difference belongs to an outlier."""


def fit_trend(values: Floats) -> tuple[float, float]:
    """Return the slope of a straight line through values (N,), per value, and its standard
    error."""
    at = np.arange(values.size) - 0.5 * (values.size - 1)
    slope = float(at @ values) / float(at @ at)
    rest = values - values.mean() - slope * at
    return slope, float(np.sqrt(rest @ rest / (values.size - 2) / (at @ at)))


def estimate_noise(residual: Floats, step: float = 0.0) -> float:
    """Return the rms of the part of a residual that changes from sample to sample (white noise: all
    of it).

    residual: (N,), NaN where unknown; step: of the reading's rounding (`signals.rounding.quantum`).
    From second differences, var(e[i-1] - 2 e[i] + e[i+1]) = 6 var(e) for white noise, by the
    median, so that lone outliers do not count. A line of hum that has few samples to a period
    changes from sample to sample too, but hardly over a whole number of its periods: where the
    differences of samples further apart are plainly smaller, these are used. Where the reading is
    rounded to steps larger than that noise, the median is one of a few multiples of the step: then
    the rms is used, and the result is never less than the rms of the rounding. Noise that a filter
    has smoothed is underestimated; NaN when fewer than ten triples are known.
    """
    second = _difference_twice(residual, 1)
    if second.size < 10:
        return float("nan")
    if second.size >= MANY:
        each = [_difference_twice(residual, apart) for apart in range(2, FARTHEST + 1)]
        calmest = min(each, key=_typical)
        second = calmest if _typical(calmest) < PLAINLY * _typical(second) else second
    noise = 1.4826 * _typical(second) / 6.0**0.5
    if step <= noise:
        return noise
    least = rounding_rms(step)
    inner = second[np.abs(second) <= OUTLYING * np.sqrt(6.0) * max(noise, least)]
    return max(float(np.sqrt(np.mean(inner**2) / 6.0)), least)


def _typical(second: Floats) -> float:
    return float(np.median(np.abs(second)))


def _difference_twice(residual: Floats, apart: int) -> Floats:
    """Return the known second differences of samples that are `apart` rows apart."""
    if residual.size > LONG:  # parts of it are sufficient
        parts = np.array_split(residual, PARTS)
        residual = np.concatenate([part[: LONG // PARTS] for part in parts])
    for known in (residual, residual[~np.isnan(residual)]):  # a slow sensor's: of its readings
        first = known[apart:] - known[:-apart]
        second = first[apart:] - first[:-apart]
        second = second[~np.isnan(second)]
        if second.size >= 10:
            break
    return second


def measure_band_hz(u: Floats, period_s: float, share: float = 0.999) -> float | None:
    """Return the frequency below which `share` of the power of the drive lies [Hz]; gaps are closed
    for this."""
    known = u[~np.isnan(u)]
    if known.size < 16:  # rows: their spectrum has too few bins
        return None
    known = known[: 1 << 18]  # rows, to save time
    power = np.abs(np.fft.rfft((known - known.mean()) * np.hanning(known.size))) ** 2
    if power.sum() <= 0.0:
        return None
    at = int(np.searchsorted(np.cumsum(power), share * power.sum()))
    return float(max(at, 1) / (known.size * period_s))


class Jackknife(NamedTuple):
    """covariance: (p, p) of the free parameters, zero for those on their bound; by_noise: (p, p)
    their covariance due to white noise of variance 1; left_out: (n,) y - model of each equation,
    with the parameters fitted without its stretch of time."""

    covariance: Floats
    by_noise: Floats
    left_out: Floats


def leave_stretches_out(
    equations: Sequence[Equations], shape: Shape, params: Params, free: Bools, whole: Normal
) -> Jackknife:
    """Return the covariance and out-of-sample errors of the parameters, by leaving out stretches of
    time.

    This is the delete-one-stretch jackknife in its one-step Gauss-Newton form (B. Efron, C. Stein,
    Ann. Stat. 9, 1981): residuals that are correlated in time, noise or misfit, widen the intervals
    as they should; the formula for white noise would make them too narrow. So would a jackknife
    without the leverage of a stretch, if a parameter depends on few stretches.

    equations: the lots; whole: the normal equations that were solved, including the prior.
    """
    measured = [lot for lot in equations if lot.weight == 1.0]
    total = sum(lot.y.size for lot in measured)
    at = np.flatnonzero(free)
    here = np.ix_(at, at)
    stretch = max(1, total // TUNING.stretches)
    size = params.packed().size
    gram = whole.gram
    scale = np.sqrt(np.maximum(np.diag(gram)[at], 1e-300))
    values, vectors = eigh(gram[here] / np.outer(scale, scale))
    white = vectors / np.sqrt(np.maximum(values, 1e-12)) / scale[:, None]
    moves, left_out = [], []
    for jac, err in _list_stretches(measured, shape, params, stretch):
        jac = jac[:, at]
        leverage, along = eigh(white.T @ (jac.T @ jac) @ white)
        without = 1.0 - np.minimum(leverage, LARGEST_LEVERAGE)
        move = white @ (along @ ((along.T @ (white.T @ (jac.T @ err))) / without))
        moves.append(move)
        left_out.append(err + jac @ move)
    out, by_noise = np.zeros((size, size)), np.zeros((size, size))
    by_noise[here] = white @ white.T
    count = len(moves)
    # Student's factor for few stretches: Z95 standard errors are then a 95 % interval
    few = (stdtrit(max(count - 1, 1), 0.975) / Z95) ** 2
    out[here] = few * (count - 1) / max(count, 1) * (np.transpose(moves) @ np.array(moves))
    return Jackknife(out, by_noise, np.concatenate(left_out))


def _list_stretches(
    equations: Iterable[Equations], shape: Shape, params: Params, stretch: int
) -> Iterator[tuple[Floats, Floats]]:
    """Yield J (n, p) and e (n,) of each stretch of this many equations; the last may be shorter."""
    jacs, errs, filled = [], [], 0
    for lot in equations:
        jac, err = linearise(lot, shape, params)
        start = 0
        while start < err.size:
            stop = min(err.size, start + stretch - filled)
            jacs.append(jac[start:stop])
            errs.append(err[start:stop])
            filled += stop - start
            start = stop
            if filled == stretch:
                yield np.concatenate(jacs), np.concatenate(errs)
                jacs, errs, filled = [], [], 0
    if filled:
        yield np.concatenate(jacs), np.concatenate(errs)


def move_saturation(covariance: Floats, powers: Sequence[int], shift: float) -> Floats:
    """Return the standard errors (n,) of the coefficients of these powers in S(z - shift).

    covariance: (n, n) of those in S(z). The uncertainty of the shift itself is ignored.
    """
    moved = np.zeros((len(powers), len(powers)))
    for j, power in enumerate(powers):
        coef = Polynomial([-shift, 1.0]) ** power
        moved[:, j] = [coef.coef[p] if p <= power else 0.0 for p in powers]
    return np.sqrt(np.maximum(np.diag(moved @ covariance @ moved.T), 0.0))
