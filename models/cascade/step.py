"""The cascade one sample at a time: forward along the applied drive, and inverse for targets.

A model's blocks are packed once into a `Chain`: one record per block with the positions of its
parameters and its state and the addresses of its kernels. A block whose channel is NaN (not
measured) is skipped.
"""

import math
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dehyst.models.cascade.simulate import channels_of
from dehyst.models.hysteresis.forward import polynomial as saturation
from dehyst.models.hysteresis.operators import Operators, move
from dehyst.models.model import Block, Floats, Model
from dehyst.models.physics import KINDS
from dehyst.models.physics.address import call_at
from dehyst.models.physics.kind import STATES, Kind, Led, Limited, Shifted, Solved

AT_DRIVE, PARALLEL, AT_STAGE, AT_SENSOR = range(4)
_PLACES = {"drive": AT_DRIVE, "stage": AT_STAGE, "sensor": AT_SENSOR}

BLOCK = np.dtype(
    [
        ("place", "i8"),
        ("step", "i8"),  # address of the forward kernel
        ("solve", "i8"),  # address of the inverse kernel; 0: none
        ("memory", "i8"),  # whether the inverse starts from the present state
        ("own", "i8"),  # length of the inverse's separate state, which follows the block's
        ("p_from", "i8"),
        ("n_p", "i8"),
        ("s_from", "i8"),
        ("n_s", "i8"),
        ("channel", "i8"),  # -1: none
        ("first_s", "f8"),  # lead of the targets: factor of the first derivative,
        ("second_s2", "f8"),  # and of the second
    ]
)


class Chain(NamedTuple):
    """A model's blocks in the form that kernels take. Its addresses are valid only in this process.

    blocks: (k,) of BLOCK; params: all their parameters, concatenated.
    """

    blocks: NDArray[np.void]
    params: Floats


class Cascade(NamedTuple):
    """A whole model in the form that kernels take; channels: (c,) present values."""

    chain: Chain
    hysteresis: Operators
    channels: Floats


@dataclass(frozen=True)
class Packed:
    """A model's blocks for the kernels, and their properties that the inverse needs."""

    chain: Chain
    kinds: tuple[Kind, ...]  # of each block
    state_size: int
    channels: tuple[str, ...]
    delay_s: float  # of drive and stage together
    has_parallel_blocks: bool  # whether blocks add to the hysteresis
    on_stage: bool  # whether blocks act after the hysteresis, on the stage
    dynamic: tuple[str, ...]  # kinds before the sensor whose inverse needs future targets
    limits: tuple[float, float, float]  # lowest drive, highest drive, highest rate of the blocks

    def settle(self, drive: float, displacement: float) -> Floats:
        """Return the states of blocks settled at this drive and displacement."""
        states = np.zeros(self.state_size)
        for row, kind in zip(self.chain.blocks, self.kinds, strict=True):
            p = self.chain.params[row["p_from"] :][: row["n_p"]]
            s = states[row["s_from"] :][: row["n_s"]]
            kind.start(p, s, drive if row["place"] in (AT_DRIVE, PARALLEL) else displacement)
        start_inverse_states(self.chain, states)
        return states


def with_delays_behind(model: Model) -> Model:
    """Return the model with the delays of its drive moved after the hysteresis. The effect of the
    drive is equally late in either place, but the hysteresis then follows the drive without delay,
    as needed to compute the next drive from its state."""
    moved: list[Block] = []
    rest: list[Block] = []
    for block in model.blocks:
        late = block.place == "drive" and isinstance(KINDS[block.kind].inverse, Shifted)
        (moved if late else rest).append(replace(block, place="stage") if late else block)
    return replace(model, blocks=(*moved, *rest))


def pack(model: Model, period_s: float, spacing_s: float = 0.0) -> Packed:
    """Return the model's blocks as arrays for a loop with this period [s]. spacing_s: spacing [s]
    of targets that are also inverted, if longer."""
    names = channels_of(model)
    kinds = tuple(KINDS[block.kind] for block in model.blocks)
    blocks, params = np.zeros(len(kinds), BLOCK), [np.zeros(0)]
    p_at = s_at = 0
    late, low, high, rate = 0.0, -math.inf, math.inf, math.inf
    for row, block, kind in zip(blocks, model.blocks, kinds, strict=True):
        values = kind.values(block, model.drive_unit, model.displacement_unit)
        p, size = kind.numbers(values, period_s)
        row["place"] = PARALLEL if kind.is_parallel else _PLACES[block.place]
        row["channel"] = names.index(block.channel) if block.channel else -1
        row["p_from"], row["n_p"], row["s_from"], row["n_s"] = p_at, p.size, s_at, size
        row["step"] = kind.step.address
        params.append(p)
        p_at, s_at = p_at + p.size, s_at + size
        match kind.inverse:
            case Solved(solve, memory):
                row["solve"], row["memory"] = solve.address, memory
            case Led(_, solve, is_solved) if solve is not None and all(
                is_solved(p, dt) for dt in (period_s, max(period_s, spacing_s))
            ):
                row["solve"], row["memory"], row["own"] = solve.address, 1, size // STATES
            case Led(lead):
                row["first_s"], row["second_s2"] = lead(p)
            case Shifted(seconds) if block.place != "sensor":
                late += float(seconds(p))
            case Limited(limits):
                least, most, fastest = limits(p)
                low, high, rate = max(low, least), min(high, most), min(rate, fastest)
    moving = {b.kind for b in model.blocks if b.place != "sensor" and KINDS[b.kind].dynamic}
    return Packed(
        chain=Chain(blocks, np.concatenate(params)),
        kinds=kinds,
        state_size=s_at,
        channels=names,
        delay_s=late,
        has_parallel_blocks=bool(np.any(blocks["place"] == PARALLEL)),
        on_stage=bool(np.any(blocks["place"] == AT_STAGE)),
        dynamic=tuple(sorted(moving)),
        limits=(low, high, rate),
    )


@njit(cache=True, nogil=True)
def _through(
    kernel: int, b: Any, params: Floats, states: Floats, x: float, t: float, dt: float, ch: float
) -> float:
    """Pass one sample through one of a block's kernels and advance its state."""
    p_at, s_at = params.ctypes.data + 8 * b.p_from, states.ctypes.data + 8 * b.s_from
    return call_at(kernel, (p_at, b.n_p, s_at, b.n_s), (x, t, dt, ch))


@njit(cache=True, nogil=True)
def advance(
    cascade: Cascade,
    states: Floats,
    plays: Floats,
    u: float,
    v_before: float,
    t: float,
    dt: float,
    y: Floats,
) -> None:
    """Advance the whole model, plays (n,) and states, by one sample for the command u; v_before:
    drive at the hysteresis one sample before. Fill y (5,): drive at the hysteresis, contribution of
    the blocks parallel to it, stage displacement, reading, displacement of the hysteresis alone."""
    blocks, params = cascade.chain.blocks, cascade.chain.params
    hysteresis, channels = cascade.hysteresis, cascade.channels
    v = u
    for i in range(blocks.size):
        if blocks[i].place == AT_DRIVE:
            v = _through(blocks[i].step, blocks[i], params, states, v, t, dt, 0.0)
    z, kh = move(hysteresis.weights, plays, v - hysteresis.u_offset[0])
    x = saturation(hysteresis.c, z + kh * (v - v_before) / dt)
    added = 0.0
    for i in range(blocks.size):
        if blocks[i].place == PARALLEL:
            added += _through(blocks[i].step, blocks[i], params, states, v, t, dt, 0.0)
    y[4] = x
    x += added
    y[0], y[1] = v, added
    for place in (AT_STAGE, AT_SENSOR):
        for i in range(blocks.size):
            b = blocks[i]
            if b.place == place:
                ch = channels[b.channel] if b.channel >= 0 else 0.0
                if not math.isnan(ch):
                    x = _through(b.step, b, params, states, x, t, dt, ch)
        y[place] = x


@njit(cache=True, nogil=True)
def fill_parallel_contribution(
    chain: Chain, states: Floats, scratch: Floats, dt: float, v: Floats, out: Floats
) -> None:
    """Fill out (m,) with the contribution of the blocks parallel to the hysteresis for drives v
    (m,) at the hysteresis, spaced by dt, starting from the present states. scratch: as long as
    states, overwritten."""
    out[:] = 0.0
    for i in range(chain.blocks.size):
        b = chain.blocks[i]
        if b.place == PARALLEL:
            scratch[b.s_from : b.s_from + b.n_s] = states[b.s_from : b.s_from + b.n_s]
            for j in range(v.size):
                out[j] += _through(b.step, b, chain.params, scratch, v[j], 0.0, dt, 0.0)


@njit(cache=True, nogil=True)
def _lead(seq: Floats, first: float, second: float) -> None:
    """Compute seq + first * seq' + second * seq'' in place, in units of the spacing, with central
    differences where possible; the first entry is not modified."""
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
def invert_stage_blocks(
    chain: Chain,
    states: Floats,
    scratch: Floats,
    channels: Floats,
    past: int,
    step_s: float,
    first_s: float,
    seq: Floats,
) -> None:
    """Convert displacements of the stage into displacements of the hysteresis, in place.

    seq (m,): values spaced by step_s; the first `past` of them have already been applied and are
    used only for derivatives; seq[past] is first_s after the last applied sample. states: of the
    blocks after that sample; scratch: as long, overwritten. The channels are assumed constant.
    Delays are not inverted here (they shift the window), nor are blocks that add to the hysteresis.
    """
    params = chain.params
    for k in range(chain.blocks.size - 1, -1, -1):
        b = chain.blocks[k]
        ch = channels[b.channel] if b.channel >= 0 else 0.0
        if b.place != AT_STAGE or math.isnan(ch):
            continue
        if b.first_s != 0.0 or b.second_s2 != 0.0:
            _lead(seq, b.first_s / step_s, b.second_s2 / (step_s * step_s))
        elif b.solve != 0:
            scratch[b.s_from : b.s_from + b.n_s] = states[b.s_from : b.s_from + b.n_s]
            begin = past if b.memory else 0
            first = seq[begin]
            for i in range(begin, seq.size):
                dt = first_s if i == begin else step_s
                seq[i] = _through(b.solve, b, params, scratch, seq[i], 0.0, dt, ch)
                if i == begin:  # for the next sample
                    own = scratch[b.s_from + b.own : b.s_from + 2 * b.own]
                    scratch[b.s_from + 2 * b.own : b.s_from + 3 * b.own] = own
            for i in range(begin):
                seq[i] += seq[begin] - first


@njit(cache=True, nogil=True)
def start_inverse_states(chain: Chain, states: Floats) -> None:
    """Initialise the separate states of inverses with those of their blocks."""
    for i in range(chain.blocks.size):
        b = chain.blocks[i]
        states[b.s_from + b.own : b.s_from + 2 * b.own] = states[b.s_from : b.s_from + b.own]


@njit(cache=True, nogil=True)
def store_next_inverse_states(chain: Chain, states: Floats, scratch: Floats) -> None:
    """Keep the inverse states that `invert_stage_blocks` prepared for the next sample;
    `advance_inverse_states` makes them the present ones."""
    for i in range(chain.blocks.size):
        b = chain.blocks[i]
        first, end = b.s_from + 2 * b.own, b.s_from + 3 * b.own
        states[first:end] = scratch[first:end]


@njit(cache=True, nogil=True)
def advance_inverse_states(chain: Chain, states: Floats) -> None:
    """Advance the separate states of inverses by one sample."""
    for i in range(chain.blocks.size):
        b = chain.blocks[i]
        after = states[b.s_from + 2 * b.own : b.s_from + 3 * b.own]
        states[b.s_from + b.own : b.s_from + 2 * b.own] = after


@njit(cache=True, nogil=True)
def lead_drive(chain: Chain, v: float, rate: float) -> float:
    """Return the command for which the drive blocks (lags) output v, while v moves at this rate."""
    for i in range(chain.blocks.size):
        if chain.blocks[i].place == AT_DRIVE:
            v += chain.blocks[i].first_s * rate
    return v
