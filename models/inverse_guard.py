"""What keeps the preview and causal inverse from ever being worse than the static inverse.

A shadow model is driven by the static inverse all the time; the squared errors of both are summed
over some windows. What the plan may cost is what keeps

    real + the way back <= (sqrt(shadow) + noise)^2

noise being BUDGET times the noise's norm over the same time. With a whole window of known targets
both paths are run ahead sample by sample (`promises`): a plan may then lose for a while what it
gains within the window, and must have gained it by the time that was first promised; otherwise the
static inverse takes over. Without them the drive is on a `leash`: it may be as far from where the
static inverse would have it (`back`) as the way back can be paid for, should it begin now. So the
plan gains a little at first, and with what it has gained it may go further.

The way back is what it may cost to become the static inverse again: the offset taken back at the
rate term's lag, or at what the slew rate leaves, an error at rest that lasts, and memory that will
not be wiped out (`forgets`, `missed`). Where the weights are so far from monotone that the nearest
monotone model is off by more than the noise, it cannot be told, and the leash has no length.

The bound is exact for the targets in the window and for what the model predicts. Beyond the window
the cost of the way back is an estimate: targets can be made that exceed it.
"""

import math

from numba import njit

from dehyst.models.forward import polynomial
from dehyst.models.inverse_places import (
    AHEAD,
    BEEN_HIGH,
    BEEN_LOW,
    GAP,
    HIGH,
    HIGHEST,
    LAG,
    LAST,
    LATER,
    LOST,
    LOW,
    LOWEST,
    MOVED,
    NOISE,
    PEAK,
    PER_NODE,
    PERIOD,
    PLAN,
    PRICE,
    RATE,
    REAL,
    SCRATCH,
    SHADOW,
    SHADOW_LATER,
    SHADOW_PLAYS,
    SLOPE,
    SLOPE_0,
    SUM_REAL,
    SUM_SHADOW,
    SUM_TIME,
    TARGET,
    TARGET_NOW,
    TRUST,
    U_OFFSET,
    WORST,
    X_0,
    Y_FIRST,
    Y_LAST,
)
from dehyst.models.inverse_static import inverse_step
from dehyst.models.model import Floats
from dehyst.models.plan import move

BUDGET = 0.5  # part of the noise that the plan may be worse than the static inverse
RETURN = 0.5  # part of that budget within which the plan comes back
END_SHARE = 0.25  # of the time that targets may be beyond the reach
LOSABLE = 0.3  # part of the noise that this may cost
LEAST_CLOSING = 0.05  # of the slew rate, by which the way back closes at least
ABSURD = 0.5  # of the stroke: static errors beyond which the saturation is not known
AT_SLEW = 0.9  # of the slew rate, rms: the static inverse drives at it nearly all the time
TYPICALLY = 1.5  # times the rms of the static inverse's steps are taken to be gone
RETURNS = (1.0, 0.75, 0.5, 0.25, 0.0)  # of the offset that the rate term's lag leaves
GENTLE, HALVES = 3.0, 6  # a return that kicks by more than so many offsets takes half the step
LOOKS = 4  # places along the plan at which the way back may be counted
LOSABLE_MEMORY = 0.5  # part of the noise
RARE = 0.1  # part of the range that the static inverse has driven in, at either end
KICK = 0.05  # windows: a shorter error of the static inverse counts less
WORST_LASTS = 5.0  # windows: memory of the static inverse's worst error and of its speed
DWELL, LONGEST = 0.1, 12.8  # windows that the static inverse stays: doubles while it loses
OUTWARD, HALVINGS = 12, 20  # steps of the search for a drive at rest
SURPRISE = 2.0  # times the static inverse's worst error of late
PAST = 2.0  # offsets further on, where the memory of the small operators is compared
AT_REST = 0.05  # of the noise: near enough to stand still
BY_SHADOW, BY_ITSELF, BY_REST = 0.0, 1.0, 2.0  # how `back` found the static inverse's drive
HOLD_SLIDE_S = 2e-3  # time constant of the way to where a hold rests


@njit(cache=True, nogil=True)
def way_back(
    weights: Floats, c: Floats, knots: Floats, fixed: Floats, state: Floats, h: Floats, u: float,
    hs: Floats, shadow: float, moved: float, other: float, target: float, window: float,
) -> float:  # fmt: skip
    """Squared error that it may cost to go back to the static inverse from u with the plays h (n,).

    hs (n,), shadow: plays and drive of the static path; moved, other: its last step and error.
    """
    away, _ = inverse_step(
        weights[0], weights[3], c, knots, fixed[Y_FIRST], fixed[Y_LAST], fixed[U_OFFSET],
        fixed[LOW], fixed[HIGH], h, u, target,
    )  # fmt: skip
    gap = abs(away - u)
    off = fixed[SLOPE] * gap
    cost = rate_lag(weights, c, fixed, h, u) * off * (off + 2.0 * abs(other))
    travel = fixed[RATE] * fixed[PERIOD]
    closing = max(travel - abs(moved), LEAST_CLOSING * travel)
    if gap > closing:
        cost += gap / closing * (abs(other) * off + off * off / 3.0)
    e = polynomial(c, still(weights, h, away - fixed[U_OFFSET])) - target
    rest = polynomial(c, still(weights, hs, shadow - fixed[U_OFFSET])) - target
    cost += window * max(e * e - rest * rest, 0.0)
    # What targets beyond the reach are missed by more than by the static path lasts for good.
    lost = missed(weights, c, fixed, state, h, hs)
    if lost > state[LOST] and not allowed(
        state[SUM_SHADOW] + END_SHARE * state[SUM_TIME] * lost, state[SUM_SHADOW],
        state[SUM_TIME], fixed, LOSABLE,
    ):  # fmt: skip
        return math.inf
    return cost


@njit(cache=True, nogil=True)
def leash(
    weights: Floats, c: Floats, fixed: Floats, state: Floats, plays: Floats, home: float,
    other: float, window: float,
) -> float:  # fmt: skip
    """How far the drive may be from `home`, where the static inverse would have it from here.

    The way back from an offset d of the displacement costs up to 2 d at first, dying out with the
    rate term's largest lag of late, on top of an error as large as the static inverse's worst one
    of late; where a jump takes several samples at what its motion leaves of the slew rate, it comes
    later, too. other: the static error now.
    """
    lag, worst = state[LAG], max(state[WORST], abs(other))
    travel, span = fixed[RATE] * fixed[PERIOD], fixed[HIGH] - fixed[LOW]
    closing = travel - TYPICALLY * math.sqrt(state[MOVED])
    if (
        fixed[PRICE] > fixed[NOISE]
        or state[PEAK] > ABSURD * fixed[SLOPE] * span
        or closing < LEAST_CLOSING * travel
    ):
        return 0.0  # the way back cannot be told
    e = polynomial(c, still(weights, plays[REAL], home - fixed[U_OFFSET])) - state[TARGET_NOW]
    v = state[SHADOW] - fixed[U_OFFSET]
    rest = polynomial(c, still(weights, plays[SHADOW_PLAYS], v)) - state[TARGET_NOW]
    noise = RETURN * BUDGET * fixed[NOISE]
    budget = (math.sqrt(state[SUM_SHADOW]) + noise * math.sqrt(state[SUM_TIME])) ** 2
    budget -= state[SUM_REAL] + other * other + window * max(e * e - rest * rest, 0.0)
    if not budget > 0.0:
        return 0.0
    late = worst / (fixed[SLOPE] * closing) if closing < span else 0.0
    square, linear = 2.0 * lag + late, worst * (4.0 * lag + late)
    if not square > 0.0:
        return span
    d = (math.sqrt(linear * linear + 4.0 * square * budget) - linear) / (2.0 * square)
    return d / fixed[SLOPE]


@njit(cache=True, nogil=True)
def forgets(
    weights: Floats, c: Floats, fixed: Floats, state: Floats, plays: Floats, u: float
) -> bool:  # fmt: skip
    """Whether the drive u would leave memory that the shadow does not have, that may never be
    wiped out, and that costs more than a part of the noise: an end of the range at which the
    displacement goes less far, or a rate term that is larger."""
    h, hs = plays[SCRATCH], plays[SHADOW_PLAYS]
    h[:] = plays[REAL]
    move(weights, h, u - fixed[U_OFFSET])
    rising = fixed[Y_LAST] > fixed[Y_FIRST]
    for upper in (False, True):
        end = (fixed[HIGH] if upper else fixed[LOW]) - fixed[U_OFFSET]
        less = polynomial(c, still(weights, hs, end)) - polynomial(c, still(weights, h, end))
        if (less if upper == rising else -less) > LOSABLE_MEMORY * fixed[NOISE]:
            return True
    return remembered(weights, c, fixed, state, plays, h, hs) > LOSABLE_MEMORY * fixed[NOISE]


@njit(cache=True, nogil=True)
def remembered(
    weights: Floats, c: Floats, fixed: Floats, state: Floats, plays: Floats, h: Floats, hs: Floats
) -> float:  # fmt: skip
    """Error that plays h (n,) add to that with hs (n,) by a larger rate term, at the typical speed.

    What the static inverse's motion of late would wipe out is left out, but for its rarest
    extremes."""
    rare = RARE * (state[BEEN_HIGH] - state[BEEN_LOW])
    low, high = state[BEEN_LOW] + rare, state[BEEN_HIGH] - rare
    later, other = plays[LATER], plays[SHADOW_LATER]
    later[:], other[:] = h, hs
    for end in (low, high):
        move(weights, later, end - fixed[U_OFFSET])
        move(weights, other, end - fixed[U_OFFSET])
    more = 0.0
    for u in (high, state[SHADOW], low):
        here = rate_lag(weights, c, fixed, later, u) - rate_lag(weights, c, fixed, other, u)
        more = max(more, here)
    return more * fixed[SLOPE] * math.sqrt(state[MOVED])


@njit(cache=True, nogil=True)
def missed(
    weights: Floats, c: Floats, fixed: Floats, state: Floats, h: Floats, hs: Floats
) -> float:  # fmt: skip
    """By how much more the lowest and highest target so far are out of reach with the plays h
    than with hs: the larger difference of the squares."""
    worst = 0.0
    rising = fixed[Y_LAST] > fixed[Y_FIRST]
    for upper in (False, True):
        end = (fixed[HIGH] if upper == rising else fixed[LOW]) - fixed[U_OFFSET]
        target = state[HIGHEST] if upper else state[LOWEST]
        sign = 1.0 if upper else -1.0
        real = max(sign * (target - polynomial(c, still(weights, h, end))), 0.0)
        other = max(sign * (target - polynomial(c, still(weights, hs, end))), 0.0)
        worst = max(worst, real * real - other * other)
    return worst


@njit(cache=True, nogil=True)
def still(weights: Floats, h: Floats, v: float) -> float:
    """sum b H at the input v, from plays h (n,) that are left as they are."""
    z = 0.0
    for i in range(h.size):
        z += weights[1, i] * max(v - weights[0, i], min(v + weights[0, i], h[i]))
    return z


@njit(cache=True, nogil=True)
def rate_lag(weights: Floats, c: Floats, fixed: Floats, h: Floats, u: float) -> float:
    """The rate term's lag at u, in samples; plays h (n,) are left as they are."""
    z, kh = 0.0, 0.0
    for i in range(h.size):
        x = max(u - fixed[U_OFFSET] - weights[0, i], min(u - fixed[U_OFFSET] + weights[0, i], h[i]))
        z += weights[1, i] * x
        kh += weights[2, i] * x
    part = 1e-6 * (fixed[HIGH] - fixed[LOW])
    kick = polynomial(c, z + kh * part / fixed[PERIOD]) - polynomial(c, z)
    lag = abs(kick) / (part * fixed[SLOPE])
    return lag if lag < 1e6 else 1e6


@njit(cache=True, nogil=True)
def between(a: float, b: float, slope_a: float, slope_b: float, q: float) -> float:
    """The cubic from a to b with these slopes, at 0 < q <= 1."""
    p = 1.0 - q
    return (
        b * q * q * (3.0 - 2.0 * q)
        + a * (1.0 + 2.0 * q) * p * p
        + (slope_a * p - slope_b * q) * q * p
    )


@njit(cache=True, nogil=True)
def allowed(real: float, other: float, time: float, fixed: Floats, share: float) -> bool:
    """Whether squared errors summing up to `real` are worse than `other` by less than the noise."""
    noise = share * fixed[NOISE]
    return real <= other + noise * noise * time + 2.0 * noise * math.sqrt(other * time)


@njit(cache=True, nogil=True)
def _line(window: Floats, at: float) -> float:
    """Target at any position in the window."""
    i = min(int(at + 1e-9), window.size - 1)
    q = at - i
    if q < 1e-6 or i + 1 >= window.size:
        return window[i]
    return window[i] + q * (window[i + 1] - window[i])


@njit(cache=True, nogil=True)
def promises(
    weights: Floats, c: Floats, knots: Floats, fixed: Floats, state: Floats, plays: Floats,
    work: Floats, share: float, window: Floats, late: float, due: float,
) -> float:  # fmt: skip
    """After how many nodes of the plan, `due` at most, it will be within the budget, the way back
    from there to the static inverse included; 0: never. window, late: targets from the present
    sample on, and where in them the drive of that sample acts."""
    x, target = work[PLAN], work[TARGET]
    h, hs = plays[SCRATCH], plays[AHEAD]
    h[:], hs[:] = plays[REAL], plays[SHADOW_PLAYS]
    n = x.size
    per_node, period = fixed[PER_NODE], fixed[PERIOD]
    travel = fixed[RATE] * period
    u, v, real, other = state[LAST], state[SHADOW], state[SUM_REAL], state[SUM_SHADOW]
    x_0, slope_0, e, y, moved, steps = state[X_0], state[SLOPE_0], 0.0, 0.0, 0.0, 0.0
    at = late
    undone = target[0] - _line(window, at + per_node - 1.0)
    look = max(n // LOOKS, 1)
    for j in range(n):
        slope_1 = 0.5 * ((x[j + 1] if j < n - 1 else x[j]) - x_0)
        undone_0, undone = undone, target[j] - _line(window, at + per_node - 1.0)
        for i in range(int(per_node)):
            q = (i + 1.0) / per_node
            y = _line(window, at) + undone_0 + q * (undone - undone_0)
            before = u
            u = between(x_0, x[j], slope_0, slope_1, q)
            u = min(max(u, before - travel, fixed[LOW]), before + travel, fixed[HIGH])
            z, kh = move(weights, h, u - fixed[U_OFFSET])
            e = polynomial(c, z + kh * (u - before) / period) - y
            real += e * e
            before = v
            v, _ = inverse_step(
                weights[0], weights[3], c, knots, fixed[Y_FIRST], fixed[Y_LAST], fixed[U_OFFSET],
                fixed[LOW], fixed[HIGH], hs, before, y,
            )  # fmt: skip
            v = min(max(v, before - travel), before + travel)
            moved = v - before
            steps += moved * moved
            z, kh = move(weights, hs, v - fixed[U_OFFSET])
            e = polynomial(c, z + kh * moved / period) - y
            other += e * e
            at += 1.0
        x_0, slope_0 = x[j], slope_1
        if j + 1.0 > due or work[TRUST, j] != 1.0:
            break
        if (j + 1) % look == 0 or j + 1.0 == due:
            back = way_back(weights, c, knots, fixed, state, h, u, hs, v, moved, e, y, n * per_node)
            ahead = (j + 1.0) * per_node
            past = min(state[SUM_TIME], WORST_LASTS * n * per_node)
            at_slew = past * state[MOVED] + steps > (past + ahead) * (AT_SLEW * travel) ** 2
            if not at_slew and allowed(real + back, other, state[SUM_TIME] + ahead, fixed, share):
                return j + 1.0
    return 0.0


@njit(cache=True, nogil=True)
def static(
    weights: Floats, c: Floats, knots: Floats, fixed: Floats, h: Floats, last: float, target: float
) -> float:  # fmt: skip
    u, _ = inverse_step(
        weights[0], weights[3], c, knots, fixed[Y_FIRST], fixed[Y_LAST], fixed[U_OFFSET],
        fixed[LOW], fixed[HIGH], h, last, target,
    )  # fmt: skip
    travel = fixed[RATE] * fixed[PERIOD]
    return min(max(u, last - travel), last + travel)


@njit(cache=True, nogil=True)
def error(weights: Floats, c: Floats, fixed: Floats, state: Floats, h: Floats, last: float,
    u: float) -> float:  # fmt: skip
    """Error at the present target when the drive goes from `last` to u; advances h (n,)."""
    z, kh = move(weights, h, u - fixed[U_OFFSET])
    return polynomial(c, z + kh * (u - last) / fixed[PERIOD]) - state[TARGET_NOW]


@njit(cache=True, nogil=True)
def returning(
    weights: Floats, c: Floats, fixed: Floats, state: Floats, plays: Floats, home: float,
    before: float, kept: float, other: float,
) -> float:  # fmt: skip
    """The offset from `home` on the way back from `before`: `kept`, or less where that is nearer to
    the target, or more where that is a kick. other: the static inverse's error, without its sign.
    """
    h, gap, least = plays[SCRATCH], kept, math.inf
    for part in RETURNS:
        h[:] = plays[REAL]
        e = abs(error(weights, c, fixed, state, h, state[LAST], home + part * kept))
        if e < least:
            gap, least = part * kept, e
    most = other + GENTLE * fixed[SLOPE] * abs(before) + fixed[NOISE]
    for _ in range(HALVES):
        if least < most:
            break
        gap = 0.5 * (gap + before)
        h[:] = plays[REAL]
        least = abs(error(weights, c, fixed, state, h, state[LAST], home + gap))
    return gap


@njit(cache=True, nogil=True)
def standing(
    weights: Floats, c: Floats, fixed: Floats, h: Floats, u: float, y: float, near: float
) -> float:  # fmt: skip
    """Drive near u at which the stage would stand at y, weights monotone or not: u itself if that
    is `near` enough; outward from u until y is passed, then bisection. h (n,) is left as it is."""
    rising = 1.0 if fixed[Y_LAST] > fixed[Y_FIRST] else -1.0
    e = rising * (polynomial(c, still(weights, h, u - fixed[U_OFFSET])) - y)
    if abs(e) < near:
        return u
    sign = 1.0 if e > 0.0 else -1.0
    inside, outside, reach = u, u, abs(e) / fixed[SLOPE]
    for _ in range(OUTWARD):
        outside = min(max(u - sign * reach, fixed[LOW]), fixed[HIGH])
        reach *= 2.0
        e = rising * (polynomial(c, still(weights, h, outside - fixed[U_OFFSET])) - y)
        if not sign * e > 0.0:
            break
        inside = outside
    for _ in range(HALVINGS):
        u = 0.5 * (inside + outside)
        e = rising * (polynomial(c, still(weights, h, u - fixed[U_OFFSET])) - y)
        if sign * e > 0.0:
            inside = u
        else:
            outside = u
    return outside


@njit(cache=True, nogil=True)
def back(
    weights: Floats, c: Floats, knots: Floats, fixed: Floats, state: Floats, plays: Floats,
    moved: float,
) -> tuple[float, float]:  # fmt: skip
    """Where the static inverse would have the drive: the shadow's drive if that serves this stage,
    so that both become the same; otherwise the static inverse from where the stage is, put right by
    the model where it is worse than the shadow's by more than the noise (weights not monotone).
    Returns which of them, too."""
    last, target = state[LAST], state[TARGET_NOW]
    v = state[SHADOW] - fixed[U_OFFSET]
    good = abs(polynomial(c, still(weights, plays[SHADOW_PLAYS], v)) - target)
    good += 0.5 * BUDGET * fixed[NOISE]
    if abs(polynomial(c, still(weights, plays[REAL], v)) - target) <= good:
        return state[SHADOW], BY_SHADOW
    # Further on, past what the small operators of both remember of the last reversals?
    ahead = v + math.copysign(PAST * abs(last - state[SHADOW]), moved)
    ahead = min(max(ahead, fixed[LOW] - fixed[U_OFFSET]), fixed[HIGH] - fixed[U_OFFSET])
    left = polynomial(c, still(weights, plays[REAL], ahead))
    left -= polynomial(c, still(weights, plays[SHADOW_PLAYS], ahead))
    if abs(left) <= 0.5 * BUDGET * fixed[NOISE]:
        return state[SHADOW], BY_SHADOW
    u, _ = inverse_step(
        weights[0], weights[3], c, knots, fixed[Y_FIRST], fixed[Y_LAST], fixed[U_OFFSET],
        fixed[LOW], fixed[HIGH], plays[REAL], last, target,
    )  # fmt: skip
    if abs(polynomial(c, still(weights, plays[REAL], u - fixed[U_OFFSET])) - target) <= good:
        before, travel = last - state[GAP], fixed[RATE] * fixed[PERIOD]
        return min(max(u, before - travel), before + travel), BY_ITSELF
    return standing(weights, c, fixed, plays[REAL], last, target, good), BY_REST


@njit(cache=True, nogil=True)
def rest(weights: Floats, c: Floats, fixed: Floats, state: Floats, plays: Floats) -> float:
    """Drive of a hold: on the way to where the stage stands as the static inverse would have it."""
    y = polynomial(c, still(weights, plays[SHADOW_PLAYS], state[SHADOW] - fixed[U_OFFSET]))
    near = AT_REST * fixed[NOISE]
    gap = standing(weights, c, fixed, plays[REAL], state[LAST], y, near) - state[LAST]
    step = gap * (1.0 - math.exp(-fixed[PERIOD] / HOLD_SLIDE_S))
    if abs(gap) < 1e-5 * (fixed[HIGH] - fixed[LOW]):
        step = gap
    travel = fixed[RATE] * fixed[PERIOD]
    return state[LAST] + min(max(step, -travel), travel)
