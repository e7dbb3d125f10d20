"""The compensator's kernels: propose a drive for one sample, advance by the applied one."""

import math

import numpy as np
from numba import njit

from dehyst.models.cascade.step import (
    Cascade,
    advance,
    advance_inverse_states,
    fill_parallel_contribution,
    lead_drive,
    start_inverse_states,
)
from dehyst.models.inverse import fallback, lookahead, preview
from dehyst.models.inverse.state import Inverse, inverse_at
from dehyst.models.inverse.static import inverse_step
from dehyst.models.inverse.tuning import TUNING
from dehyst.models.model import Floats

HOLD, STATIC, CAUSAL, PREVIEW = range(4)
BEYOND_SATURATION, BEYOND_DRIVE, SLEW, STARVED, BAD_TARGET, OUTSIDE = 1, 2, 4, 8, 16, 32


@njit(cache=True, nogil=True, inline="always")
def _cascade(inv: Inverse) -> Cascade:
    return Cascade(inv.chain, inv.hysteresis, inv.channels)


@njit(cache=True, nogil=True)
def parallel_contribution(inv: Inverse, y: float) -> float:
    """Return what the blocks parallel to the hysteresis will add while the static inverse makes the
    rest of the displacement y. The secant method finds it; the best iterate is returned."""
    setting, state = inv.setting[0], inv.state[0]
    if setting.beside == 0 or not math.isfinite(y):
        return state.beside
    v, add = inv.y[:1], inv.y[1:2]
    guess, before, off_before = state.beside, 0.0, math.nan
    best, least = guess, math.inf
    for _ in range(TUNING.secants):
        v[0], _ = inverse_step(inv.static, inv.plays, state.last, y - guess)
        fill_parallel_contribution(inv.chain, inv.blocks, inv.scratch, setting.period, v, add)
        off = add[0] - guess
        if not abs(off) < least:
            if abs(off) > 2.0 * least:
                break
        else:
            best, least = guess, abs(off)
        if least <= 1e-3 * setting.noise:
            break
        turn = off_before - off
        move = off if not abs(turn) > 0.0 else off * (guess - before) / turn
        before, off_before = guess, off
        guess += move
    return best


@njit(cache=True, nogil=True)
def _follow(inv: Inverse) -> tuple[float, float, int]:
    """Return the drive at the hysteresis for the present target, its rate, and the mode used."""
    setting, state = inv.setting[0], inv.state[0]
    state.target_before = state.target
    target = lookahead.present_target(inv)
    state.target = target - parallel_contribution(inv, target)
    guarded = setting.wanted > 0
    if setting.planned == 0:
        v, _ = inverse_step(inv.static, inv.plays, state.last, state.target)
        mode = PREVIEW if guarded and state.known >= setting.wanted else STATIC
        return v, (v - state.last) / setting.period, mode
    if state.phase == 0:
        lookahead.gather_targets(inv)
    v = preview.propose(inv, guarded)
    if state.followed == 0:
        return v, (v - state.last) / setting.period, STATIC
    return v, preview.speed(inv), PREVIEW if guarded else CAUSAL


@njit(cache=True, nogil=True)
def _rest(inv: Inverse) -> float:
    """Return the drive at the hysteresis while holding: a gap left by a plan fades, then the drive
    is constant."""
    state = inv.state[0]
    if state.followed != 0:
        state.gap = fallback.gap_of(inv, inv.plays, state.last, state.target)
        state.followed = 0
    state.begun = 0
    if state.gap == 0.0 or not math.isfinite(state.target):
        return state.last
    return fallback.approach(inv, state.target)


@njit(cache=True, nogil=True)
def propose_drive(inv: Inverse, window: Floats, n_valid: int) -> None:
    """Propose a drive: fill `inv.result`. window: targets from the present sample on, of which the
    first n_valid are valid."""
    setting, state, limits = inv.setting[0], inv.state[0], inv.static.limits[0]
    valid, limit = 0, min(n_valid, window.size)
    while valid < limit and math.isfinite(window[valid]):
        valid += 1
    period = setting.period
    flags = STARVED if limit < setting.wanted else 0
    if valid == 0 and limit > 0:
        flags |= BAD_TARGET
    if lookahead.take_window(inv, window, valid) > 0:
        if state.begun == 0:
            lookahead.forget_targets(inv)
        lookahead.widen_target_range(inv)
        v, rate, mode = _follow(inv)
        state.begun = 1
        y_a, y_b = limits.y_first, limits.y_last
        if state.target < min(y_a, y_b) or state.target > max(y_a, y_b):
            flags |= BEYOND_SATURATION
    else:
        v, rate, mode = _rest(inv), 0.0, HOLD
        if limit == 0:
            flags |= STARVED
    last, travel = state.command, setting.rate * period
    u = last + v - state.last if mode == HOLD else lead_drive(inv.chain, v, rate)
    u = min(max(u, limits.low), limits.high)
    if abs(u - last) > travel * (1.0 + 1e-9):
        u = last + travel if u > last else last - travel
        flags |= SLEW
    h, y = inv.ahead_plays, inv.y
    h[:] = inv.plays
    inv.scratch[:] = inv.blocks
    time = state.time + period
    advance(_cascade(inv), inv.scratch, h, u, state.last, time, period, y)
    at_end = u <= limits.low or u >= limits.high
    if mode != HOLD and at_end and abs(y[2] - inv.ahead[0]) > setting.noise:
        flags |= BEYOND_DRIVE
    fast = abs(u - last) > setting.valid_rate * period * (1.0 + 1e-9)
    if u < setting.valid_low or u > setting.valid_high or fast:
        flags |= OUTSIDE
    result = inv.result[0]
    result.drive, result.predicted, result.reading = u, y[2], y[3]
    result.mode, result.flags = mode, flags


@njit(cache=True, nogil=True)
def applied(inv: Inverse, u: float, stepped: bool) -> None:
    """Advance the model by one sample with the applied drive u."""
    setting, state, y = inv.setting[0], inv.state[0], inv.y
    state.time += setting.period
    time, dt = state.time, setting.period
    advance(_cascade(inv), inv.blocks, inv.plays, u, state.last, time, dt, y)
    state.last, state.beside, state.command = y[0], y[1], u
    result = inv.result[0]
    result.drive, result.predicted, result.reading = u, y[2], y[3]
    if stepped:
        state.phase = (state.phase + 1) % setting.per_node
        lookahead.advance_window(inv)
        advance_inverse_states(inv.chain, inv.blocks)
    else:  # no drive was proposed: known targets and the plan are void
        state.begun = state.followed = state.known = state.phase = 0
        state.gap, state.target = 0.0, np.nan
        start_inverse_states(inv.chain, inv.blocks)


@njit(cache=True, nogil=True)
def step_at(address: int, window: Floats, n_valid: int) -> None:
    """Call `propose_drive` from Python, with the Inverse given by the address of its table."""
    propose_drive(inverse_at(address), window, n_valid)


@njit(cache=True, nogil=True)
def applied_at(address: int, u: float, stepped: bool) -> None:
    """Call `applied` from Python, with the Inverse given by the address of its table."""
    applied(inverse_at(address), u, stepped)
