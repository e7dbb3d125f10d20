"""The rate-dependent inverse over a receding window of targets.

Once per node (the sampling period, or about 1 ms where the loop is faster) the plan of the sample
before is shifted, extended, improved by a fixed number of Gauss-Newton sweeps
(dehyst.models.plan) and its first node applied; between nodes the drive follows the cubic through
the plan. Work and memory per node are constant.

Two guards keep it from ever being worse than the static inverse:
- where the plan's predicted error is above the noise, the static inverse is rolled out over the
  same window, and replaces the plan where it is predicted to do better;
- a shadow model is driven by the static inverse all the time. Where the error of the real drive,
  summed over some windows, exceeds the shadow's by more than the noise, the static inverse takes
  over for a while, with a doubled interval each time; the plan goes on and takes over again.

All numbers that change live in arrays made once; nothing is allocated in the loop.
"""

import numpy as np
from numba import njit

from dehyst.models.forward import polynomial
from dehyst.models.inverse_static import inverse_step
from dehyst.models.model import Floats
from dehyst.models.plan import evaluate, limit, move, sweep

NODE_S = 1e-3  # longest spacing of nodes for loops that are faster
SMOOTH = 0.7  # weight of the second difference at 1 ms nodes, times the squared slope dy/du
STIFF_END, STIFF_POWER = 100.0, 6  # smoothness grows by 1 + STIFF_END (j / P)^STIFF_POWER
MOST_DAMPING = 7.0  # times the squared slope
FORGET_WINDOWS = 20.0  # memory of the guard

# Places in `fixed`.
(
    U_OFFSET, Y_FIRST, Y_LAST, LOW, HIGH, RATE, PERIOD, PER_NODE, NOISE, SLOPE, SWEEPS, N_FIXED,
) = range(12)  # fmt: skip
# Places in `state`.
(
    LAST, X_0, X_BEFORE, PHASE, DAMPING, SHADOW, SUM_REAL, SUM_SHADOW, SUM_TIME, STATIC_LEFT,
    STATIC_NEXT, SLOPE_0, SLOPE_1, VALID, NODES, TARGET_NOW, N_STATE,
) = range(17)  # fmt: skip
# Rows of `work` (N_WORK, P).
PLAN, TRIAL, TARGET, TRUST, SMOOTHNESS, ROWS, BANDS, N_WORK = 0, 1, 2, 3, 4, 5, 9, 13
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
    rows, bands = work[ROWS : ROWS + 4], work[BANDS : BANDS + 4]
    h_0, h = plays[REAL], plays[SCRATCH]
    n = x.size
    per_node = fixed[PER_NODE]
    period, half = fixed[PERIOD] * per_node, 0.5 / per_node
    travel = fixed[RATE] * period
    state[X_BEFORE] = state[X_0]
    state[X_0] = state[LAST]
    x_0, x_before = state[X_0], state[X_BEFORE]
    if state[VALID] == 0.0:
        state[X_BEFORE] = x_before = x_0
        x[:] = x_0
        state[DAMPING] = fixed[SLOPE] ** 2
        state[SUM_REAL] = state[SUM_SHADOW] = state[SUM_TIME] = 0.0
        state[VALID] = 1.0
    else:
        for j in range(n - 1):
            x[j] = x[j + 1]
        if n > 2:
            x[n - 1] = 2.0 * x[n - 2] - x[n - 3]
    limit(x, x_0, fixed[LOW], fixed[HIGH], travel)
    error, rough = evaluate(
        weights, c, fixed[U_OFFSET], x, x_0, x_before, h_0, h, period, half, target, trust,
        smooth, rows,
    )  # fmt: skip
    sweeps = int(fixed[SWEEPS])
    most = MOST_DAMPING * fixed[SLOPE] ** 2
    for attempt in range(sweeps):
        sweep(x, x_0, x_before, trust, smooth, state[DAMPING], rows, bands)
        for j in range(n):
            trial[j] = x[j] - bands[3, j]
            if not np.isfinite(trial[j]):
                trial[j] = x[j]
        limit(trial, x_0, fixed[LOW], fixed[HIGH], travel)
        new_error, new_rough = evaluate(
            weights, c, fixed[U_OFFSET], trial, x_0, x_before, h_0, h, period, half, target,
            trust, smooth, rows,
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
                    trust, smooth, rows,
                )  # fmt: skip
    known = 0.0
    for j in range(n):
        known += trust[j]
    if not error <= known * fixed[NOISE] ** 2:
        h[:] = h_0
        _rollout(weights, c, knots, fixed, x_0, h, target, travel, trial)
        other, _ = evaluate(
            weights, c, fixed[U_OFFSET], trial, x_0, x_before, h_0, h, period, half, target,
            trust, smooth, rows,
        )  # fmt: skip
        if not error <= 1.5 * other:
            x[:] = trial
    after = x[1] if n > 1 else x[0]
    state[SLOPE_0] = 0.5 * (x[0] - x_before)
    state[SLOPE_1] = 0.5 * (after - x_0)
    state[NODES] += 1.0


@njit(cache=True, nogil=True)
def propose(
    weights: Floats, c: Floats, knots: Floats, fixed: Floats, state: Floats, plays: Floats,
    work: Floats,
) -> tuple[float, bool]:  # fmt: skip
    """Drive for the present sample, before limits, and whether the static inverse made it.

    At phase 0 `work[TARGET]`, `work[TRUST]` hold the window and the plan is improved first.
    """
    per_node = fixed[PER_NODE]
    phase = state[PHASE]
    if phase == 0.0:
        improve(weights, c, knots, fixed, state, plays, work)
    if state[STATIC_LEFT] > 0.0:
        u, _ = inverse_step(
            weights[0], weights[3], c, knots, fixed[Y_FIRST], fixed[Y_LAST], fixed[U_OFFSET],
            fixed[LOW], fixed[HIGH], plays[REAL], state[LAST], state[TARGET_NOW],
        )  # fmt: skip
        return u, True
    x_1 = work[PLAN, 0]
    if phase == per_node - 1.0:
        return x_1, False
    q = (phase + 1.0) / per_node
    p = 1.0 - q
    return (
        state[X_0] * (1.0 + 2.0 * q) * p * p
        + state[SLOPE_0] * q * p * p
        + x_1 * q * q * (3.0 - 2.0 * q)
        - state[SLOPE_1] * q * q * p
    ), False


@njit(cache=True, nogil=True)
def watch(
    weights: Floats, c: Floats, knots: Floats, fixed: Floats, state: Floats, plays: Floats,
    window: float, error: float, static_made: bool,
) -> None:  # fmt: skip
    """The second guard, once a sample: drive the shadow, compare, hand over to the static inverse.

    window: samples in the window; error: of the real drive at the present target.
    """
    u, _ = inverse_step(
        weights[0], weights[3], c, knots, fixed[Y_FIRST], fixed[Y_LAST], fixed[U_OFFSET],
        fixed[LOW], fixed[HIGH], plays[SHADOW_PLAYS], state[SHADOW], state[TARGET_NOW],
    )  # fmt: skip
    travel = fixed[RATE] * fixed[PERIOD]
    u = min(max(u, state[SHADOW] - travel), state[SHADOW] + travel)
    z, kh = move(weights, plays[SHADOW_PLAYS], u - fixed[U_OFFSET])
    other = polynomial(c, z + kh * (u - state[SHADOW]) / fixed[PERIOD]) - state[TARGET_NOW]
    state[SHADOW] = u
    forget = 1.0 / (FORGET_WINDOWS * window)
    keep = 1.0 - forget
    noise = fixed[NOISE] ** 2
    state[SUM_REAL] = keep * state[SUM_REAL] + error * error
    state[SUM_SHADOW] = keep * state[SUM_SHADOW] + other * other
    state[SUM_TIME] = keep * state[SUM_TIME] + 1.0
    if static_made:
        state[STATIC_LEFT] -= 1.0
    elif state[SUM_TIME] > window and (
        state[SUM_REAL] > state[SUM_SHADOW] + noise * (state[SUM_TIME] + window)
    ):
        state[STATIC_LEFT] = state[STATIC_NEXT]
        state[STATIC_NEXT] = min(2.0 * state[STATIC_NEXT], 64.0 * window)
        state[SUM_REAL] = state[SUM_SHADOW] = state[SUM_TIME] = 0.0


def smoothness(nodes: int, node_s: float, slope: float) -> Floats:
    """(P,) weights of the second differences of a plan."""
    base = SMOOTH * slope**2 * (1e-3 / node_s) ** 4
    at = np.arange(1, nodes + 1) / nodes
    return base * (1.0 + STIFF_END * at**STIFF_POWER)
