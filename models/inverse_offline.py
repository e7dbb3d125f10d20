"""The inverse of a whole trajectory at once, to convergence.

Three drives are made and the best by the model's own prediction is kept: the static inverse, the
Gauss-Newton sweeps of the preview over the whole trajectory as one window, and the sweeps refined
with the exact Jacobian. In the exact one an operator that stands still keeps the drive of the
sample in which it last moved, dH_i(t)/du = 1 there and 0 elsewhere; the sweeps are blind to that.
"""

import math
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numba import njit
from numpy.typing import NDArray
from scipy.sparse.linalg import spsolve

from dehyst.models import compensate
from dehyst.models import inverse_places as places
from dehyst.models.cascade_step import undo
from dehyst.models.compensator import Compensator, CompensatorState
from dehyst.models.model import Floats
from dehyst.models.plan import SPRING, evaluate, sweep

SMOOTH = 0.01  # weight of the second difference at 1 ms, times the squared slope dy/du
SWEEPS, REFINEMENTS = 150, 40
SETTLED = 1e-4  # relative gain of a round below which nothing more is tried
ARRIVED = 3.0  # times the noise: within this of the target the approach is over
EXACT_SAMPLES = 200_000  # longer trajectories are not refined


@dataclass(frozen=True)
class Inverted:
    """drive, predicted displacement, predicted reading: (N,); flags: (N,) int64 bits as in
    dehyst.models.compensator; mode: how the drive was made; rms: of the predicted error where no
    flag says that the target cannot be reached, once the approach is over; NaN: nowhere."""

    drive: Floats
    predicted: Floats
    reading: Floats
    flags: NDArray[np.int64]
    mode: str
    rms: float


@njit(cache=True, nogil=True)
def _exact(
    weights: Floats, c: Floats, u_offset: float, x: Floats, x_0: float, h: Floats, dt: float,
    target: Floats, error: Floats, row: NDArray[np.int64], col: NDArray[np.int64], value: Floats,
) -> int:  # fmt: skip
    """Error and exact Jacobian in triplets; h (n,) at x_0 is advanced. Returns the triplets."""
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


def _refine(comp: Compensator, x: Floats, start: CompensatorState, target: Floats) -> Floats:
    """Levenberg-Marquardt with the exact Jacobian, within drive range and rate.

    The second round weighs down what stayed far from the target (the approach from rest, targets
    beyond reach), so that it does not pull at the rest.
    """
    trust = np.ones(x.size)
    for _ in range(2):
        x, error = _round(comp, x, start, target, trust)
        trust = 1.0 / (1.0 + (error / (3.0 * comp.noise)) ** 2)
    return x


def _round(
    comp: Compensator, x: Floats, start: CompensatorState, target: Floats, trust: Floats
) -> tuple[Floats, Floats]:
    n = x.size
    dt = comp.period_s
    size = n * (comp.model.hysteresis.n + 2)
    row, col = np.empty(size, np.int64), np.empty(size, np.int64)
    value, error = np.empty(size), np.empty(n)
    bend = sp.diags_array([1.0, -2.0, 1.0], offsets=[0, 1, 2], shape=(n - 2, n)).tocsc()
    rough = SMOOTH * comp.slope**2 * (1e-3 / dt) ** 4 * (bend.T @ bend)
    x_0 = float(start.numbers[places.LAST])

    def at(drive: Floats) -> tuple[float, sp.csc_array]:
        h = start.plays[places.REAL].copy()
        count = _exact(
            comp.weights, comp.c, comp.model.hysteresis.u_offset, drive, x_0, h, dt, target,
            error, row, col, value,
        )  # fmt: skip
        jacobian = sp.csc_array((value[:count], (row[:count], col[:count])), shape=(n, n))
        return float(trust @ error**2 + drive @ (rough @ drive)), jacobian

    cost, jacobian = at(x)
    kept = error.copy()
    damping = 1e-3 * comp.slope**2
    stalled = 0
    for _ in range(REFINEMENTS):
        scaled = sp.diags_array(trust) @ jacobian
        normal = (jacobian.T @ scaled + rough + damping * sp.eye_array(n)).tocsc()
        step = spsolve(normal, scaled.T @ kept + rough @ x)
        if not np.all(np.isfinite(step)):
            break
        trial = _within(comp, x - step, x_0)
        new, there = at(trial)
        if new < cost:
            stalled = stalled + 1 if cost - new < SETTLED * cost else 0
            x, cost, jacobian, kept = trial, new, there, error.copy()
            damping *= 0.3
        else:
            stalled += 1
            damping *= 5.0
        if stalled >= 6 or cost < 1e-20 * n * comp.slope**2:
            break
    return x, kept


@njit(cache=True, nogil=True)
def _limit(x: Floats, x_0: float, low: float, high: float, travel: float) -> None:
    """Bring a drive into range and rate, in place."""
    now = x_0
    for j in range(x.size):
        now = min(max(x[j], now - travel, low), now + travel, high)
        x[j] = now


def _within(comp: Compensator, x: Floats, x_0: float) -> Floats:
    out = np.ascontiguousarray(x)
    _limit(out, x_0, comp.low, comp.high, comp.rate * comp.period_s)
    return out


def _swept(comp: Compensator, x: Floats, start: CompensatorState, target: Floats) -> Floats:
    """Gauss-Newton sweeps over the whole trajectory."""
    n, dt = x.size, comp.period_s
    trust = np.ones(n)
    smooth = np.full(n, SMOOTH * comp.slope**2 * (1e-3 / dt) ** 4)
    bounds = np.array([comp.low, comp.high, comp.rate * dt, SPRING * comp.slope**2])
    rows, bands = np.zeros((4, n)), np.zeros((4, n))
    x_0, h_0 = float(start.numbers[places.LAST]), start.plays[places.REAL]
    h = h_0.copy()

    def cost(drive: Floats) -> float:
        error, rough = evaluate(
            comp.weights, comp.c, comp.model.hysteresis.u_offset, drive, x_0, x_0, h_0, h, dt,
            0.5, target, trust, smooth, bounds, rows,
        )  # fmt: skip
        return error + rough

    best = cost(x)
    damping = comp.slope**2
    stalled = 0
    for _ in range(SWEEPS):
        sweep(x, x_0, x_0, trust, smooth, bounds, damping, rows, bands)
        trial = x - bands[3]
        new = cost(trial) if np.all(np.isfinite(trial)) else np.inf
        if new < best:
            stalled = stalled + 1 if best - new < SETTLED * best else 0
            x, best, damping = trial, new, max(0.3 * damping, 1e-9 * comp.slope**2)
        else:
            stalled += 1
            damping = min(4.0 * damping, 1e3 * comp.slope**2)
            cost(x)
        if stalled >= 12:
            break
    return _within(comp, x, x_0)


def _targets(
    comp: Compensator, start: CompensatorState, target: Floats, channels: Floats
) -> Floats:
    """Displacements of the hysteresis: delays shifted out, stage blocks undone."""
    late = comp.delay_s / comp.period_s
    at = np.arange(target.size)
    seq = np.interp(at + late, at, target) if late else target.copy()
    if comp.has_stage_blocks:
        led = np.concatenate([[seq[0]], seq])
        undo(
            comp.table, comp.params, start.blocks, start.blocks.copy(), channels, 1,
            comp.period_s, comp.period_s, led,
        )  # fmt: skip
        seq = led[1:]
    return np.ascontiguousarray(seq)


def _replayed(
    comp: Compensator, start: float, drive: Floats, target: Floats, channels: Floats
) -> tuple[Floats, Floats]:
    """What the model says of a drive: displacement and reading (N,)."""
    state = comp.init(start)
    y, reading = np.empty(drive.size), np.empty(drive.size)
    for i, u in enumerate(drive.tolist()):
        if state.channels.size:
            state.channels[:] = channels[i]
        comp.applied(state, u)
        y[i], reading[i] = state.result[compensate.PREDICTED], state.result[compensate.READING]
    return y, reading


def invert_streamed(
    comp: Compensator, target: Floats, channels: Floats | None = None, start: float | None = None
) -> Inverted:
    """Exactly what the daemon would do with this compensator: each sample sees
    `comp.window_samples` targets from its own on; the last one holds after the end. Arguments as
    for `invert_trajectory`."""
    target = np.ascontiguousarray(target, np.float64)
    n, width = target.size, comp.window_samples
    held = np.append(target, np.full(width, target[-1]))
    channels = np.zeros((n, len(comp.channels))) if channels is None else channels
    at = min(max(0.0, comp.low), comp.high) if start is None else start
    state = comp.init(at)
    drive, y, reading = np.empty(n), np.empty(n), np.empty(n)
    flags, modes = np.zeros(n, np.int64), np.zeros(4, np.int64)
    for i in range(n):
        comp.step(state, held[i : i + width], width, channels[i])
        drive[i] = state.result[compensate.DRIVE]
        flags[i] = int(state.result[compensate.FLAGS])
        modes[int(state.result[compensate.MODE])] += 1
        comp.applied(state, drive[i])
        y[i], reading[i] = state.result[compensate.PREDICTED], state.result[compensate.READING]
    mode = ("hold", "static", "causal", "preview")[int(np.argmax(modes))]
    return Inverted(drive, y, reading, flags, mode, _rms(y - target, flags, comp.noise))


def invert_trajectory(
    comp: Compensator, target: Floats, channels: Floats | None = None, start: float | None = None
) -> Inverted:
    """Drive (N,) for a whole trajectory (N,), sampled with the compensator's period.

    channels: (N, number of comp.channels) values of the model's further channels; start: drive at
    which the stage stands before the first sample, None: 0 or the end of the range next to it.
    """
    streamed = invert_streamed(comp, target, channels, start)
    if not comp.planned or target.size < 8:
        return streamed
    target = np.ascontiguousarray(target, np.float64)
    n = target.size
    channels = np.zeros((n, len(comp.channels))) if channels is None else channels
    at = min(max(0.0, comp.low), comp.high) if start is None else start
    state = comp.init(at)
    first = channels[0] if n else np.zeros(0)
    goal = _targets(comp, state, target, first)
    static, _ = comp.static.run(goal, state.plays[places.REAL], at)
    static = _within(comp, static, at)
    swept = _swept(comp, static.copy(), state, goal)
    drives = {"static": static, "sweeps": swept}
    if n <= EXACT_SAMPLES:
        drives["exact"] = _refine(comp, swept.copy(), state, goal)
        drives["exact from preview"] = _refine(comp, streamed.drive.copy(), state, goal)
    best = streamed
    unreachable = streamed.flags & (compensate.BEYOND_DRIVE | compensate.BEYOND_SATURATION)
    noise = float(comp.noise)
    least = _capped(best.predicted - target, noise)
    for name, inside in drives.items():
        drive = comp.command(inside, at)
        y, reading = _replayed(comp, at, drive, target, channels)
        rms = _rms(y - target, unreachable, noise)
        worth = _capped(y - target, noise)
        if worth < least:
            least = worth
            fast = np.abs(np.diff(drive, prepend=at)) >= comp.rate * comp.period_s * (1 - 1e-9)
            flags = unreachable | np.where(fast, compensate.SLEW, 0)
            flags |= np.where(comp.outside(drive, at), compensate.OUTSIDE, 0)
            best = Inverted(drive, y, reading, flags, name, rms)
    return best


def _capped(error: Floats, noise: float) -> float:
    """Mean square in which no sample counts more than a fifth of the noise: the approach from
    rest, which no drive can follow, must not decide."""
    return float(np.mean(np.minimum(error**2, (0.2 * noise) ** 2)))


def _rms(error: Floats, flags: NDArray[np.int64], noise: float) -> float:
    inside = (flags & (compensate.BEYOND_DRIVE | compensate.BEYOND_SATURATION)) == 0
    arrived = inside & (np.abs(error) <= ARRIVED * noise)
    if np.any(arrived):  # the approach from where the stage rests is no error of the inverse
        inside[: int(np.argmax(arrived))] = False
    return float(np.sqrt(np.mean(error[inside] ** 2))) if np.any(inside) else math.nan
