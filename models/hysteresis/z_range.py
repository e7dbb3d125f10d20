"""Bound z over a model's validity, and check that the model can be inverted everywhere there.

For drives from drive_min to drive_max at rates from -R to R, z is largest where every operator is
at its upper end, at one of the two extreme rates (Abel summation: the partial sums of the weights
are positive, and neighbouring operators differ by at most the difference of their thresholds).

The rate is limited after a turn. Once the drive has travelled x since a turn, at an acceleration of
at most A, its rate is at most sqrt(2 A x). Slope s_j holds over the travel from 2 r_j to 2 r_{j+1}
(dehyst.models.hysteresis.monotone). It therefore needs to be positive only up to the highest rate
that the drive can reach by the end of that travel, not up to the highest rate of all.
"""

import numpy as np

from dehyst.models.model import Hysteresis
from dehyst.models.recording import Floats


def bound_z(
    h: Hysteresis, drive_min: float, drive_max: float, rates: float | Floats
) -> tuple[float, float]:
    """Return bounds of z, lowest and highest, within the drive range at rates up to max(rates).

    rates: one for all slopes, or (n,), the rate up to which each slope is positive (find_rates).
    """
    top = np.maximum(drive_max - h.u_offset - h.r, 0.0)
    bottom = np.minimum(drive_min - h.u_offset + h.r, 0.0)
    rate_max = float(np.max(rates))
    # slopes that may be negative at rate_max; |H_j - H_{j+1}| is at most r_{j+1} - r_j
    free = np.broadcast_to(rates, h.r.shape) < rate_max
    apart = np.where(free, np.diff(h.r, append=np.inf), 0.0)
    ends = [0.0]
    for rate in (-rate_max, 0.0, rate_max):
        slopes = np.cumsum(h.b + np.asarray(h.k) * rate)
        w = np.diff(np.where(free, 0.0, slopes), prepend=0.0)
        beside = float(np.abs(slopes) @ apart)
        ends += [float(w @ top) + beside, float(w @ bottom) - beside]
    return min(ends), max(ends)


def find_rates(
    r: Floats, rate_max: float, acceleration_max: float | None = None, period_s: float = 0.0
) -> Floats:
    """Return the (n,) highest rates over the travel from 2 r_j to 2 r_{j+1} after a turn
    [drive unit / s].

    acceleration_max: bound on the acceleration [drive unit / s^2], None: no bound; period_s:
    sampling period T [s] of the difference that gives the rate. In a sample that begins within a
    travel of x the rate is at most A T / 2 + sqrt((A T / 2)^2 + 2 A x): at a higher rate the
    samples before it, each slower by at most A T, would already have travelled more than x.
    """
    if not acceleration_max:
        return np.full(r.size, rate_max)
    a = 0.5 * acceleration_max * period_s
    travel = 2.0 * np.append(r[1:], np.inf)
    return np.minimum(rate_max, a + np.sqrt(a * a + 2.0 * acceleration_max * travel))


def find_least_slope(
    h: Hysteresis, drive_min: float, drive_max: float, rates: float | Floats
) -> float:
    """Return the smallest slope of the saturation over the reachable z, relative to the mean there.

    Positive: the saturation, rising or falling, can be inverted everywhere. Otherwise it cannot.
    """
    low, high = bound_z(h, drive_min, drive_max, rates)
    if high <= low:
        return 0.0
    slope = np.asarray(np.polynomial.polynomial.polyder(h.c), dtype=np.float64)
    # 257 evenly spaced values give the mean, the extrema the smallest slope
    at = np.concatenate([np.linspace(low, high, 257), _find_extrema(slope, low, high)])
    values = np.polynomial.polynomial.polyval(at, slope)
    mean = float(np.mean(values[:257]))
    return float(np.min(values * np.sign(mean))) / abs(mean) if mean else 0.0


def _find_extrema(slope: Floats, low: float, high: float) -> Floats:
    second = np.polynomial.polynomial.polyder(slope)
    second = np.trim_zeros(second, "b")
    if second.size < 2:
        return np.empty(0)
    roots = np.roots(second[::-1])
    real = roots.real[np.abs(roots.imag) <= 1e-9 * (1.0 + np.abs(roots.real))]  # rounding
    return real[(real > low) & (real < high)]


def sum_weights(h: Hysteresis, rates: float | Floats) -> tuple[Floats, Floats]:
    """Return the (n,) slopes dz/du once each operator moves, at these rates and at minus these.

    rates: one for all, or (n,) one for each (find_rates).
    """
    p, q = np.cumsum(h.b), rates * np.cumsum(np.asarray(h.k))
    return p + q, p - q


def is_invertible(h: Hysteresis, drive_min: float, drive_max: float, rates: float | Floats) -> bool:
    """Return True if every slope is positive up to these rates and the saturation is monotone.

    rates: one for all slopes, or (n,) one for each (find_rates).
    """
    alpha, beta = sum_weights(h, rates)
    return bool(
        alpha.min() > 0.0
        and beta.min() > 0.0
        and find_least_slope(h, drive_min, drive_max, rates) > 0.0
    )
