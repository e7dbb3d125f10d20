"""The compensator's kernels: gather the window, propose a drive, follow the applied one.

Positions in the window are counted in samples from the present one. Targets that have passed are
kept in a ring for the continuation (dehyst.models.inverse_causal) and for derivatives.
"""

import math

import numpy as np
from numba import njit

from dehyst.models import inverse_guard as guard
from dehyst.models import inverse_places as places
from dehyst.models import inverse_preview as pv
from dehyst.models.cascade_step import Ints, advance, beside, lead_drive, undo
from dehyst.models.inverse_causal import extend
from dehyst.models.inverse_static import inverse_step
from dehyst.models.model import Floats

SEEN_MARGIN = 0.25  # of the range of the targets so far, by which a continuation may leave it
SECANTS = 12
PAST = 3  # nodes before the first one, for derivatives
HOLD, STATIC, CAUSAL, PREVIEW = range(4)
DRIVE, PREDICTED, READING, MODE, FLAGS = range(5)
BEYOND_SATURATION, BEYOND_DRIVE, SLEW, STARVED, BAD_TARGET, OUTSIDE = 1, 2, 4, 8, 16, 32

# Places in `setting`.
(
    PLANNED, LATE, STAGE_BLOCKS, BLOCKS_BESIDE, VALID_LOW, VALID_HIGH, VALID_RATE, NODES_WANTED,
    N_SETTING,
) = range(9)  # fmt: skip
# Places in `inner`: ring position and fill of past targets, drive at the hysteresis, what blocks
# beside it add, time, command applied last, range of the targets seen.
RING_AT, RING_FILL, V, BESIDE, TIME, COMMAND, SEEN_LOW, SEEN_HIGH, N_INNER = range(9)


@njit(cache=True, nogil=True)
def _at(window: Floats, valid: int, ring: Floats, inner: Floats, i: int) -> float:
    """Target at a whole position; before the first known one and after the last: those."""
    if i >= 0:
        return window[min(i, valid - 1)]
    fill = int(inner[RING_FILL])
    if fill == 0:
        return window[0]
    back = min(-i, fill)
    return ring[(int(inner[RING_AT]) - back) % ring.size]


@njit(cache=True, nogil=True)
def _between(window: Floats, valid: int, ring: Floats, inner: Floats, at: float) -> float:
    """Target at any position: the cubic through four samples, a line at the window's end."""
    i = math.floor(at + 1e-9)
    q = at - i
    if q < 1e-6:
        return _at(window, valid, ring, inner, i)
    b, c = _at(window, valid, ring, inner, i), _at(window, valid, ring, inner, i + 1)
    if i + 2 > valid - 1:
        return b + q * (c - b)
    a, d = _at(window, valid, ring, inner, i - 1), _at(window, valid, ring, inner, i + 2)
    return (
        -a * q * (q - 1) * (q - 2) / 6
        + b * (q + 1) * (q - 1) * (q - 2) / 2
        - c * (q + 1) * q * (q - 2) / 2
        + d * (q + 1) * q * (q - 1) / 6
    )


@njit(cache=True, nogil=True)
def _gather(
    setting: Floats, fixed: Floats, table: Ints, params: Floats, states: Floats, scratch: Floats,
    channels: Floats, state: Floats, inner: Floats, ring: Floats, window: Floats, valid: int,
    work: Floats, seq: Floats, y: Floats,
) -> int:  # fmt: skip
    """Node targets, undone to the hysteresis, into work[TARGET]; returns how many are known."""
    per_node, late = int(fixed[places.PER_NODE]), setting[LATE]
    n = work.shape[1]
    newest = valid - 1
    first = per_node - 1.0 + late  # position of node 1
    known = min(n, max(0, math.floor((newest - first + 1e-9) / per_node) + 1))
    for q in range(PAST + known):
        seq[q] = _between(window, valid, ring, inner, first + (q - PAST) * per_node)
    trust = work[places.TRUST]
    if known < n:
        for j in range(4):
            y[j] = _at(window, valid, ring, inner, newest - j * per_node)
        ahead = (first + known * per_node - newest) / per_node
        margin = SEEN_MARGIN * (inner[SEEN_HIGH] - inner[SEEN_LOW])
        extend(
            seq[PAST:], trust, known, min(max(ahead, 0.0), 1.0), y, fixed[places.PERIOD] * per_node,
            inner[SEEN_LOW] - margin, inner[SEEN_HIGH] + margin,
        )  # fmt: skip
    else:
        trust[:] = 1.0
    if setting[STAGE_BLOCKS] > 0.0:
        step_s = fixed[places.PERIOD] * per_node
        undo(table, params, states, scratch, channels, PAST, step_s, step_s, seq)
    target = work[places.TARGET]
    for j in range(n):
        target[j] = seq[PAST + j]
    if setting[BLOCKS_BESIDE] > 0.0:
        # Along the plan of the node before, which will change but little.
        ahead, add = work[places.TRIAL], work[places.ROWS]
        ahead[:] = state[places.LAST]
        if state[places.VALID] > 0.0:
            ahead[: n - 1] = work[places.PLAN, 1:]
            ahead[n - 1] = ahead[n - 2]
        step_s = fixed[places.PERIOD] * per_node
        beside(table, params, states, scratch, step_s, ahead, add)
        target -= add
    return known


@njit(cache=True, nogil=True)
def _aside(
    weights: Floats, c: Floats, knots: Floats, fixed: Floats, setting: Floats, table: Ints,
    params: Floats, state: Floats, plays: Floats, states: Floats, scratch: Floats, inner: Floats,
    y: float, spare: Floats,
) -> float:  # fmt: skip
    """What the blocks beside the hysteresis will add when the static inverse makes the rest of the
    displacement y: by secants, as near as can be. spare: (2,) overwritten."""
    if setting[BLOCKS_BESIDE] == 0.0 or not math.isfinite(y):
        return inner[BESIDE]
    v, add = spare[:1], spare[1:2]
    guess, before, off_before = inner[BESIDE], 0.0, math.nan
    best, least = guess, math.inf
    for _ in range(SECANTS):
        v[0], _ = inverse_step(
            weights[0], weights[3], c, knots, fixed[places.Y_FIRST], fixed[places.Y_LAST],
            fixed[places.U_OFFSET], fixed[places.LOW], fixed[places.HIGH], plays[places.REAL],
            state[places.LAST], y - guess,
        )  # fmt: skip
        beside(table, params, states, scratch, fixed[places.PERIOD], v, add)
        off = add[0] - guess
        if not abs(off) < least:
            if abs(off) > 2.0 * least:
                break
        else:
            best, least = guess, abs(off)
        if least <= 1e-3 * fixed[places.NOISE]:
            break
        turn = off_before - off
        move = off if not abs(turn) > 0.0 else off * (guess - before) / turn
        before, off_before = guess, off
        guess += move
    return best


@njit(cache=True, nogil=True)
def _present(
    setting: Floats, fixed: Floats, table: Ints, params: Floats, states: Floats, scratch: Floats,
    channels: Floats, inner: Floats, ring: Floats, window: Floats, valid: int, seq: Floats,
) -> float:  # fmt: skip
    """The present target, undone to the hysteresis and what stands beside it."""
    late = setting[LATE]
    if setting[STAGE_BLOCKS] > 0.0:
        three = seq[:3]
        for q in range(3):
            three[q] = _between(window, valid, ring, inner, late + q - 1.0)
        if valid - 1 < late + 1.0:
            three[2] = 2.0 * three[1] - three[0]
        period = fixed[places.PERIOD]
        undo(table, params, states, scratch, channels, 1, period, period, three)
        return three[1]
    return _between(window, valid, ring, inner, late)


@njit(cache=True, nogil=True)
def step(
    weights: Floats, c: Floats, knots: Floats, fixed: Floats, setting: Floats, table: Ints,
    params: Floats, state: Floats, plays: Floats, work: Floats, states: Floats, scratch: Floats,
    inner: Floats, ring: Floats, seq: Floats, y: Floats, window: Floats, n_valid: int,
    channels: Floats, result: Floats,
) -> None:  # fmt: skip
    """Propose a drive: fills result (5,)."""
    valid = 0
    limit = min(n_valid, window.size)
    while valid < limit and math.isfinite(window[valid]):
        valid += 1
    flags, mode, v, rate = 0, HOLD, state[places.LAST], 0.0
    period = fixed[places.PERIOD]
    if valid == 0:
        flags = BAD_TARGET if limit > 0 else STARVED
        state[places.VALID] = 0.0
        state[places.TARGET_NOW] = np.nan
    else:
        if state[places.VALID] == 0.0:
            state[places.PHASE] = 0.0
            inner[RING_FILL] = 0.0
            inner[SEEN_LOW], inner[SEEN_HIGH] = np.inf, -np.inf
        newest = window[valid - 1]
        inner[SEEN_LOW] = min(inner[SEEN_LOW], newest, window[0])
        inner[SEEN_HIGH] = max(inner[SEEN_HIGH], newest, window[0])
        now = _present(
            setting, fixed, table, params, states, scratch, channels, inner, ring, window, valid,
            seq,
        )  # fmt: skip
        now -= _aside(
            weights, c, knots, fixed, setting, table, params, state, plays, states, scratch, inner,
            now, y[:2],
        )  # fmt: skip
        state[places.TARGET_NOW] = now
        wanted = setting[NODES_WANTED]
        if setting[PLANNED] > 0.0:
            if state[places.PHASE] == 0.0:
                known = _gather(
                    setting, fixed, table, params, states, scratch, channels, state, inner, ring,
                    window, valid, work, seq, y,
                )  # fmt: skip
                state[places.NODES] = known
            v, static_made = pv.propose(
                weights, c, knots, fixed, state, plays, work, window[:valid], setting[LATE]
            )
            q = (state[places.PHASE] + 1.0) / fixed[places.PER_NODE]
            node = period * fixed[places.PER_NODE]
            if static_made:
                mode, rate = STATIC, (v - state[places.LAST]) / period
            else:
                mode = PREVIEW if wanted > 0.0 and state[places.NODES] >= 0.5 * wanted else CAUSAL
                rise = 6.0 * q * (1.0 - q) * (work[places.PLAN, 0] - state[places.X_0])
                bent = (1.0 - q) * (1.0 - 3.0 * q) * state[places.SLOPE_0]
                rate = (rise + bent + q * (3.0 * q - 2.0) * state[places.SLOPE_1]) / node
            if state[places.NODES] < wanted:
                flags |= STARVED
        else:
            v, _ = inverse_step(
                weights[0], weights[3], c, knots, fixed[places.Y_FIRST], fixed[places.Y_LAST],
                fixed[places.U_OFFSET], fixed[places.LOW], fixed[places.HIGH], plays[places.REAL],
                state[places.LAST], now,
            )  # fmt: skip
            mode, rate = STATIC, (v - state[places.LAST]) / period
            state[places.VALID] = 1.0
            if wanted > 0.0:
                mode = PREVIEW if valid > wanted else CAUSAL
                if valid <= wanted:
                    flags |= STARVED
        ring[int(inner[RING_AT])] = window[0]
        inner[RING_AT] = (inner[RING_AT] + 1) % ring.size
        inner[RING_FILL] = min(inner[RING_FILL] + 1, ring.size)
        y_a, y_b = fixed[places.Y_FIRST], fixed[places.Y_LAST]
        if now < min(y_a, y_b) or now > max(y_a, y_b):
            flags |= BEYOND_SATURATION
    last = inner[COMMAND]
    travel = fixed[places.RATE] * period
    u = lead_drive(table, params, v, rate)
    if valid == 0:
        u = last
        if setting[PLANNED] > 0.0:
            u += guard.rest(weights, c, fixed, state, plays) - state[places.LAST]
    u = min(max(u, fixed[places.LOW]), fixed[places.HIGH])
    if abs(u - last) > travel * (1.0 + 1e-9):
        u = last + travel if u > last else last - travel
        flags |= SLEW
    plays[places.SCRATCH] = plays[places.REAL]
    scratch[:] = states
    advance(
        table, params, scratch, channels, weights, c, fixed[places.U_OFFSET],
        plays[places.SCRATCH], u, inner[V], inner[TIME] + period, period, y,
    )  # fmt: skip
    if valid > 0:
        e = y[2] - _between(window, valid, ring, inner, 0.0)
        if (u <= fixed[places.LOW] or u >= fixed[places.HIGH]) and abs(e) > fixed[places.NOISE]:
            flags |= BEYOND_DRIVE
    fast = abs(u - last) > setting[VALID_RATE] * period * (1.0 + 1e-9)
    if u < setting[VALID_LOW] or u > setting[VALID_HIGH] or fast:
        flags |= OUTSIDE
    result[DRIVE], result[PREDICTED], result[READING] = u, y[2], y[3]
    result[MODE], result[FLAGS] = mode, flags


@njit(cache=True, nogil=True)
def applied(
    weights: Floats, c: Floats, knots: Floats, fixed: Floats, setting: Floats, table: Ints,
    params: Floats, state: Floats, plays: Floats, states: Floats, inner: Floats, y: Floats,
    channels: Floats, u: float, stepped: bool, result: Floats,
) -> None:  # fmt: skip
    """The drive u went out: advance the model by one sample."""
    period = fixed[places.PERIOD]
    inner[TIME] += period
    advance(
        table, params, states, channels, weights, c, fixed[places.U_OFFSET], plays[places.REAL], u,
        inner[V], inner[TIME], period, y,
    )  # fmt: skip
    inner[V], inner[BESIDE], inner[COMMAND] = y[0], y[1], u
    state[places.LAST] = y[0]
    result[DRIVE], result[PREDICTED], result[READING] = u, y[2], y[3]
    if not stepped or not math.isfinite(state[places.TARGET_NOW]):
        state[places.VALID] = 0.0
        state[places.PHASE] = 0.0
        if not stepped:  # in a hold the shadow keeps its own memory
            state[places.SHADOW] = y[0]
            plays[places.SHADOW_PLAYS] = plays[places.REAL]
        return
    state[places.PHASE] = (state[places.PHASE] + 1.0) % fixed[places.PER_NODE]
    if setting[PLANNED] > 0.0:
        state[places.SUM_REAL] += (y[4] - state[places.TARGET_NOW]) ** 2
