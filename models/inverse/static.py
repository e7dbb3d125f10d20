"""Invert the rate-independent model exactly, one sample at a time, without iteration.

From a known state, g(u) = sum_i b_i H_i(u) is piecewise linear in the next input u. Going up from
the last input v, operator i starts to move at H_i + r_i; going down, at H_i - r_i. These
breakpoints are in the order of the thresholds (H_{r+s} is a play of width s on H_r, so
|H_i - H_j| <= r_i - r_j), and after the j-th the slope is the partial sum P_j. The walk subtracts
piece after piece from the remaining change of g until the rest fits into one piece: exact to
rounding, at most n + 1 pieces.

The saturation is inverted before the walk, on its monotone branch
(dehyst.models.hysteresis.saturation).
"""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dehyst.models.errors import BadModel
from dehyst.models.hysteresis.monotone import require_monotone, z_range
from dehyst.models.hysteresis.play import play_step
from dehyst.models.hysteresis.saturation import Branch, branch, unsaturate
from dehyst.models.inverse.state import LIMITS, StaticTables
from dehyst.models.model import Floats, Model

BEYOND_SATURATION = 1  # the displacement is not on the saturation's monotone branch
BEYOND_DRIVE = 2  # the drive range ends before the displacement is reached


@njit(cache=True, nogil=True)
def walk(
    r: Floats, b: Floats, h: Floats, last: float, v_min: float, v_max: float, z: float
) -> tuple[float, bool]:
    """Return the input v nearest to `last` in [v_min, v_max] with sum_i b_i H_i(v) = z.

    r, b: (n,) ascending thresholds, and weights whose partial sums have one sign; h: (n,) operator
    outputs after the input `last`, not changed. Returns the input and whether z is reached.
    """
    n = r.size
    rest = z
    total = 0.0
    for i in range(n):
        rest -= b[i] * h[i]
        total += b[i]
    if rest == 0.0:
        return min(max(last, v_min), v_max), v_min <= last <= v_max
    up = (rest > 0.0) == (total > 0.0)
    v = last
    slope = 0.0
    if up:
        for i in range(n):
            corner = h[i] + r[i]
            if corner > v:
                if v_max < corner:
                    corner = v_max
                part = slope * (corner - v)
                if abs(part) >= abs(rest) and slope != 0.0:
                    return v + rest / slope, True
                if corner >= v_max:
                    return v_max, abs(part) >= abs(rest)
                rest -= part
                v = corner
            slope += b[i]
        if slope == 0.0:
            return v, False
        v += rest / slope
        return min(v, v_max), v <= v_max
    for i in range(n):
        corner = h[i] - r[i]
        if corner < v:
            if v_min > corner:
                corner = v_min
            part = slope * (corner - v)
            if abs(part) >= abs(rest) and slope != 0.0:
                return v + rest / slope, True
            if corner <= v_min:
                return v_min, abs(part) >= abs(rest)
            rest -= part
            v = corner
        slope += b[i]
    if slope == 0.0:
        return v, False
    v += rest / slope
    return max(v, v_min), v >= v_min


@njit(cache=True, nogil=True)
def inverse_step(static: StaticTables, h: Floats, last: float, y: float) -> tuple[float, int]:
    """Return the drive for displacement y, and flags. h (n,): plays after `last`; not advanced."""
    limits = static.limits[0]
    u_offset, drive_min, drive_max = limits.u_offset, limits.low, limits.high
    y_first, y_last = limits.y_first, limits.y_last
    flags = 0
    if y < min(y_first, y_last) or y > max(y_first, y_last):
        flags = BEYOND_SATURATION
    z = unsaturate(static.c, static.z_knots, y_first, y_last, y)
    v, reached = walk(
        static.r, static.b, h, last - u_offset, drive_min - u_offset, drive_max - u_offset, z
    )
    if not reached:
        flags |= BEYOND_DRIVE
    return min(max(v + u_offset, drive_min), drive_max), flags


@njit(cache=True, nogil=True)
def _inverse_array(
    static: StaticTables, h: Floats, last: float, y: Floats, u: Floats, flags: NDArray[np.int64]
) -> None:
    for t in range(y.size):
        u[t], flags[t] = inverse_step(static, h, last, y[t])
        last = u[t]
        play_step(static.r, h, last - static.limits[0].u_offset)


@dataclass(frozen=True)
class StaticInverse:
    """Parameters of the exact inverse. The caller holds the state: plays h (n,) and the last drive.

    `static_inverse` makes it. drive_min, drive_max: range [drive unit]; branch: where the
    saturation can be inverted.
    """

    r: Floats
    b: Floats
    branch: Branch
    u_offset: float
    drive_min: float
    drive_max: float

    @property
    def tables(self) -> StaticTables:
        """Return the parameters in the form that the kernels take."""
        s, limits = self.branch, np.zeros(1, LIMITS)
        limits[0] = (self.u_offset, s.y_first, s.y_last, self.drive_min, self.drive_max)
        return StaticTables(self.r, self.b, s.c, s.z_knots, limits)

    def step(self, h: Floats, last: float, y: float) -> tuple[float, int]:
        """Return the drive for displacement y, and flags: BEYOND_... bits, 0 where it is reached.

        h: (n,) operator outputs after the drive `last`. Neither is changed: advance h with
        play_step(r, h, u - u_offset) by the drive that is really applied.
        """
        return inverse_step(self.tables, h, last, y)

    def run(
        self, y: Floats, h0: Floats | None = None, last: float = 0.0
    ) -> tuple[Floats, NDArray[np.int64]]:
        """Return drives (N,) and flags (N,) int64 for displacements y (N,), starting from the plays
        h0 after the drive `last`; None: driven to `last` from de-energised."""
        h = np.zeros(self.r.size) if h0 is None else np.array(h0, dtype=np.float64)
        play_step(self.r, h, last - self.u_offset)
        y = np.ascontiguousarray(y, dtype=np.float64)
        u, flags = np.empty(y.size), np.zeros(y.size, np.int64)
        _inverse_array(self.tables, h, last, y, u, flags)
        return u, flags


def static_inverse(
    model: Model, drive_min: float | None = None, drive_max: float | None = None
) -> StaticInverse:
    """Return the exact inverse of the model's static part over a drive range (default: validity).

    Raises NotInvertible where the weights b are not monotone; the error states how far the nearest
    monotone model is (`dehyst.models.hysteresis.monotone.nearest_monotone` computes it). Slopes k
    and blocks are ignored.
    """
    h, v = model.hysteresis, model.validity
    low = v.drive_min if drive_min is None else drive_min
    high = v.drive_max if drive_max is None else drive_max
    if not low < high:
        raise BadModel(f"drive range: the upper end {high:g} must be above the lower end {low:g}")
    require_monotone(model)
    return StaticInverse(h.r, h.b, branch(h.c, *z_range(h, low, high)), h.u_offset, low, high)
