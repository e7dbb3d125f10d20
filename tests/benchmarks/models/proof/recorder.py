"""The recorder: units, range, resolution and noise of a rig, and the faults of its rows."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.signal import lfilter
from tests.rigs.plants.drives import Floats


@dataclass(frozen=True)
class Rig:
    """How a stage is driven and recorded. low, high: drive for the plant's 0 and 10 V; per_um:
    displacement units per micrometre; corner_hz: noise is coloured below it (0: white)."""

    rate_hz: float = 1000.0
    drive_unit: str = "v"
    unit: str = "um"
    low: float = 0.0
    high: float = 10.0
    per_um: float = 1.0
    noise_um: float = 0.03
    step_um: float = 5e-4
    corner_hz: float = 0.0
    channels: tuple[str, ...] = ("temp_c", "u2_v")

    @property
    def per_volt(self) -> float:
        """Drive units per volt of the plant."""
        return (self.high - self.low) / 10.0


def noise_of(rng: np.random.Generator, n: int, rig: Rig, dt: float) -> Floats:
    """Return the noise of a recording (n,) [um]."""
    white = rng.standard_normal(n)
    if rig.corner_hz <= 0:
        return rig.noise_um * white
    keep = float(np.exp(-2 * np.pi * rig.corner_hz * dt))
    slow = lfilter([np.sqrt(1.0 - keep**2)], [1.0, -keep], rng.standard_normal(n))
    return rig.noise_um * np.asarray(0.9 * slow + np.sqrt(1 - 0.81) * white)


def faults(rng: np.random.Generator, n: int, fault: str, dt: float) -> tuple[Any, Any]:
    """Return which rows exist (n,), and which of their readings are missing (n,)."""
    kept, missing = np.ones(n, dtype=bool), np.zeros(n, dtype=bool)
    if fault == "every third reading missing":
        missing[2::3] = True
    elif fault == "rows missing":
        kept[rng.random(n) < 0.05] = False
        kept[0] = True
    elif fault == "readings missing in blocks":
        for at in rng.integers(n // 20, n - n // 20, 6):
            missing[at : at + n // 60] = True
    elif fault == "stalls":
        for at in rng.integers(n // 20, n - n // 20, 9):
            kept[at : at + max(3, round(rng.uniform(0.008, 0.032) / dt))] = False
    return kept, missing
