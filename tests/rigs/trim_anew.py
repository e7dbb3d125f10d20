"""A trimmed stage whose loop dies or whose gauge is wrong, and how far from its target it ends."""

import numpy as np
from tests.rigs.stage_model import kept_model
from tests.rigs.trimmed_stage import TrimmedStage

from dehyst.daemon.rings.records import Flag
from dehyst.drivers.simulated.settings import StageSettings

RATE_HZ = 200.0
ON_TARGET_UM = 0.03  # one and a half times the noise: what the loop attains without a fault


def rig(seed: int = 1) -> TrimmedStage:
    plain = StageSettings(rc_tau_s=0.0, mode_hz=0.0, sensor_tau_s=0.0, seed=seed)
    return TrimmedStage(kept_model(), plain, rate_hz=RATE_HZ)


def wander(one: TrimmedStage, seconds: float, seed: int) -> None:
    """Visit random places in the reach."""
    rng = np.random.default_rng(seed)
    low, high = one.reach
    for _ in range(round(seconds / 0.5)):
        one.go(float(rng.uniform(low + 0.1 * (high - low), high - 0.1 * (high - low))), 0.5)


def die(one: TrimmedStage) -> None:
    """Let the loop's process die; the next one knows the recent past except the last 0.2 s."""
    one.reload(kept_model(), unseen=40)


def drift(one: TrimmedStage, um: float, seconds: float) -> None:
    """Let the gauge drift by this much at a set-point; then it reads the truth again."""
    low, high = one.reach
    place = 0.5 * (low + high)
    one.go(place, 5.0)
    begun, rate = one.now_ns, um / seconds * 1e-9
    one.go(place, seconds, lambda rig, reading: reading + rate * (rig.now_ns - begun))


def error_um(one: TrimmedStage, off: float = 0.0) -> float:
    """Return the mean distance from the target in the last second; off: error of the gauge."""
    n = round(RATE_HZ)
    return float(np.mean(one.true_um[-n:] + off - one.telemetry["target"][-n:]))


def frozen(one: TrimmedStage) -> bool:
    return bool(one.records[-1]["flags"] & int(Flag.TRIM_FROZEN))
