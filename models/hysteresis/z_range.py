"""How far z can go over a validity, and whether the model can be inverted everywhere there.

Reaching from drive_min to drive_max at rates from -R to R, z is largest where every operator is
pulled up as far as it goes, at one of the two extreme rates (Abel summation: the partial sums of
the weights are positive, and neighbouring operators differ by no more than their thresholds do).
"""

import numpy as np

from dehyst.models.model import Hysteresis
from dehyst.models.recording import Floats


def bound_z(
    h: Hysteresis, drive_min: float, drive_max: float, rate_max: float
) -> tuple[float, float]:
    """Lowest and highest z within the drive range at rates up to rate_max."""
    top = np.maximum(drive_max - h.u_offset - h.r, 0.0)
    bottom = np.minimum(drive_min - h.u_offset + h.r, 0.0)
    ends = [0.0]
    for rate in (-rate_max, 0.0, rate_max):
        w = h.b + np.asarray(h.k) * rate
        ends += [float(w @ top), float(w @ bottom)]
    return min(ends), max(ends)


def find_least_slope(h: Hysteresis, drive_min: float, drive_max: float, rate_max: float) -> float:
    """Smallest slope of the saturation over the reachable z, relative to its mean slope there.

    Positive: the saturation can be undone everywhere (rising or falling). Negative or zero: not.
    """
    low, high = bound_z(h, drive_min, drive_max, rate_max)
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


def sum_weights(h: Hysteresis, rate_max: float) -> tuple[Floats, Floats]:
    """(n,) slopes dz/du after each operator has joined in, at the rates rate_max and -rate_max."""
    p, q = np.cumsum(h.b), rate_max * np.cumsum(np.asarray(h.k))
    return p + q, p - q


def is_invertible(h: Hysteresis, drive_min: float, drive_max: float, rate_max: float) -> bool:
    """True when every slope is positive over the rate range and the saturation never turns."""
    alpha, beta = sum_weights(h, rate_max)
    return bool(
        alpha.min() > 0.0
        and beta.min() > 0.0
        and find_least_slope(h, drive_min, drive_max, rate_max) > 0.0
    )
