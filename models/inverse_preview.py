"""The rate-dependent inverse over a receding window of targets.

Once per node (the sampling period, or about 1 ms where the loop is faster) the plan of the sample
before is shifted, extended, improved by a fixed number of Gauss-Newton sweeps
(dehyst.models.plan) and its first node applied; between nodes the drive follows the cubic through
the plan. Work and memory per node are constant.

Where the plan's predicted error is above the noise, the static inverse is rolled out over the same
window, and replaces a plan that has lost its way. Whether the plan's drive is used at all is the
guard's to say (dehyst.models.inverse_guard). A hold ends where the stage rests as the static
inverse would let it rest.

All numbers that change live in arrays made once; nothing is allocated in the loop.
"""

import math

import numpy as np
from numba import njit

from dehyst.models import inverse_guard as guard
from dehyst.models.inverse_places import (
    BANDS,
    BEEN_HIGH,
    BEEN_LOW,
    BOUNDS,
    DAMPING,
    DUE,
    GAP,
    HIGH,
    HIGHEST,
    HOW,
    LAG,
    LAST,
    LOST,
    LOW,
    LOWEST,
    MEAN,
    MOVED,
    NODES,
    NOISE,
    PATIENCE,
    PEAK,
    PER_NODE,
    PERIOD,
    PHASE,
    PLAN,
    PROMISED,
    RATE,
    REAL,
    ROWS,
    SCRATCH,
    SHADOW,
    SHADOW_PLAYS,
    SLOPE,
    SLOPE_0,
    SLOPE_1,
    SMOOTHNESS,
    STATIC_LEFT,
    SUM_REAL,
    SUM_SHADOW,
    SUM_TIME,
    SWEEPS,
    TARGET,
    TARGET_NOW,
    TRIAL,
    TRUST,
    U_OFFSET,
    VALID,
    WORST,
    X_0,
    X_BEFORE,
    Y_FIRST,
    Y_LAST,
)
from dehyst.models.inverse_static import inverse_step
from dehyst.models.model import Floats
from dehyst.models.plan import SPRING, evaluate, move, sweep

NODE_S = 1e-3  # longest spacing of nodes for loops that are faster
SMOOTH = 0.7  # weight of the second difference at 1 ms nodes, times the squared slope dy/du
STIFF_END, STIFF_POWER = 400.0, 6  # smoothness grows by 1 + STIFF_END (j / P)^STIFF_POWER
MOST_DAMPING = 7.0  # times the squared slope
FORGET_WINDOWS = 20.0  # memory of the guard
STANDS = 4.0  # nodes for which a promise is taken to hold: it looks further ahead than that
WORTH = 0.03  # of the cost, or of the noise's: a sweep that gains less is the last
FIRST_SWEEPS = 8  # for a plan that starts from nothing


@njit(cache=True, nogil=True)
def _rollout(
    weights: Floats,
    c: Floats,
    knots: Floats,
    fixed: Floats,
    x_0: float,
    h: Floats,
    target: Floats,
    travel: float,
    out: Floats,
) -> None:
    """The static inverse along the window: drives into out (P,). h (n,) is advanced."""
    v = x_0
    for j in range(out.size):
        u, _ = inverse_step(
            weights[0], weights[3], c, knots, fixed[Y_FIRST], fixed[Y_LAST], fixed[U_OFFSET],
            fixed[LOW], fixed[HIGH], h, v, target[j],
        )  # fmt: skip
        v = min(max(u, v - travel), v + travel)
        out[j] = v
        move(weights, h, v - fixed[U_OFFSET])


@njit(cache=True, nogil=True)
def improve(
    weights: Floats, c: Floats, knots: Floats, fixed: Floats, state: Floats, plays: Floats,
    work: Floats,
) -> None:  # fmt: skip
    """One node's work: shift the plan, sweep, compare with the static inverse."""
    x, trial = work[PLAN], work[TRIAL]
    target, trust, smooth = work[TARGET], work[TRUST], work[SMOOTHNESS]
    rows, bands, bounds = work[ROWS : ROWS + 4], work[BANDS : BANDS + 4], work[BOUNDS]
    h_0, h = plays[REAL], plays[SCRATCH]
    n = x.size
    per_node = fixed[PER_NODE]
    period, half = fixed[PERIOD] * per_node, 0.5 / per_node
    travel = fixed[RATE] * period
    state[X_BEFORE] = state[X_0]
    state[X_0] = state[LAST]
    x_0, x_before = state[X_0], state[X_BEFORE]
    bounds[0], bounds[1], bounds[2] = fixed[LOW], fixed[HIGH], travel
    bounds[3] = SPRING * fixed[SLOPE] ** 2
    sweeps = int(fixed[SWEEPS])
    if state[VALID] == 0.0:
        sweeps = FIRST_SWEEPS
        state[X_BEFORE] = x_before = x_0
        x[:] = x_0
        state[DAMPING] = fixed[SLOPE] ** 2
        state[VALID] = 1.0
    else:
        for j in range(n - 1):
            x[j] = x[j + 1]
        if n > 2:
            x[n - 1] = 2.0 * x[n - 2] - x[n - 3]
    error, rough = evaluate(
        weights, c, fixed[U_OFFSET], x, x_0, x_before, h_0, h, period, half, target, trust,
        smooth, bounds, rows,
    )  # fmt: skip
    most = MOST_DAMPING * fixed[SLOPE] ** 2
    known = 0.0
    for j in range(n):
        known += trust[j]
    for attempt in range(sweeps):
        sweep(x, x_0, x_before, trust, smooth, bounds, state[DAMPING], rows, bands)
        for j in range(n):
            trial[j] = x[j] - bands[3, j]
            if not np.isfinite(trial[j]):
                trial[j] = x[j]
        new_error, new_rough = evaluate(
            weights, c, fixed[U_OFFSET], trial, x_0, x_before, h_0, h, period, half, target,
            trust, smooth, bounds, rows,
        )  # fmt: skip
        gain = error + rough - new_error - new_rough
        little = WORTH * min(error + rough, known * fixed[NOISE] ** 2)
        if gain > 0.0:
            x[:] = trial
            error, rough = new_error, new_rough
            state[DAMPING] = max(0.3 * state[DAMPING], 1e-9 * most)
        if abs(gain) < little:
            break  # the next one would gain no more
        if gain > 0.0:
            continue
        state[DAMPING] = min(4.0 * state[DAMPING], most)
        if attempt < sweeps - 1:
            evaluate(
                weights, c, fixed[U_OFFSET], x, x_0, x_before, h_0, h, period, half, target,
                trust, smooth, bounds, rows,
            )  # fmt: skip
    if not error <= known * fixed[NOISE] ** 2:
        h[:] = h_0
        _rollout(weights, c, knots, fixed, x_0, h, target, travel, trial)
        other, _ = evaluate(
            weights, c, fixed[U_OFFSET], trial, x_0, x_before, h_0, h, period, half, target,
            trust, smooth, bounds, rows,
        )  # fmt: skip
        if not error <= 2.0 * other:
            x[:] = trial
    after = x[1] if n > 1 else x[0]
    state[SLOPE_0] = 0.5 * (x[0] - x_before)
    state[SLOPE_1] = 0.5 * (after - x_0)
    state[NODES] += 1.0


@njit(cache=True, nogil=True)
def propose(
    weights: Floats, c: Floats, knots: Floats, fixed: Floats, state: Floats, plays: Floats,
    work: Floats, targets: Floats, late: float,
) -> tuple[float, bool]:  # fmt: skip
    """Drive for the present sample, before limits, and whether the static inverse made it.

    At phase 0 `work[TARGET]`, `work[TRUST]` hold the window and the plan is improved first.
    """
    per_node, last = fixed[PER_NODE], state[LAST]
    phase = state[PHASE]
    if phase == 0.0:
        improve(weights, c, knots, fixed, state, plays, work)
    u = work[PLAN, 0]
    if phase < per_node - 1.0:
        q = (phase + 1.0) / per_node
        u = guard.between(state[X_0], u, state[SLOPE_0], state[SLOPE_1], q)
    travel = fixed[RATE] * fixed[PERIOD]
    u = min(max(u, last - travel), last + travel)
    u = min(max(u, fixed[LOW]), fixed[HIGH])
    # The guard: what would the static inverse have done, and what will this drive do?
    window = work.shape[1] * per_node
    keep = 1.0 - 1.0 / (FORGET_WINDOWS * window)
    enough = work.shape[1] // guard.LOOKS  # known nodes for a promise
    whole = work[TRUST, enough] == 1.0
    furthest = work.shape[1] - 1
    if work[TRUST, furthest] != 1.0:
        furthest = enough
    newest = work[TARGET, furthest] if whole else state[TARGET_NOW]
    if state[SUM_TIME] == 0.0:
        state[BEEN_LOW], state[BEEN_HIGH] = last, last
        state[LOWEST], state[HIGHEST] = newest, newest
    state[LOWEST] = min(state[LOWEST], newest, state[TARGET_NOW])
    state[HIGHEST] = max(state[HIGHEST], newest, state[TARGET_NOW])
    if phase == 0.0 or not whole:
        state[LOST] = guard.missed(weights, c, fixed, state, plays[REAL], plays[SHADOW_PLAYS])
    share = guard.BUDGET if state[STATIC_LEFT] == 0.0 else guard.RETURN * guard.BUDGET
    if not whole:
        state[PROMISED], state[DUE] = 0.0, math.inf
    elif phase == 0.0:
        # A debt must be paid back when that was first promised: a plan that is made anew at each
        # node could put it off for ever. After a broken promise no other for a window.
        state[PROMISED] -= 1.0
        state[DUE] -= 1.0
        if state[DUE] < -work.shape[1] or guard.allowed(
            state[SUM_REAL], state[SUM_SHADOW], state[SUM_TIME], fixed, guard.BUDGET
        ):
            state[DUE] = math.inf
        surprising = False
        if state[PROMISED] > 0.0:  # of the plans before, that this one need not be like
            plays[SCRATCH] = plays[REAL]
            e = guard.error(weights, c, fixed, state, plays[SCRATCH], last, u)
            surprising = abs(e) > guard.SURPRISE * (state[WORST] + fixed[NOISE])
        if surprising or not state[PROMISED] > 0.0:
            state[PROMISED] = 0.0
            due = guard.promises(
                weights, c, knots, fixed, state, plays, work, share, targets, late, state[DUE]
            )
            if due > 0.0:
                state[PROMISED] = max(min(STANDS, work.shape[1] // guard.LOOKS), 1.0)
                if state[STATIC_LEFT] == 0.0:  # it is followed
                    state[DUE] = min(state[DUE], due)
    shadow = guard.static(
        weights, c, knots, fixed, plays[SHADOW_PLAYS], state[SHADOW], state[TARGET_NOW]
    )
    other = guard.error(weights, c, fixed, state, plays[SHADOW_PLAYS], state[SHADOW], shadow)
    moved = shadow - state[SHADOW]
    state[SHADOW] = shadow
    fade = 1.0 / (guard.WORST_LASTS * window)
    state[MEAN] += (abs(other) - state[MEAN]) / max(guard.KICK * window, 1.0)
    state[WORST] = max(state[MEAN], state[WORST] * (1.0 - fade))
    state[PEAK] = max(abs(other), state[PEAK] * (1.0 - fade))
    state[MOVED] += (moved * moved - state[MOVED]) * max(fade, 1.0 / (state[SUM_TIME] + 1.0))
    state[BEEN_LOW] = min(shadow, state[BEEN_LOW] + (shadow - state[BEEN_LOW]) * fade)
    state[BEEN_HIGH] = max(shadow, state[BEEN_HIGH] + (shadow - state[BEEN_HIGH]) * fade)
    state[SUM_SHADOW] = keep * state[SUM_SHADOW] + other * other
    state[SUM_TIME] = keep * state[SUM_TIME] + 1.0
    state[SUM_REAL] *= keep
    if whole:
        if state[PROMISED] == 0.0:
            if state[STATIC_LEFT] == 0.0:  # a promise was broken
                losing = state[SUM_REAL] > state[SUM_SHADOW]
                state[PATIENCE] = min(2.0 * state[PATIENCE], guard.LONGEST) if losing else 0.0
                state[PATIENCE] = max(state[PATIENCE], guard.DWELL)
            state[STATIC_LEFT] = math.ceil(state[PATIENCE] * window)
        elif state[STATIC_LEFT] > 0.0:
            state[STATIC_LEFT] -= 1.0
    if whole and state[STATIC_LEFT] == 0.0:
        state[HOW] = guard.BY_SHADOW
        return u, False
    home, how = guard.back(weights, c, knots, fixed, state, plays, moved)
    lag = guard.rate_lag(weights, c, fixed, plays[REAL], last)
    state[LAG] = max(lag, state[LAG] * (1.0 - fade))
    # The offset so far; it is given up at the rate term's lag, or it would be a kick.
    before = last + moved - home
    if how == guard.BY_ITSELF and state[HOW] == guard.BY_ITSELF:
        before = state[GAP]
    state[HOW] = how
    kept = before * lag / (1.0 + lag)
    plan, gap = u, kept
    if not whole:
        most = guard.leash(weights, c, fixed, state, plays, home, other, window)
        most = max(most, abs(kept))
        gap = min(max(plan - home, -most), most)
        change = max(most, abs(before)) / (1.0 + lag)
        gap = min(max(gap, before - change), before + change)
        plays[SCRATCH] = plays[REAL]
        e = guard.error(weights, c, fixed, state, plays[SCRATCH], last, home + gap)
        if guard.forgets(weights, c, fixed, state, plays, home + gap) or not guard.allowed(
            state[SUM_REAL] + e * e, state[SUM_SHADOW], state[SUM_TIME], fixed, guard.BUDGET
        ):
            gap = kept
        if home <= fixed[LOW] or home >= fixed[HIGH]:
            gap = kept  # the nearest that can be reached
    if gap == kept:
        gap = guard.returning(weights, c, fixed, state, plays, home, before, kept, abs(other))
    u = min(max(home + gap, last - travel), last + travel)
    u = min(max(u, fixed[LOW]), fixed[HIGH])
    state[GAP] = u - home
    return u, abs(gap) < 0.5 * abs(plan - home)


def smoothness(nodes: int, node_s: float, slope: float) -> Floats:
    """(P,) weights of the second differences of a plan."""
    base = SMOOTH * slope**2 * (1e-3 / node_s) ** 4
    at = np.arange(1, nodes + 1) / nodes
    return base * (1.0 + STIFF_END * at**STIFF_POWER)
