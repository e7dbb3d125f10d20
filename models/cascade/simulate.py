"""Simulate the whole model: drive blocks, hysteresis, stage blocks, sensor blocks."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numba import njit

from dehyst.models.errors import BadInput
from dehyst.models.hysteresis.forward import forward_step
from dehyst.models.model import Block, Floats, Model
from dehyst.models.physics import KINDS


class Parts(NamedTuple):
    """drive: (N,) at the hysteresis; hysteresis: (N,) its displacement, including blocks parallel
    to it; stage: (N,) displacement of the stage; reading: (N,) reading of the sensor."""

    drive: Floats
    hysteresis: Floats
    stage: Floats
    reading: Floats


@njit(cache=True, nogil=True)
def _forward_times(
    r: Floats, b: Floats, k: Floats, c: Floats, u_offset: float, h: Floats, u: Floats, t: Floats
) -> Floats:
    y = np.empty(u.size)
    for i in range(u.size):
        rate = (u[i] - u[i - 1]) / (t[i] - t[i - 1]) if i > 0 else 0.0
        y[i] = forward_step(r, b, k, c, u_offset, h, u[i], rate)
    return y


def channels_of(model: Model) -> tuple[str, ...]:
    """Return the names of the further channels that the model reads, each once, in order."""
    return tuple(dict.fromkeys(b.channel for b in model.blocks if b.channel))


def _block(
    model: Model, block: Block, x: Floats, t: Floats, channels: Mapping[str, Floats]
) -> Floats:
    kind = KINDS[block.kind]
    values = kind.values(block, model.drive_unit, model.displacement_unit)
    channel = None
    if block.channel:
        if block.channel not in channels:
            raise BadInput(
                f"the model's block {block.kind!r} needs the channel {block.channel!r}; "
                f"there is {', '.join(channels) or 'none'}"
            )
        channel = np.asarray(channels[block.channel], np.float64)
        if channel.shape != x.shape:
            raise BadInput(f"channel {block.channel!r}: {channel.size} samples, not {x.size}")
    return kind.run(values, x, t, channel)


def simulate_parts(
    model: Model,
    t_s: Floats | float,
    u: Floats,
    channels: Mapping[str, Floats] | None = None,
    h0: Floats | None = None,
) -> Parts:
    """Return all parts of the model for a drive u (N,).

    t_s: (N,) strictly increasing times, or one sampling period [s]; channels: (N,) each, by name;
    h0: (n,) plays before the first sample, None: de-energised. Linear blocks start settled at
    their first input. Raises BadInput on missing channels, times that do not increase, or values
    that are not finite.
    """
    u = np.ascontiguousarray(u, np.float64)
    t = np.asarray(t_s, np.float64)
    t = np.ascontiguousarray(np.arange(u.size) * float(t) if t.ndim == 0 else t)
    channels = channels or {}
    if t.shape != u.shape:
        raise BadInput(f"times and drive differ in length: {t.size} and {u.size}")
    if u.size > 1 and not np.all(np.diff(t) > 0):
        raise BadInput("times must be strictly increasing")
    if not np.all(np.isfinite(u)) or not np.all(np.isfinite(t)):
        raise BadInput("the drive has values that are not finite; simulate the pieces between them")
    beside = [b for b in model.blocks if KINDS[b.kind].is_parallel]
    for block in (b for b in model.blocks if b.place == "drive"):
        u = _block(model, block, u, t, channels)
    h = model.hysteresis
    plays = np.zeros(h.n) if h0 is None else np.array(h0, np.float64)
    y = _forward_times(h.r, h.b, h.k, h.c, h.u_offset, plays, u, t)
    for block in beside:
        y = y + _block(model, block, u, t, channels)
    stage = y
    for block in (b for b in model.blocks if b.place == "stage" and b not in beside):
        stage = _block(model, block, stage, t, channels)
    reading = stage
    for block in (b for b in model.blocks if b.place == "sensor"):
        reading = _block(model, block, reading, t, channels)
    return Parts(u, y, stage, reading)


def simulate(
    model: Model,
    t_s: Floats | float,
    u: Floats,
    channels: Mapping[str, Floats] | None = None,
) -> Floats:
    """Return the sensor's reading (N,) for a drive u (N,); arguments as for `simulate_parts`."""
    return simulate_parts(model, t_s, u, channels).reading
