"""Which displacements a whole model reaches, and what a set-point of 0 means.

The reach is that of the stage: hysteresis with every block that moves it, driven by a slow triangle
over the drive's range. What acts on the sensor alone does not count: targets are places of the
stage. Where a block makes the reach depend on what is not known here, the reach is a bound under an
assumption, and `Reach.assumes` says which.
"""

from dataclasses import dataclass

import numpy as np

from dehyst.models.hysteresis.forward import simulate_hysteresis
from dehyst.models.model import Block, Floats, Model
from dehyst.models.physics import KINDS
from dehyst.models.physics.kind import Kind, Led, Limited, Never, Shifted

TRIANGLE_S = 20.0
"""Period of the triangle [s]: slow against every lag and mode, quick against creep of minutes."""
POINTS = 2001
"""Of each flank: the range is resolved to a two-thousandth."""
LOOPS = 2
"""The first one leaves the de-energised start, the last one counts."""
STANDSTILL_S = 1e9
"""Sampling period with which the hysteresis sees no rate [s]."""
REMANENCE = 0.2
"""Of the range: how far the loop may stay off the zero of the de-energised stage."""


@dataclass(frozen=True)
class Reach:
    """low, high: displacements of the stage [model unit]; assumes: under which conditions, in
    words, empty where it holds as it is."""

    low: float
    high: float
    assumes: tuple[str, ...] = ()


def displacement_reach(model: Model, drive_min: float, drive_max: float) -> Reach:
    """The reach of the whole cascade between two drives [drive unit]."""
    way = np.linspace(drive_min, drive_max, POINTS)
    drive = np.tile(np.concatenate([way, way[::-1]]), LOOPS)
    drive = np.clip(drive, *_clipped_range(model))
    t_s = np.asarray(np.arange(drive.size) * (0.5 * TRIANGLE_S / POINTS), np.float64)
    y = simulate_hysteresis(model.hysteresis, drive, STANDSTILL_S)
    acting = [b for b in model.blocks if _acts_at_rest(b)]
    for block in acting:
        if KINDS[block.kind].beside:
            y = y + _run(model, block, drive, t_s)
    for block in acting:
        if not KINDS[block.kind].beside:
            y = _run(model, block, y, t_s)
    last = y[-2 * POINTS :]
    words = (_assumption(b, KINDS[b.kind]) for b in model.blocks if b.place != "sensor")
    return Reach(
        float(np.min(last)), float(np.max(last)), tuple(dict.fromkeys(w for w in words if w))
    )


def displacement_range(model: Model, drive_min: float, drive_max: float) -> tuple[float, float]:
    """The same as (low, high)."""
    reach = displacement_reach(model, drive_min, drive_max)
    return reach.low, reach.high


def set_point_origin(choice: str | float, low: float, high: float) -> float:
    """Model displacement at set-point 0 (see SetpointConfig.origin); low, high: the reach."""
    if not isinstance(choice, str):
        return float(choice)
    margin = REMANENCE * (high - low)
    arbitrary = not low - margin <= 0.0 <= high + margin
    if choice == "mid-range" or (choice == "auto" and arbitrary):
        return 0.5 * (low + high)
    return 0.0


def _acts_at_rest(block: Block) -> bool:
    """Whether a block changes where the stage goes when it goes slowly. Lags, modes and delays have
    a static gain of 1; what follows another channel adds nothing at that channel's reference."""
    kind = KINDS[block.kind]
    passing = isinstance(kind.inverse, Led | Shifted | Never)
    return block.place == "stage" and not passing and not kind.channel


def _clipped_range(model: Model) -> tuple[float, float]:
    """What the blocks before the hysteresis let through."""
    low, high = -np.inf, np.inf
    for block in model.blocks:
        kind = KINDS[block.kind]
        if block.place == "drive" and isinstance(kind.inverse, Limited):
            p, _ = kind.numbers(kind.values(block, model.drive_unit, model.displacement_unit), 1.0)
            least, most, _ = kind.inverse.limits(p)
            low, high = max(low, least), min(high, most)
    return low, high


def _run(model: Model, block: Block, x: Floats, t_s: Floats) -> Floats:
    kind = KINDS[block.kind]
    return kind.run(kind.values(block, model.drive_unit, model.displacement_unit), x, t_s)


def _assumption(block: Block, kind: Kind) -> str:
    """What the reach takes for granted of a block; "" where nothing."""
    if kind.channel:
        return f"{block.channel or 'the channel'} at its reference ({kind.says})"
    if isinstance(kind.inverse, Never):
        return f"no {kind.says.removeprefix('a ')}"
    return kind.reach_assumes
