"""Compute the displacements that a whole model reaches, and the meaning of a set-point of 0.

The reach is that of the stage: the hysteresis and every block that moves the stage, driven by a
slow triangle over the drive range. Blocks of the sensor do not count, since targets are positions
of the stage. If a block makes the reach depend on something unknown, the reach holds under an
assumption that `Reach.assumes` names.
"""

from dataclasses import dataclass

import numpy as np

from dehyst.models.hysteresis.forward import simulate_hysteresis
from dehyst.models.model import Block, Floats, Model
from dehyst.models.physics import KINDS
from dehyst.models.physics.kind import Kind, Led, Limited, Never, Shifted

TRIANGLE_S = 20.0
"""Period of the triangle [s]: slow compared with any lag or mode, fast compared with creep over
minutes."""
POINTS = 2001
"""Points per flank: the range is resolved to a two-thousandth."""
LOOPS = 2
"""Number of periods: the first leaves the de-energised start, the last one counts."""
STANDSTILL_S = 1e9
"""Sampling period [s] long enough that the rate in the hysteresis is negligible."""
REMANENCE = 0.2
"""Largest distance of the loop from the zero of the de-energised stage, as a fraction of the
range."""


@dataclass(frozen=True)
class Reach:
    """low, high: displacements of the stage [model unit]; assumes: the conditions under which they
    hold, in words; empty if unconditional."""

    low: float
    high: float
    assumes: tuple[str, ...] = ()


def displacement_reach(model: Model, drive_min: float, drive_max: float) -> Reach:
    """Return the reach of the whole cascade between two drives [drive unit]."""
    way = np.linspace(drive_min, drive_max, POINTS)
    drive = np.tile(np.concatenate([way, way[::-1]]), LOOPS)
    drive = np.clip(drive, *_clipped_range(model))
    t_s = np.asarray(np.arange(drive.size) * (0.5 * TRIANGLE_S / POINTS), np.float64)
    y = simulate_hysteresis(model.hysteresis, drive, STANDSTILL_S)
    acting = [b for b in model.blocks if _acts_at_rest(b)]
    for block in acting:
        if KINDS[block.kind].is_parallel:
            y = y + _run(model, block, drive, t_s)
    for block in acting:
        if not KINDS[block.kind].is_parallel:
            y = _run(model, block, y, t_s)
    last = y[-2 * POINTS :]
    words = (_assumption(b, KINDS[b.kind]) for b in model.blocks if b.place != "sensor")
    return Reach(
        float(np.min(last)), float(np.max(last)), tuple(dict.fromkeys(w for w in words if w))
    )


def displacement_range(model: Model, drive_min: float, drive_max: float) -> tuple[float, float]:
    """Return the reach as (low, high)."""
    reach = displacement_reach(model, drive_min, drive_max)
    return reach.low, reach.high


def set_point_origin(
    choice: str | float, model: Model, drive_min: float, drive_max: float
) -> float:
    """Return the model's displacement at set-point 0 (see SetpointConfig.origin) between two drives
    [drive unit]. "auto" does not depend on them, so that other limits do not move the
    coordinates."""
    if not isinstance(choice, str):
        return float(choice)
    if choice == "model":
        return 0.0
    if choice == "mid-range":
        return 0.5 * sum(displacement_range(model, drive_min, drive_max))
    low, high = displacement_range(model, model.validity.drive_min, model.validity.drive_max)
    margin = REMANENCE * (high - low)
    return 0.0 if low - margin <= 0.0 <= high + margin else 0.5 * (low + high)


def _acts_at_rest(block: Block) -> bool:
    """Return whether a block changes the displacement in slow motion. Lags, modes and delays have a
    static gain of 1; a block that reads a channel adds nothing at the channel's reference."""
    kind = KINDS[block.kind]
    passing = isinstance(kind.inverse, Led | Shifted | Never)
    return block.place == "stage" and not passing and not kind.channel


def _clipped_range(model: Model) -> tuple[float, float]:
    """Return the drive range that the blocks before the hysteresis allow."""
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
    """Return what the reach assumes of a block; "" for nothing."""
    if kind.channel:
        return f"{block.channel or 'the channel'} at its reference ({kind.says})"
    if isinstance(kind.inverse, Never):
        return f"no {kind.says.removeprefix('a ')}"
    return kind.reach_assumes
