"""Random cascades of every physics, by seed, and their reach from the cascade's own simulation."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from tests.rigs.random_models import random_model

from dehyst.models.cascade.simulate import simulate_parts
from dehyst.models.hysteresis.forward import simulate_hysteresis
from dehyst.models.model import Block, Floats, Model
from dehyst.models.physics import PHYSICS
from dehyst.models.physics.entry import Scales

MOST_BLOCKS = 4
BY_THEMSELVES = ("hum", "trend", "earlier_creep")
ORDER = ("drive", "stage", "sensor")
SIMULATED_S, STEP_S = 30.0, 0.005
"""Period of the simulated triangle, slower than the one that determines the reach, and its sampling
period [s]."""


def random_cascade(seed: int) -> Model:
    """Return a random base with up to MOST_BLOCKS blocks, all different, in physical order."""
    rng = np.random.default_rng(seed)
    base = random_model(rng)
    v = base.validity
    way = np.linspace(v.drive_min, v.drive_max, 200)
    y = simulate_hysteresis(base.hysteresis, np.concatenate([way, way[::-1]]), 1e9)
    span = v.drive_max - v.drive_min
    scales = Scales(v.drive_min, v.drive_max, 20.0 * span, 1e-3, 20.0, float(np.ptp(y)), "v", "um")
    names = [str(n) for n in rng.permutation(sorted(PHYSICS))[: rng.integers(1, MOST_BLOCKS + 1)]]
    blocks: list[Block] = []
    for name in names:
        specimens = list(PHYSICS[name].specimens.values())
        one = specimens[int(rng.integers(len(specimens)))]
        variants = one.variants(scales)
        block = variants[int(rng.integers(len(variants)))]
        if block.kind not in {b.kind for b in blocks}:
            blocks.append(block)
    blocks.sort(key=lambda b: ORDER.index(b.place))
    return Model(base.hysteresis, v, blocks=tuple(blocks))


def simulated_reach(model: Model) -> tuple[float, float]:
    """Return the displacements of the stage over the second of two slow triangles, with the
    channels at their references and every block simulated except those that act without a drive
    (hum, trends)."""
    v = model.validity
    model = replace(model, blocks=tuple(b for b in model.blocks if b.kind not in BY_THEMSELVES))
    way = np.linspace(v.drive_min, v.drive_max, round(0.5 * SIMULATED_S / STEP_S))
    drive = np.tile(np.concatenate([way, way[::-1]]), 2)
    channels: Mapping[str, Floats] = {
        b.channel: np.full(drive.size, _reference(b)) for b in model.blocks if b.channel
    }
    stage = simulate_parts(model, STEP_S, drive, channels).stage[drive.size // 2 :]
    return float(stage.min()), float(stage.max())


def _reference(block: Block) -> float:
    found = [v for k, v in block.params.items() if k.startswith("reference")]
    return float(np.atleast_1d(found[0])[0]) if found else 0.0
