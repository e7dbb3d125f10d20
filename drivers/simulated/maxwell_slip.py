"""Hysteresis of the simulated stage: a dense Maxwell-slip model with different elements.

Each element is a spring that slips at its own strain D_i:

    p_i = (1 - a_i) x + a_i x^2              the drive x, bowed differently for each element
    z_i = clip(z_i + dp_i, -D_i, D_i)        spring stretch
    q   = (x - s sum_i k_i z_i) / norm
    m   = (exp(a q) - 1) / (exp(a) - 1)      static map after it

with x = volts / full scale and m = displacement / stroke. (Maxwell-slip: Lampaert, Swevers and
Al-Bender, "Modification of the Leuven integrated friction model structure", IEEE TAC 2002.) Because
every element bows the drive differently, the sum is not a Prandtl-Ishlinskii model: minor loops
depend on where in the range they lie, and the map is not an odd polynomial. So a model that dehyst
fits to this stage always leaves a residual, as it does on a real one. Stiffness grows with slip
strain, which makes small loops narrow: 12 % at full scale, 2 % at a tenth of it.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from dehyst.drivers.interface import DriverConfigError
from dehyst.models.arrays import Floats

COUNT = 64  # a multiple of 4
SMALLEST, LARGEST = 0.002, 0.6  # slip strains, as a share of full scale
STIFFNESS_POWER = 0.72  # k_i ~ D_i^power: loops of 2 % at a tenth of full scale
BOW_FINE, BOW_COARSE = -0.25, 0.30
POINTS = 400  # of each branch of the loop whose width is measured


@dataclass(frozen=True)
class Slip:
    """Elements (n,): slip strain d, stiffness k (scaled so that q needs no s), bow a; and norm."""

    d: Floats
    k: Floats
    bow: Floats
    norm: float


@njit(cache=True, nogil=True)
def slip_sum(d: Floats, k: Floats, bow: Floats, z: Floats, x0: float, x1: float) -> float:
    """Move the elements from drive x0 to x1 (monotone between); updates z (n,) in place.

    Returns sum_i k_i z_i.
    """
    dx = x1 - x0
    bend = x1 * x1 - x0 * x0 - dx
    for i in range(d.size):
        stretched = z[i] + dx + bow[i] * bend
        stretched = stretched if stretched < d[i] else d[i]
        z[i] = stretched if stretched > -d[i] else -d[i]
    # four partial sums: a single running sum would make each element wait for the previous one
    sums = (0.0, 0.0, 0.0, 0.0)
    for i in range(0, d.size, 4):
        sums = (
            sums[0] + k[i] * z[i],
            sums[1] + k[i + 1] * z[i + 1],
            sums[2] + k[i + 2] * z[i + 2],
            sums[3] + k[i + 3] * z[i + 3],
        )
    return sums[0] + sums[1] + sums[2] + sums[3]


@njit(cache=True, nogil=True)
def static_map(asymmetry: float, q: float) -> float:
    """Return m(q), with m(0) = 0 and m(1) = 1."""
    if asymmetry == 0.0:
        return q
    return float(np.expm1(asymmetry * q) / np.expm1(asymmetry))


@njit(cache=True, nogil=True)
def _sweep(d: Floats, k: Floats, bow: Floats, norm: float, asymmetry: float, x: Floats) -> Floats:
    """Return m along the drives x, starting with elements at rest."""
    out, z = np.empty(x.size), np.zeros(d.size)
    before = 0.0
    for t in range(x.size):
        total = slip_sum(d, k, bow, z, before, x[t])
        out[t] = static_map(asymmetry, (x[t] - total) / norm)
        before = x[t]
    return out


def loop_width(slip: Slip, asymmetry: float) -> float:
    """Return the largest width of the settled full loop, as a share of its stroke."""
    x = np.linspace(0.0, 1.0, POINTS)
    path = np.concatenate([x, x[::-1], x, x[::-1]])
    *_, up, falling = np.split(_sweep(slip.d, slip.k, slip.bow, slip.norm, asymmetry, path), 4)
    down = falling[::-1]
    return float(np.max(down - up) / (up[-1] - up[0]))


def build(width: float, asymmetry: float) -> Slip:
    """Return elements whose full loop has a width of `width` times its stroke.

    Raises DriverConfigError when the stage would move the wrong way after a reversal.
    """
    d = np.geomspace(SMALLEST, LARGEST, COUNT)
    bow = np.linspace(BOW_FINE, BOW_COARSE, COUNT)
    shape = d**STIFFNESS_POWER
    shape /= shape.sum()

    def scaled(s: float) -> Slip:
        k = shape * s
        virgin = 1.0 - slip_sum(d, k, bow, np.zeros(COUNT), 0.0, 1.0)
        return Slip(d, k, bow, virgin)

    if width == 0.0:
        return scaled(0.0)
    low, high = 0.0, 0.98
    for _ in range(40):  # the width grows with s; bisection to 1e-12
        middle = 0.5 * (low + high)
        if loop_width(scaled(middle), asymmetry) < width:
            low = middle
        else:
            high = middle
    slip = scaled(high)
    slope = 1.0 - np.max([slip.k @ (1.0 - bow + 2.0 * bow * x) for x in (0.0, 1.0)])
    if slope <= 0.05 or abs(loop_width(slip, asymmetry) - width) > 1e-3:
        raise DriverConfigError(f"stage: hysteresis_width = {width} is wider than a stack's loop")
    return slip
