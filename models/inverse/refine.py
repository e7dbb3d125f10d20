"""Solve a whole trajectory as one window: Gauss-Newton sweeps, and their refinement.

The sweeps take all operators as moving (dehyst.models.inverse.window). In the exact Jacobian an
operator at rest depends on the drive of the sample in which it last moved: dH_i(t)/du = 1 for that
sample and 0 elsewhere. The sweeps ignore that.
"""

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numba import njit
from numpy.typing import NDArray
from scipy.sparse.linalg import spsolve

from dehyst.models.hysteresis.operators import Operators
from dehyst.models.inverse.compensator import Compensator, CompensatorState
from dehyst.models.inverse.state import FRAME, Nodes
from dehyst.models.inverse.tuning import TUNING
from dehyst.models.inverse.window import evaluate, gauss_newton_step
from dehyst.models.model import Floats

HELD = 1e12  # times slope^2: damping that fixes a sample


class Exact(NamedTuple):
    """Error (N,), and the Jacobian as triplets row, col, value."""

    error: NDArray[np.float64]
    row: NDArray[np.int64]
    col: NDArray[np.int64]
    value: NDArray[np.float64]


@njit(cache=True, nogil=True)
def _exact(
    hysteresis: Operators, x: Floats, x_0: float, h: Floats, dt: float, target: Floats, out: Exact
) -> int:
    """Write error and exact Jacobian to `out`; advance h (n,) at x_0. Return the triplet count."""
    weights, c, u_offset = hysteresis.weights, hysteresis.c, hysteresis.u_offset[0]
    error, row, col, value = out.error, out.row, out.col, out.value
    n = h.size
    moved = np.full(n, -1)
    count = 0
    before = x_0
    for t in range(x.size):
        v = x[t] - u_offset
        rate = (x[t] - before) / dt
        z, kh = 0.0, 0.0
        for i in range(n):
            r = weights[0, i]
            if v - r >= h[i]:
                h[i] = v - r
                moved[i] = t
            elif v + r <= h[i]:
                h[i] = v + r
                moved[i] = t
            z += weights[1, i] * h[i]
            kh += weights[2, i] * h[i]
        z += rate * kh
        y, slope = 0.0, 0.0
        for m in range(c.size - 1, -1, -1):
            slope = slope * z + y
            y = y * z + c[m]
        error[t] = y - target[t]
        for i in range(n):
            if moved[i] >= 0:
                row[count], col[count] = t, moved[i]
                value[count] = slope * (weights[1, i] + rate * weights[2, i])
                count += 1
        row[count], col[count], value[count] = t, t, slope * kh / dt
        count += 1
        if t > 0:
            row[count], col[count], value[count] = t, t - 1, -slope * kh / dt
            count += 1
        before = x[t]
    return count


def refine(
    comp: Compensator, x: Floats, start: CompensatorState, target: Floats, kept: int
) -> Floats:
    """Refine a drive x (N,) by Levenberg-Marquardt with the exact Jacobian, in range and rate.

    The first `kept` samples are not changed.
    """
    n = x.size
    dt = comp.period_s
    size = n * (comp.model.hysteresis.n + 2)
    out = Exact(np.empty(n), np.empty(size, np.int64), np.empty(size, np.int64), np.empty(size))
    error, row, col, value = out
    bend = sp.diags_array([1.0, -2.0, 1.0], offsets=[0, 1, 2], shape=(n - 2, n)).tocsc()
    rough = TUNING.whole_smooth * comp.slope**2 * (1e-3 / dt) ** 4 * (bend.T @ bend)
    x_0 = float(start.inverse.state["last"][0])

    def at(drive: Floats) -> tuple[float, sp.csc_array]:
        h = start.inverse.plays.copy()
        count = _exact(comp.hysteresis, drive, x_0, h, dt, target, out)
        jacobian = sp.csc_array((value[:count], (row[:count], col[:count])), shape=(n, n))
        return float(error @ error + drive @ (rough @ drive)), jacobian

    cost, jacobian = at(x)
    last = error.copy()
    damping = 1e-3 * comp.slope**2
    held = np.where(np.arange(n) < kept, HELD * comp.slope**2, 0.0)
    stalled = 0
    for _ in range(TUNING.refinements):
        stay = sp.diags_array(damping + held)
        normal = (jacobian.T @ jacobian + rough + stay).tocsc()
        step = spsolve(normal, jacobian.T @ last + rough @ x)
        step[:kept] = 0.0
        if not np.all(np.isfinite(step)):
            break
        trial = limit_drive(comp, x - step, x_0)
        new, there = at(trial)
        if new < cost:
            stalled = stalled + 1 if cost - new < TUNING.settled * cost else 0
            x, cost, jacobian, last = trial, new, there, error.copy()
            damping *= 0.3
        else:
            stalled += 1
            damping *= 5.0
        if stalled >= 6 or cost < 1e-20 * n * comp.slope**2:
            break
    return x


@njit(cache=True, nogil=True)
def _limit(x: Floats, x_0: float, low: float, high: float, travel: float) -> None:
    """Limit a drive to range and rate, in place."""
    now = x_0
    for j in range(x.size):
        now = min(max(x[j], now - travel, low), now + travel, high)
        x[j] = now


def limit_drive(comp: Compensator, x: Floats, x_0: float) -> Floats:
    """Return a drive x (N,) that starts from x_0, limited to range and rate."""
    out = np.ascontiguousarray(x)
    _limit(out, x_0, comp.low, comp.high, comp.rate * comp.period_s)
    return out


def improve_by_sweeps(
    comp: Compensator, x: Floats, start: CompensatorState, target: Floats
) -> Floats:
    """Improve a drive x (N,) by Gauss-Newton sweeps over the whole trajectory."""
    n, dt = x.size, comp.period_s
    smooth = np.full(n, TUNING.whole_smooth * comp.slope**2 * (1e-3 / dt) ** 4)
    frame = np.zeros(1, FRAME)
    nodes = Nodes(target, np.ones(n), smooth, np.zeros((4, n)), np.zeros((4, n)), frame)
    x_0, h_0 = float(start.inverse.state["last"][0]), start.inverse.plays
    h = h_0.copy()
    spring = TUNING.spring * comp.slope**2
    frame[0] = (x_0, x_0, dt, 0.5, comp.low, comp.high, comp.rate * dt, spring)

    def cost(drive: Floats) -> float:
        error, rough = evaluate(comp.hysteresis, nodes, drive, h_0, h)
        return error + rough

    best = cost(x)
    damping = comp.slope**2
    stalled = 0
    for _ in range(TUNING.whole_sweeps):
        gauss_newton_step(nodes, x, damping)
        trial = x - nodes.bands[3]
        new = cost(trial) if np.all(np.isfinite(trial)) else np.inf
        if new < best:
            stalled = stalled + 1 if best - new < TUNING.settled * best else 0
            x, best, damping = trial, new, max(0.3 * damping, 1e-9 * comp.slope**2)
        else:
            stalled += 1
            damping = min(4.0 * damping, 1e3 * comp.slope**2)
            cost(x)
        if stalled >= 12:
            break
    return limit_drive(comp, x, x_0)
