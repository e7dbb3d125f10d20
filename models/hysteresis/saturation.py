"""The saturation polynomial y = c_0 + c_1 z + c_2 z^2 + ... and its inverse on a monotone branch.

The polynomial may have any degree, be odd or not, rise or fall (Qin et al., Eq. 5, generalised).
The inverse exists only between two neighbouring extrema. A displacement outside that branch is not
reachable; the inverse then returns the nearest end of the branch.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from dehyst.models.hysteresis.forward import polynomial
from dehyst.models.model import Floats

KNOTS = 129


@njit(cache=True, nogil=True)
def slope(c: Floats, z: float) -> float:
    """Return dy/dz at z."""
    s = 0.0
    for j in range(c.size - 1, 0, -1):
        s = s * z + j * c[j]
    return s


@njit(cache=True, nogil=True)
def _solve(c: Floats, y: float, z: float, lo: float, hi: float, rising: bool) -> float:
    """Return z in [lo, hi] with polynomial(c, z) = y, starting from the guess z.

    Takes Newton steps; where one leaves the bracket it bisects. Stops once the step is within the
    last bits of z.
    """
    for _ in range(100):
        error = polynomial(c, z) - y
        if error == 0.0:
            break
        if (error > 0.0) == rising:
            hi = z
        else:
            lo = z
        gradient = slope(c, z)
        new = z - error / gradient if gradient != 0.0 else lo - 1.0
        if not (lo <= new <= hi):
            new = 0.5 * (lo + hi)
        moved = abs(new - z)
        z = new
        if moved <= 2.3e-16 * max(abs(z), 1e-3 * (abs(lo) + abs(hi))):
            break
    return z


@njit(cache=True, nogil=True)
def unsaturate(c: Floats, z_knots: Floats, y_first: float, y_last: float, y: float) -> float:
    """Return z with polynomial(c, z) = y on the branch; for y outside it, the nearest end.

    z_knots: (K,) ascending or descending z at K values of y spaced evenly from y_first to y_last;
    two neighbouring knots are the first bracket.
    """
    last = z_knots.size - 1
    position = (y - y_first) / (y_last - y_first) * last
    if position <= 0.0:
        return z_knots[0]
    if position >= last:
        return z_knots[last]
    if c.size == 2:
        return (y - c[0]) / c[1]
    j = min(int(position), last - 1)
    a, b = z_knots[j], z_knots[j + 1]
    guess = a + (position - j) * (b - a)
    return _solve(c, y, guess, min(a, b), max(a, b), (b > a) == (y_last > y_first))


@dataclass(frozen=True)
class Branch:
    """One monotone branch of a saturation polynomial.

    c: (m + 1,) ascending coefficients; z_knots: (KNOTS,) ascending z whose displacements are
    evenly spaced from y_first (at z_knots[0]) to y_last (at z_knots[-1]); whole: the branch
    covers the whole requested range.
    """

    c: Floats
    z_knots: Floats
    y_first: float
    y_last: float
    whole: bool

    @property
    def rising(self) -> bool:
        """True if the displacement increases with z."""
        return self.y_last > self.y_first


def branch(c: Floats, z_low: float, z_high: float) -> Branch:
    """Return the monotone branch that covers most of [z_low, z_high] (z_low < z_high)."""
    extrema = np.array([])
    if c.size > 2:
        derivative = c[1:] * np.arange(1, c.size)
        scale = max(abs(z_low), abs(z_high))
        sizes = np.abs(derivative) * scale ** np.arange(derivative.size)
        while derivative.size > 1 and sizes[-1] < 1e-14 * sizes.max():
            derivative, sizes = derivative[:-1], sizes[:-1]
        roots = np.roots(derivative[::-1]) if derivative.size > 1 else np.array([])
        real = roots.real[np.abs(roots.imag) <= 1e-7 * scale]
        extrema = np.sort(real[(real > z_low) & (real < z_high)])
    ends = np.concatenate([[z_low], extrema, [z_high]])
    # Merge neighbouring pieces of equal direction (saddles, rounding in the roots).
    values = np.array([polynomial(c, z) for z in ends])
    pieces: list[tuple[float, float]] = []
    direction = 0.0
    for i in range(ends.size - 1):
        d = np.sign(values[i + 1] - values[i])
        if d == 0.0:
            continue
        if pieces and d == direction and pieces[-1][1] == ends[i]:
            pieces[-1] = (pieces[-1][0], ends[i + 1])
        else:
            pieces.append((ends[i], ends[i + 1]))
        direction = d
    if not pieces:
        pieces = [(z_low, z_high)]
    a, b = max(pieces, key=lambda p: p[1] - p[0])
    y_a, y_b = polynomial(c, a), polynomial(c, b)
    levels = np.linspace(y_a, y_b, KNOTS)
    middle = 0.5 * (a + b)
    knots = np.array([_solve(c, y, middle, a, b, y_b > y_a) for y in levels])
    knots[0], knots[-1] = a, b
    whole = b - a >= (z_high - z_low) * (1 - 1e-12)
    return Branch(np.asarray(c, np.float64), np.maximum.accumulate(knots), y_a, y_b, whole)
