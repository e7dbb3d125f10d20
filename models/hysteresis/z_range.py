"""How far z can go over a validity, and whether the model can be inverted everywhere there.

Reaching from drive_min to drive_max at rates from -R to R, z is largest where every operator is
pulled up as far as it goes, at one of the two extreme rates (Abel summation: the partial sums of
the weights are positive, and neighbouring operators differ by no more than their thresholds do).

A turn takes its time. When the drive has travelled x since it turned, at an acceleration of at most
A, its rate is at most sqrt(2 A x). Slope s_j is the one over the travel from 2 r_j to 2 r_{j+1}
(dehyst.models.hysteresis.monotone). So it needs to be positive up to the rate at which the drive
can leave that travel, and not up to the largest rate of all, at which it never meets it.
"""

import numpy as np

from dehyst.models.model import Hysteresis
from dehyst.models.recording import Floats


def bound_z(
    h: Hysteresis, drive_min: float, drive_max: float, rates: float | Floats
) -> tuple[float, float]:
    """Lowest and highest z within the drive range at rates up to the largest of these.

    rates: one for all slopes, or (n,) up to which each is positive (find_rates).
    """
    top = np.maximum(drive_max - h.u_offset - h.r, 0.0)
    bottom = np.minimum(drive_min - h.u_offset + h.r, 0.0)
    rate_max = float(np.max(rates))
    # slopes that may be negative at such a rate; H_j - H_{j+1} is at most the thresholds' distance
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
    """(n,) largest rate over the travel from 2 r_j to 2 r_{j+1} after a turn [drive unit / s].

    acceleration_max: largest change of the rate [drive unit / s^2], None: no bound; period_s: of
    samples between which the rate is the difference. In the sample that begins within a travel of x
    the rate is then at most A T / 2 + sqrt((A T / 2)^2 + 2 A x): at a higher one the samples before
    it, each slower by A T at most, would have gone beyond x already.
    """
    if not acceleration_max:
        return np.full(r.size, rate_max)
    a = 0.5 * acceleration_max * period_s
    travel = 2.0 * np.append(r[1:], np.inf)
    return np.minimum(rate_max, a + np.sqrt(a * a + 2.0 * acceleration_max * travel))


def find_least_slope(
    h: Hysteresis, drive_min: float, drive_max: float, rates: float | Floats
) -> float:
    """Smallest slope of the saturation over the reachable z, relative to its mean slope there.

    Positive: the saturation can be undone everywhere (rising or falling). Negative or zero: not.
    """
    low, high = bound_z(h, drive_min, drive_max, rates)
    if high <= low:
        return 0.0
    slope = np.asarray(np.polynomial.polynomial.polyder(h.c), dtype=np.float64)
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
    real = roots.real[np.abs(roots.imag) <= 1e-9 * (1.0 + np.abs(roots.real))]
    return real[(real > low) & (real < high)]


def sum_weights(h: Hysteresis, rates: float | Floats) -> tuple[Floats, Floats]:
    """(n,) slopes dz/du after each operator has joined in, at these rates and at minus these.

    rates: one for all, or (n,) one for each (find_rates).
    """
    p, q = np.cumsum(h.b), rates * np.cumsum(np.asarray(h.k))
    return p + q, p - q


def is_invertible(h: Hysteresis, drive_min: float, drive_max: float, rates: float | Floats) -> bool:
    """True when every slope is positive up to these rates and the saturation never turns.

    rates: one for all slopes, or (n,) one for each (find_rates).
    """
    alpha, beta = sum_weights(h, rates)
    return bool(
        alpha.min() > 0.0
        and beta.min() > 0.0
        and find_least_slope(h, drive_min, drive_max, rates) > 0.0
    )
