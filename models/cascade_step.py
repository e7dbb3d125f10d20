"""The cascade one sample at a time: forward along the applied drive, and targets undone.

A block whose channel is NaN (not measured) is passed over. Blocks are packed into arrays once:
`table` (n_blocks, 7) int64 with code, place and where each block's parameters, state and channel
lie; `params`, `states`: one flat array each.
"""

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dehyst.models.blocks import (
    REGISTRY,
    clip,
    coupled_memory,
    coupled_mode,
    coupling,
    creep,
    delay,
    drift,
    friction,
    hum,
    lag,
    memory,
    one_sided,
    polynomial,
    rate,
    resonance,
    ripple,
    shape,
    slew,
    slow_drift,
    trend,
)
from dehyst.models.cascade import SHAPES, channels_of
from dehyst.models.errors import BadModel
from dehyst.models.forward import polynomial as saturation
from dehyst.models.model import Floats, Model
from dehyst.models.plan import move

CODE, PLACE, P_FROM, P_TO, S_FROM, S_TO, CHANNEL = range(7)
AT_DRIVE, BESIDE, AT_STAGE, AT_SENSOR = range(4)
_PLACES = {"drive": AT_DRIVE, "stage": AT_STAGE, "sensor": AT_SENSOR}

Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Packed:
    """A model's blocks for the kernels. start: states of blocks settled at 0 input."""

    table: Ints
    params: Floats
    state_size: int
    channels: tuple[str, ...]
    delay_s: float  # of drive and stage together
    beside: bool  # whether shape or memory blocks add to the hysteresis

    def settle(self, model: Model, drive: float, displacement: float) -> Floats:
        """States of blocks that have long seen this drive and displacement."""
        states = np.zeros(self.state_size)
        for row in self.table:
            kind = _KINDS[int(row[CODE])]
            p, s = self.params[row[P_FROM] : row[P_TO]], states[row[S_FROM] : row[S_TO]]
            at_drive = row[PLACE] in (AT_DRIVE, BESIDE)
            kind.start(p, s, drive if at_drive else displacement)
        return states


_KINDS = {kind.code: kind for kind in REGISTRY.values()}
_FOLLOWED = {
    module.CODE
    for module in (
        clip, coupled_memory, coupled_mode, coupling, creep, delay, drift, friction, hum, lag,
        memory, one_sided, polynomial, rate, resonance, ripple, shape, slew, slow_drift, trend,
    )
}  # fmt: skip


def pack(model: Model, period_s: float) -> Packed:
    """The model's blocks as arrays for a loop of this period."""
    names = channels_of(model)
    rows, params = [], [np.zeros(0)]
    p_at = s_at = 0
    late = 0.0
    for block in model.blocks:
        kind = REGISTRY[block.kind]
        if kind.code not in _FOLLOWED:
            raise BadModel(f"blocks: kind {kind.name!r} cannot be followed sample by sample")
        values = kind.values(block, model.drive_unit, model.displacement_unit)
        p = np.asarray(kind.pack(values, period_s), np.float64)
        size = kind.size(p, period_s)
        place = BESIDE if block.kind in SHAPES else _PLACES[block.place]
        channel = names.index(block.channel) if block.channel else -1
        rows.append([kind.code, place, p_at, p_at + p.size, s_at, s_at + size, channel])
        params.append(p)
        p_at, s_at = p_at + p.size, s_at + size
        if block.kind == "delay" and block.place != "sensor":
            late += float(p[0])
    table = np.array(rows, np.int64).reshape(-1, 7)
    beside = bool(np.any(table[:, PLACE] == BESIDE))
    return Packed(table, np.concatenate(params), s_at, names, late, beside)


@njit(cache=True, nogil=True)
def _block_step(code: int, p: Floats, s: Floats, x: float, t: float, dt: float, ch: float) -> float:
    if code == lag.CODE:
        return lag.step(p, s, x, t, dt, ch)
    if code == resonance.CODE:
        return resonance.step(p, s, x, t, dt, ch)
    if code == delay.CODE:
        return delay.step(p, s, x, t, dt, ch)
    if code == slew.CODE:
        return slew.step(p, s, x, t, dt, ch)
    if code == clip.CODE:
        return clip.step(p, s, x, t, dt, ch)
    if code == creep.CODE:
        return creep.step(p, s, x, t, dt, ch)
    if code == drift.CODE:
        return drift.step(p, s, x, t, dt, ch)
    if code == trend.CODE:
        return trend.step(p, s, x, t, dt, ch)
    if code == coupling.CODE:
        return coupling.step(p, s, x, t, dt, ch)
    if code == hum.CODE:
        return hum.step(p, s, x, t, dt, ch)
    if code == polynomial.CODE:
        return polynomial.step(p, s, x, t, dt, ch)
    if code == shape.CODE:
        return shape.step(p, s, x, t, dt, ch)
    if code == memory.CODE:
        return memory.step(p, s, x, t, dt, ch)
    if code == coupled_memory.CODE:
        return coupled_memory.step(p, s, x, t, dt, ch)
    if code == coupled_mode.CODE:
        return coupled_mode.step(p, s, x, t, dt, ch)
    if code == friction.CODE:
        return friction.step(p, s, x, t, dt, ch)
    if code == one_sided.CODE:
        return one_sided.step(p, s, x, t, dt, ch)
    if code == rate.CODE:
        return rate.step(p, s, x, t, dt, ch)
    if code == ripple.CODE:
        return ripple.step(p, s, x, t, dt, ch)
    if code == slow_drift.CODE:
        return slow_drift.step(p, s, x, t, dt, ch)
    return x


@njit(cache=True, nogil=True)
def advance(
    table: Ints, params: Floats, states: Floats, channels: Floats, weights: Floats, c: Floats,
    u_offset: float, h: Floats, u: float, v_before: float, t: float, dt: float, out: Floats,
) -> None:  # fmt: skip
    """The whole model over one sample. out (5,): drive at the hysteresis, what blocks beside it
    add, stage displacement, reading, displacement of the hysteresis alone. h (n,) and states are
    advanced."""
    v = u
    for i in range(table.shape[0]):
        if table[i, 1] == 0:
            v = _block_step(
                table[i, 0], params[table[i, 2] : table[i, 3]], states[table[i, 4] : table[i, 5]],
                v, t, dt, 0.0,
            )  # fmt: skip
    z, kh = move(weights, h, v - u_offset)
    y = saturation(c, z + kh * (v - v_before) / dt)
    beside = 0.0
    for i in range(table.shape[0]):
        if table[i, 1] == 1:
            beside += _block_step(
                table[i, 0], params[table[i, 2] : table[i, 3]], states[table[i, 4] : table[i, 5]],
                v, t, dt, 0.0,
            )  # fmt: skip
    out[4] = y
    y += beside
    out[0], out[1] = v, beside
    for place in (2, 3):
        for i in range(table.shape[0]):
            if table[i, 1] == place:
                ch = channels[table[i, 6]] if table[i, 6] >= 0 else 0.0
                if math.isnan(ch):
                    continue
                y = _block_step(
                    table[i, 0], params[table[i, 2] : table[i, 3]],
                    states[table[i, 4] : table[i, 5]], y, t, dt, ch,
                )  # fmt: skip
        out[place] = y


@njit(cache=True, nogil=True)
def beside(
    table: Ints, params: Floats, states: Floats, scratch: Floats, dt: float, v: Floats, out: Floats
) -> None:  # fmt: skip
    """What the blocks beside the hysteresis add along the drives v (m,) at the hysteresis, spaced
    by dt, from the states of the present; into out (m,). scratch: as long as states."""
    out[:] = 0.0
    for i in range(table.shape[0]):
        if table[i, 1] == 1:
            s = scratch[table[i, 4] : table[i, 5]]
            s[:] = states[table[i, 4] : table[i, 5]]
            p = params[table[i, 2] : table[i, 3]]
            for j in range(v.size):
                out[j] += _block_step(table[i, 0], p, s, v[j], 0.0, dt, 0.0)


@njit(cache=True, nogil=True)
def _lead(seq: Floats, first: float, second: float) -> None:
    """seq + first * seq' + second * seq'' in units of the spacing, in place, central where it can
    be; the first entry is left as it is."""
    n = seq.size
    before = seq[0]
    for i in range(1, n):
        now = seq[i]
        if i < n - 1:
            after = seq[i + 1]
            seq[i] = now + 0.5 * first * (after - before) + second * (after - 2 * now + before)
        else:
            seq[i] = now + first * (now - before)
        before = now


@njit(cache=True, nogil=True)
def _undo_step(code: int, p: Floats, s: Floats, y: float, dt: float, ch: float) -> float:
    """Input of a block with memory whose next output is y; s is advanced by it. The channel is
    taken to stand still."""
    if code == creep.CODE:
        x = creep.solve(p, s, y, dt)
        creep.step(p, s, x, 0.0, dt, 0.0)
        return x
    if code == friction.CODE:
        x = friction.solve(p, s, y, dt)
        friction.step(p, s, x, 0.0, dt, 0.0)
        return x
    if code == slow_drift.CODE:
        slow_drift.step(p, s, 0.0, 0.0, dt, ch)
        return slow_drift.solve(p, s, y)
    if code == coupled_memory.CODE:
        return y - coupled_memory.step(p, s, 0.0, 0.0, dt, ch)
    return y - coupled_mode.step(p, s, 0.0, 0.0, dt, ch)


@njit(cache=True, nogil=True)
def undo(
    table: Ints, params: Floats, states: Floats, scratch: Floats, channels: Floats,
    past: int, step_s: float, first_s: float, seq: Floats,
) -> None:  # fmt: skip
    """Turn displacements of the stage into displacements of the hysteresis, in place.

    seq (m,): values spaced by step_s; the first `past` of them have been applied already, and
    are there for the derivatives alone; seq[past] lies first_s after the last applied sample.
    states: of the blocks after that sample; scratch: as long, overwritten. Delays are not undone
    here (they shift the window), nor what adds to the hysteresis.
    """
    n = seq.size
    for b in range(table.shape[0] - 1, -1, -1):
        if table[b, 1] != 2:
            continue
        code = table[b, 0]
        p = params[table[b, 2] : table[b, 3]]
        ch = channels[table[b, 6]] if table[b, 6] >= 0 else 0.0
        if math.isnan(ch):
            continue
        if code == lag.CODE:
            _lead(seq, p[0] / step_s, 0.0)
        elif code == resonance.CODE:
            w = 2.0 * np.pi * p[0]
            a1, share = 2.0 * p[1] / w, p[2]
            a2 = share * share * a1 * a1 - share * (a1 * a1 - 1.0 / (w * w))
            _lead(seq, share * a1 / step_s, a2 / (step_s * step_s))
        elif (
            code == creep.CODE
            or code == friction.CODE
            or code == slow_drift.CODE
            or code == coupled_memory.CODE
            or code == coupled_mode.CODE
        ):
            s = scratch[table[b, 4] : table[b, 5]]
            s[:] = states[table[b, 4] : table[b, 5]]
            first = seq[past]
            for i in range(past, n):
                dt = first_s if i == past else step_s
                seq[i] = _undo_step(code, p, s, seq[i], dt, ch)
            for i in range(past):
                seq[i] += seq[past] - first
        elif code == drift.CODE:
            for i in range(n):
                seq[i] = drift.solve(p, seq[i], ch)
        elif code == coupling.CODE:
            for i in range(n):
                seq[i] -= p[0] * (ch - p[1])
        elif code == polynomial.CODE:
            guess = seq[0]
            for i in range(n):
                guess = polynomial.solve(p, seq[i], guess)
                seq[i] = guess


@njit(cache=True, nogil=True)
def lead_drive(table: Ints, params: Floats, v: float, rate: float) -> float:
    """Command whose drive blocks (lags) pass on v, while v moves at this rate."""
    for b in range(table.shape[0]):
        if table[b, 1] == 0 and table[b, 0] == lag.CODE:
            v += params[table[b, 2]] * rate
    return v
