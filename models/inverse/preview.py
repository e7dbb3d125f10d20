"""The rate-dependent inverse over a receding window of targets.

Once per node (the sampling period, or about 1 ms where the loop is faster) the previous node's plan
is shifted, extended, improved by a fixed number of Gauss-Newton sweeps
(dehyst.models.inverse.window) and compared with the static inverse
(dehyst.models.inverse.fallback), and its first node is applied; between nodes the drive follows the
cubic through the plan. Work and memory per node are constant; nothing is allocated in the loop.
"""

import math

import numpy as np
from numba import njit

from dehyst.models.hysteresis.operators import move
from dehyst.models.inverse import fallback
from dehyst.models.inverse.state import Inverse
from dehyst.models.inverse.static import inverse_step
from dehyst.models.inverse.tuning import TUNING
from dehyst.models.inverse.window import between, evaluate, gauss_newton_step
from dehyst.models.model import Floats


@njit(cache=True, nogil=True)
def _begin(inv: Inverse) -> int:
    """Shift the plan by one node, or begin a plan; return the number of sweeps for it."""
    setting, state, limits = inv.setting[0], inv.state[0], inv.static.limits[0]
    x, frame = inv.plan, inv.nodes.frame[0]
    n = x.size
    state.x_before, state.x_0 = state.x_0, state.last
    sweeps = TUNING.sweeps
    if state.begun == 0:
        sweeps = TUNING.first_sweeps
        state.x_before = state.x_0
        x[:] = state.x_0
        state.damping = setting.slope**2
        state.begun = 1
    else:
        for j in range(n - 1):
            x[j] = x[j + 1]
        if n > 2:
            x[n - 1] = 2.0 * x[n - 2] - x[n - 3]
    frame.x_0, frame.x_before = state.x_0, state.x_before
    frame.period, frame.half = setting.period * setting.per_node, 0.5 / setting.per_node
    frame.low, frame.high, frame.travel = limits.low, limits.high, setting.rate * frame.period
    frame.spring = TUNING.spring * setting.slope**2
    return sweeps


@njit(cache=True, nogil=True)
def _static_nodes(inv: Inverse) -> None:
    """Compute the static inverse from node to node into `inv.trial`."""
    h, v, travel = inv.ahead_plays, inv.state[0].x_0, inv.nodes.frame[0].travel
    h[:] = inv.plays
    for j in range(inv.trial.size):
        u, _ = inverse_step(inv.static, h, v, inv.nodes.target[j])
        v = min(max(u, v - travel), v + travel)
        inv.trial[j] = v
        move(inv.hysteresis.weights, h, v - inv.hysteresis.u_offset[0])


@njit(cache=True, nogil=True)
def improve(inv: Inverse) -> float:
    """Do one node's work: shift the plan and sweep. A plan that is much worse than the static
    inverse is replaced by it. Return the plan's squared error at the nodes."""
    setting, state, nodes = inv.setting[0], inv.state[0], inv.nodes
    x, trial, h_0, h = inv.plan, inv.trial, inv.plays, inv.ahead_plays
    sweeps = _begin(inv)
    error, rough = evaluate(inv.hysteresis, nodes, x, h_0, h)
    most = TUNING.most_damping * setting.slope**2
    known = 0.0
    for j in range(x.size):
        known += nodes.trust[j]
    for attempt in range(sweeps):
        gauss_newton_step(nodes, x, state.damping)
        for j in range(x.size):
            trial[j] = x[j] - nodes.bands[3, j]
            if not np.isfinite(trial[j]):
                trial[j] = x[j]
        new_error, new_rough = evaluate(inv.hysteresis, nodes, trial, h_0, h)
        gain = error + rough - new_error - new_rough
        little = TUNING.worth * min(error + rough, known * setting.noise**2)
        if gain > 0.0:
            x[:] = trial
            error, rough = new_error, new_rough
            state.damping = max(0.3 * state.damping, 1e-9 * most)
        if abs(gain) < little:
            break  # the next sweep would not gain more
        if gain > 0.0:
            continue
        state.damping = min(4.0 * state.damping, most)
        if attempt < sweeps - 1:
            evaluate(inv.hysteresis, nodes, x, h_0, h)
    if error > known * setting.noise**2:
        _static_nodes(inv)
        other, _ = evaluate(inv.hysteresis, nodes, trial, h_0, h)
        if not error <= TUNING.lost * other:
            x[:] = trial
            error = other
    return error


@njit(cache=True, nogil=True)
def propose(inv: Inverse, guarded: bool) -> float:
    """Return the drive at the hysteresis for the present sample. At phase 0 `inv.nodes` holds the
    window, and the plan is improved first. guarded: the static inverse replaces a worse plan."""
    setting, state, x = inv.setting[0], inv.state[0], inv.plan
    if state.phase == 0:
        error = improve(inv)
        after = x[1] if x.size > 1 else x[0]
        state.slope_0 = 0.5 * (x[0] - state.x_before)
        state.slope_1 = 0.5 * (after - state.x_0)
        if guarded:
            fallback.choose_drive(inv, error)
        else:
            state.followed = 1
    if state.followed == 0:
        return fallback.approach(inv, state.target)
    q = (state.phase + 1.0) / setting.per_node
    u = between(state.x_0, x[0], state.slope_0, state.slope_1, q)
    return fallback.limited(inv, u, state.last, 1)


@njit(cache=True, nogil=True)
def speed(inv: Inverse) -> float:
    """Return the rate of the plan's drive at the present sample."""
    setting, state = inv.setting[0], inv.state[0]
    q = (state.phase + 1.0) / setting.per_node
    rise = 6.0 * q * (1.0 - q) * (inv.plan[0] - state.x_0)
    bent = (1.0 - q) * (1.0 - 3.0 * q) * state.slope_0
    node_s = setting.period * setting.per_node
    return (rise + bent + q * (3.0 * q - 2.0) * state.slope_1) / node_s


def smoothness(nodes: int, node_s: float, slope: float) -> Floats:
    """Return (P,) weights of a plan's second differences; stiff at the end as terminal cost."""
    base = TUNING.smooth * slope**2 * max((1e-3 / node_s) ** 4, TUNING.least_smooth)
    at = np.arange(1, nodes + 1) / nodes
    return base * (1.0 + TUNING.stiff_end * at**TUNING.stiff_power)


def nodes_of(seconds: float, period_s: float) -> tuple[int, int]:
    """Return the number of nodes of a window, and the number of samples per node."""
    per_node = max(1, round(TUNING.node_s / period_s))
    return min(max(4, math.floor(seconds / (per_node * period_s) + 0.5)), 2000), per_node
