"""The rate-dependent inverse over a receding window of targets.

Once per node (the sampling period, or about 1 ms where the loop is faster) the plan of the sample
before is shifted, extended, improved by a fixed number of Gauss-Newton sweeps
(dehyst.models.plan) and its first node applied; between nodes the drive follows the cubic through
the plan. Work and memory per node are constant.

Two guards keep it from ever being worse than the static inverse:
- where the plan's predicted error is above the noise, the static inverse is rolled out over the
  same window, and replaces the plan where it is predicted to do better;
- a shadow model is driven by the static inverse all the time. Where the next sample, and the way
  back from it at the slew rate, would bring the squared error of the real drive, summed over some
  windows, above the shadow's by more than the noise allows, the static inverse takes over until
  the budget is back; the plan goes on meanwhile from where the stage is.

Taking over, the static inverse works on another memory than the shadow's. Where the weights are
not monotone it may be off by more there: `_back` then corrects it by the model's own static part.
A hold ends at the shadow's drive, where the stage rests at the last target: what comes meanwhile
is unknown, so nothing else can keep the promise.

All numbers that change live in arrays made once; nothing is allocated in the loop.
"""

import math

import numpy as np
from numba import njit

from dehyst.models.forward import polynomial
from dehyst.models.inverse_static import inverse_step
from dehyst.models.model import Floats
from dehyst.models.plan import SPRING, evaluate, move, sweep

NODE_S = 1e-3  # longest spacing of nodes for loops that are faster
SMOOTH = 0.7  # weight of the second difference at 1 ms nodes, times the squared slope dy/du
STIFF_END, STIFF_POWER = 400.0, 6  # smoothness grows by 1 + STIFF_END (j / P)^STIFF_POWER
MOST_DAMPING = 7.0  # times the squared slope
FORGET_WINDOWS = 20.0  # memory of the guard
BUDGET = 0.6  # part of the noise that the plan may be worse than the static inverse
GRACE = 0.25  # windows' worth of noise that the plan may lose at the start
CORRECTIONS = 6  # tried of the static inverse when it takes over
HOLD_SLIDE_S = 2e-3  # time constant of the way to where a hold rests
FIRST_SWEEPS = 8  # for a plan that starts from nothing

# Places in `fixed`.
(
    U_OFFSET, Y_FIRST, Y_LAST, LOW, HIGH, RATE, PERIOD, PER_NODE, NOISE, SLOPE, SWEEPS, N_FIXED,
) = range(12)  # fmt: skip
# Places in `state`.
(
    LAST, X_0, X_BEFORE, PHASE, DAMPING, SHADOW, SUM_REAL, SUM_SHADOW, SUM_TIME, STATIC_LEFT,
    STATIC_NEXT, SLOPE_0, SLOPE_1, VALID, NODES, TARGET_NOW, CREDIT, CREDIT_LEFT, GAIN, N_STATE,
) = range(20)  # fmt: skip
# Rows of `work` (N_WORK, P), P >= 4.
PLAN, TRIAL, TARGET, TRUST, SMOOTHNESS, ROWS, BANDS, BOUNDS, N_WORK = 0, 1, 2, 3, 4, 5, 9, 13, 14
# Rows of `plays` (N_PLAYS, n).
REAL, SHADOW_PLAYS, SCRATCH, N_PLAYS = range(4)


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
        if new_error + new_rough < error + rough:
            x[:] = trial
            error, rough = new_error, new_rough
            state[DAMPING] = max(0.3 * state[DAMPING], 1e-9 * most)
        else:
            state[DAMPING] = min(4.0 * state[DAMPING], most)
            if attempt < sweeps - 1:
                evaluate(
                    weights, c, fixed[U_OFFSET], x, x_0, x_before, h_0, h, period, half, target,
                    trust, smooth, bounds, rows,
                )  # fmt: skip
    known = 0.0
    for j in range(n):
        known += trust[j]
    state[GAIN] = 0.0
    strained = state[STATIC_LEFT] > 0.0 or state[CREDIT_LEFT] > 0.0
    if strained or not error <= known * fixed[NOISE] ** 2:
        h[:] = h_0
        _rollout(weights, c, knots, fixed, x_0, h, target, travel, trial)
        other, _ = evaluate(
            weights, c, fixed[U_OFFSET], trial, x_0, x_before, h_0, h, period, half, target,
            trust, smooth, bounds, rows,
        )  # fmt: skip
        if known > 0.99 * n:  # a continued future earns no credit
            state[GAIN] = (other - error) * per_node
        if not error <= 2.0 * other:
            x[:] = trial
            state[GAIN] = 0.0
    after = x[1] if n > 1 else x[0]
    state[SLOPE_0] = 0.5 * (x[0] - x_before)
    state[SLOPE_1] = 0.5 * (after - x_0)
    state[NODES] += 1.0


@njit(cache=True, nogil=True)
def _static(
    weights: Floats, c: Floats, knots: Floats, fixed: Floats, h: Floats, last: float, target: float
) -> float:  # fmt: skip
    u, _ = inverse_step(
        weights[0], weights[3], c, knots, fixed[Y_FIRST], fixed[Y_LAST], fixed[U_OFFSET],
        fixed[LOW], fixed[HIGH], h, last, target,
    )  # fmt: skip
    travel = fixed[RATE] * fixed[PERIOD]
    return min(max(u, last - travel), last + travel)


@njit(cache=True, nogil=True)
def _error(weights: Floats, c: Floats, fixed: Floats, state: Floats, h: Floats, last: float,
    u: float) -> float:  # fmt: skip
    """Error at the present target when the drive goes from `last` to u; advances h (n,)."""
    z, kh = move(weights, h, u - fixed[U_OFFSET])
    return polynomial(c, z + kh * (u - last) / fixed[PERIOD]) - state[TARGET_NOW]


@njit(cache=True, nogil=True)
def _back(
    weights: Floats, c: Floats, knots: Floats, fixed: Floats, state: Floats, plays: Floats,
    good: float,
) -> float:  # fmt: skip
    """The shadow's drive where it moves the stage as it moves the shadow, so that both become the
    same; otherwise the static inverse from where the stage is. Where its static error is above
    `good` by more than the noise (weights not monotone), the best of a few corrections close to
    it. Overwrites plays[SCRATCH]."""
    last, target = state[LAST], state[TARGET_NOW]
    travel = fixed[RATE] * fixed[PERIOD]
    plays[SCRATCH] = plays[SHADOW_PLAYS]
    z, _ = move(weights, plays[SCRATCH], state[SHADOW] - fixed[U_OFFSET])
    there = polynomial(c, z)
    plays[SCRATCH] = plays[REAL]
    z, _ = move(weights, plays[SCRATCH], state[SHADOW] - fixed[U_OFFSET])
    if abs(polynomial(c, z) - there) < 0.5 * BUDGET * fixed[NOISE]:
        return state[SHADOW]
    first = _static(weights, c, knots, fixed, plays[REAL], last, target)
    if abs(first - last) > 0.999 * travel:
        return first
    low, high = max(last - travel, fixed[LOW]), min(last + travel, fixed[HIGH])
    rising = 1.0 if fixed[Y_LAST] > fixed[Y_FIRST] else -1.0
    u, best, least = first, first, math.inf
    for attempt in range(CORRECTIONS):
        plays[SCRATCH] = plays[REAL]
        z, _ = move(weights, plays[SCRATCH], u - fixed[U_OFFSET])
        e = polynomial(c, z) - target
        if attempt == 0:
            if abs(e) <= good + BUDGET * fixed[NOISE] or not math.isfinite(e):
                return first
            near = 2.0 * abs(e) / fixed[SLOPE]
            low, high = max(low, first - near), min(high, first + near)
        if abs(e) < least:
            best, least = u, abs(e)
        u = min(max(u - rising * e / fixed[SLOPE], low), high)
    return best


@njit(cache=True, nogil=True)
def rest(fixed: Floats, state: Floats) -> float:
    """Drive of a hold: on the way to where the static inverse stood at the last target."""
    gap = state[SHADOW] - state[LAST]
    step = gap * (1.0 - math.exp(-fixed[PERIOD] / HOLD_SLIDE_S))
    if abs(gap) < 1e-5 * (fixed[HIGH] - fixed[LOW]):
        step = gap
    travel = fixed[RATE] * fixed[PERIOD]
    return state[LAST] + min(max(step, -travel), travel)


@njit(cache=True, nogil=True)
def propose(
    weights: Floats, c: Floats, knots: Floats, fixed: Floats, state: Floats, plays: Floats,
    work: Floats,
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
        p = 1.0 - q
        u *= q * q * (3.0 - 2.0 * q)
        u += state[X_0] * (1.0 + 2.0 * q) * p * p
        u += (state[SLOPE_0] * p - state[SLOPE_1] * q) * q * p
    travel = fixed[RATE] * fixed[PERIOD]
    u = min(max(u, last - travel), last + travel)
    u = min(max(u, fixed[LOW]), fixed[HIGH])
    # The guard: what would the static inverse have done, and what will this drive do?
    window = work.shape[1] * per_node
    keep = 1.0 - 1.0 / (FORGET_WINDOWS * window)
    shadow = _static(
        weights, c, knots, fixed, plays[SHADOW_PLAYS], state[SHADOW], state[TARGET_NOW]
    )
    other = _error(weights, c, fixed, state, plays[SHADOW_PLAYS], state[SHADOW], shadow)
    # Where even the static inverse cannot follow, a guess at what comes is not worth its way back.
    moved = shadow - state[SHADOW]
    torn = abs(moved) > 0.999 * travel and work[TRUST, work.shape[1] - 1] < 1.0
    state[SHADOW] = shadow
    state[SUM_SHADOW] = keep * state[SUM_SHADOW] + other * other
    state[SUM_TIME] = keep * state[SUM_TIME] + 1.0
    state[SUM_REAL] *= keep
    plays[SCRATCH] = plays[REAL]
    error = _error(weights, c, fixed, state, plays[SCRATCH], last, u)
    # The way back: so many samples of an error that shrinks to the shadow's.
    away, _ = inverse_step(
        weights[0], weights[3], c, knots, fixed[Y_FIRST], fixed[Y_LAST], fixed[U_OFFSET],
        fixed[LOW], fixed[HIGH], plays[SCRATCH], u, state[TARGET_NOW],
    )  # fmt: skip
    gap = min(abs(away - u), abs(shadow - u))
    off = fixed[SLOPE] * gap
    z, kh = move(weights, plays[SCRATCH], u - fixed[U_OFFSET])
    part = 1e-6 * (fixed[HIGH] - fixed[LOW])
    kick = polynomial(c, z + kh * part / fixed[PERIOD]) - polynomial(c, z)
    lag = abs(kick) / (part * fixed[SLOPE])  # of the rate term, in samples
    if not lag < 1e6:
        lag = 1e6
    way_back = lag * off * off
    if work[TRUST, work.shape[1] - 1] < 1.0:  # a continued future may turn out wrong
        way_back += lag * off * (off + abs(other))
    if gap > travel:
        way_back += gap / travel * (abs(other) * off + off * off / 3.0)
    noise, time, bad = BUDGET * fixed[NOISE], state[SUM_TIME], state[SUM_SHADOW]
    budget = noise * noise * (time + GRACE * window) + 2.0 * noise * math.sqrt(bad * time)
    if state[SUM_REAL] <= bad + budget:
        state[CREDIT] = state[CREDIT_LEFT] = 0.0
    elif state[CREDIT_LEFT] > 0.0:
        state[CREDIT_LEFT] -= 1.0
        if state[CREDIT_LEFT] == 0.0:
            state[CREDIT] = 0.0
    would = state[SUM_REAL] + error * error + way_back
    if state[STATIC_LEFT] > 0.0:
        state[STATIC_LEFT] -= 1.0
        if state[STATIC_LEFT] == 0.0:
            if would <= bad + 0.5 * budget + max(0.5 * state[GAIN], 0.0):
                state[CREDIT], state[CREDIT_LEFT] = max(0.5 * state[GAIN], 0.0), window
            else:
                state[STATIC_LEFT] = math.ceil(0.25 * window)
    elif not would <= bad + budget + state[CREDIT]:
        fresh = state[CREDIT_LEFT] == 0.0 and state[SUM_REAL] <= bad + budget
        if fresh and would <= bad + budget + 0.5 * state[GAIN]:
            state[CREDIT], state[CREDIT_LEFT] = 0.5 * state[GAIN], window
        else:
            state[STATIC_LEFT] = state[STATIC_NEXT]
            state[STATIC_NEXT] = min(2.0 * state[STATIC_NEXT], 64.0 * window)
    if torn:
        state[STATIC_LEFT] = max(state[STATIC_LEFT], math.ceil(0.25 * window))
    if state[STATIC_LEFT] > 0.0:
        # What is not the shadow's own movement takes the rate term's lag, or it would be a kick.
        back = _back(weights, c, knots, fixed, state, plays, abs(other))
        u = last + moved + (back - last - moved) / (1.0 + lag)
        u = min(max(u, last - travel), last + travel)
        return min(max(u, fixed[LOW]), fixed[HIGH]), True
    return u, False


def smoothness(nodes: int, node_s: float, slope: float) -> Floats:
    """(P,) weights of the second differences of a plan."""
    base = SMOOTH * slope**2 * (1e-3 / node_s) ** 4
    at = np.arange(1, nodes + 1) / nodes
    return base * (1.0 + STIFF_END * at**STIFF_POWER)
