"""Keep the known targets and interpolate them at the plan's nodes.

Positions are counted in samples from the present one. Targets known from the previous sample remain
known: a window that is short or missing is completed from the previous one, as long as both agree
where they overlap. Passed targets are kept in a ring, for derivatives and continuation.
"""

import math
from typing import Any

import numpy as np
from numba import njit

from dehyst.models.cascade.step import (
    fill_parallel_contribution,
    invert_stage_blocks,
    start_inverse_states,
    store_next_inverse_states,
)
from dehyst.models.inverse.continuation import extend
from dehyst.models.inverse.state import Inverse
from dehyst.models.inverse.tuning import TUNING
from dehyst.models.model import Floats

PAST = 3  # nodes before the first one, for derivatives


@njit(cache=True, nogil=True)
def take_window(inv: Inverse, window: Floats, valid: int) -> int:
    """Copy `valid` targets of the newest window to `inv.ahead`; return how many are known."""
    state, ahead = inv.state[0], inv.ahead
    valid = min(valid, ahead.size)
    same = valid < state.known
    for i in range(valid):
        same = same and abs(window[i] - ahead[i]) <= inv.setting[0].noise
        ahead[i] = window[i]
    if not same and valid > 0:
        state.known = valid
    return state.known


@njit(cache=True, nogil=True)
def advance_window(inv: Inverse) -> None:
    """Advance by one sample: push the present target onto the ring and shift the rest."""
    state, ahead, ring = inv.state[0], inv.ahead, inv.ring
    if state.known == 0:
        return
    ring[state.ring_at] = ahead[0]
    state.ring_at = (state.ring_at + 1) % ring.size
    state.ring_fill = min(state.ring_fill + 1, ring.size)
    for i in range(state.known - 1):
        ahead[i] = ahead[i + 1]
    state.known -= 1


@njit(cache=True, nogil=True)
def _at(inv: Inverse, state: Any, i: int) -> float:
    """Return the target at an integer position; outside the known ones, the first or the last."""
    if i >= 0:
        return inv.ahead[min(i, state.known - 1)]
    if state.ring_fill == 0:
        return inv.ahead[0]
    back = min(-i, state.ring_fill)
    return inv.ring[(state.ring_at - back) % inv.ring.size]


@njit(cache=True, nogil=True)
def interpolate_target(inv: Inverse, at: float) -> float:
    """Return the target at any position by a cubic through four samples; linear at the end."""
    state = inv.state[0]
    i = math.floor(at + 1e-9)
    q = at - i
    if q < 1e-6:
        return _at(inv, state, i)
    b, c = _at(inv, state, i), _at(inv, state, i + 1)
    if i + 2 > state.known - 1:
        return b + q * (c - b)
    a, d = _at(inv, state, i - 1), _at(inv, state, i + 2)
    return (
        -a * q * (q - 1) * (q - 2) / 6
        + b * (q + 1) * (q - 1) * (q - 2) / 2
        - c * (q + 1) * q * (q - 2) / 2
        + d * (q + 1) * q * (q - 1) / 6
    )


@njit(cache=True, nogil=True)
def gather_targets(inv: Inverse) -> None:
    """Write the targets at the nodes, with the blocks undone, to `inv.nodes`; continue them where
    the window ends before the plan."""
    setting, state, trust, seq = inv.setting[0], inv.state[0], inv.nodes.trust, inv.seq
    per_node, n = setting.per_node, inv.plan.size
    newest = state.known - 1
    first = per_node - 1.0 + setting.late  # position of node 1
    known = min(n, max(0, math.floor((newest - first + 1e-9) / per_node) + 1))
    state.nodes = known
    for q in range(PAST + known):
        seq[q] = interpolate_target(inv, first + (q - PAST) * per_node)
    step_s = setting.period * per_node
    trust[:] = 1.0
    if known < n:
        y = inv.y
        for j in range(4):
            y[j] = _at(inv, state, newest - j * per_node)
        ahead = min(max((first + known * per_node - newest) / per_node, 0.0), 1.0)
        margin = TUNING.seen_margin * (state.seen_high - state.seen_low)
        low, high = state.seen_low - margin, state.seen_high + margin
        extend(seq[PAST:], trust, known, ahead, y, step_s, low, high)
    if setting.stage_blocks != 0:
        invert_stage_blocks(
            inv.chain, inv.blocks, inv.scratch, inv.channels, np.int64(PAST), step_s, step_s, seq
        )
    target = inv.nodes.target
    for j in range(n):
        target[j] = seq[PAST + j]
    if setting.beside != 0:
        # Along the previous node's plan, which will change only a little.
        drives, add = inv.trial, inv.nodes.rows[0]
        drives[:] = state.last
        if state.begun != 0:
            drives[: n - 1] = inv.plan[1:]
            drives[n - 1] = drives[n - 2]
        fill_parallel_contribution(inv.chain, inv.blocks, inv.scratch, step_s, drives, add)
        for j in range(n):
            target[j] -= add[j]


@njit(cache=True, nogil=True)
def present_target(inv: Inverse) -> float:
    """Return the present target of hysteresis and parallel blocks, with the stage blocks undone."""
    setting, state = inv.setting[0], inv.state[0]
    late, period = setting.late, setting.period
    if setting.stage_blocks == 0:
        return interpolate_target(inv, late)
    three = inv.seq[:3]
    for q in range(3):
        three[q] = interpolate_target(inv, late + q - 1.0)
    if state.known - 1 < late + 1.0:
        three[2] = 2.0 * three[1] - three[0]
    invert_stage_blocks(
        inv.chain, inv.blocks, inv.scratch, inv.channels, np.int64(1), period, period, three
    )
    store_next_inverse_states(inv.chain, inv.blocks, inv.scratch)
    return three[1]


@njit(cache=True, nogil=True)
def widen_target_range(inv: Inverse) -> None:
    """Widen the range of all targets until now by the present and the newest one."""
    state = inv.state[0]
    first, newest = inv.ahead[0], inv.ahead[state.known - 1]
    state.seen_low = min(state.seen_low, first, newest)
    state.seen_high = max(state.seen_high, first, newest)


@njit(cache=True, nogil=True)
def forget_targets(inv: Inverse) -> None:
    """Restart: forget all passed targets."""
    state = inv.state[0]
    start_inverse_states(inv.chain, inv.blocks)
    state.ring_fill = 0
    state.phase = 0
    state.seen_low, state.seen_high = np.inf, -np.inf
