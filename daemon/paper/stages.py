"""Stages of the experiments: the paper's two equations, and one of a different class."""

from collections.abc import Callable

import numpy as np

from dehyst.models.hysteresis.forward import simulate_hysteresis
from dehyst.models.model import Floats
from dehyst.models.modelfile import shipped

Stage = Callable[[Floats, float], Floats]
"""(drive (N,) [V], period [s]) -> displacement (N,) [um], from the de-energised state."""

GAIN_UM, LOOP_UM = 1.15, 1.3  # um/V of the straight line; um of the hysteretic part at full scale
REACH_V = 1.6  # drive after a reversal over which the hysteretic part reverses
SOFTENING = 0.004  # 1/V: the stroke saturates by 4 % at 10 V, as a stack does


def bouc_wen_stage(drive: Floats, period_s: float) -> Floats:
    """Return the displacement (N,) [um] of a Bouc-Wen stage: no play operators, no odd polynomial.

    The hysteretic variable of exponent 1 with beta = 1 and gamma = 0, dh = dv - |dv| h, is solved
    exactly between samples (Wen, J. Eng. Mech. 1976); v is the drive divided by REACH_V.
    """
    out = np.empty(drive.size)
    h, before = 0.0, 0.0
    for i, u in enumerate(drive.tolist()):
        step = (u - before) / REACH_V
        h += (np.sign(step) - h) * (1.0 - np.exp(-abs(step)))
        out[i] = GAIN_UM * u * (1.0 - SOFTENING * u) - LOOP_UM * 0.5 * h
        before = u
    return out


def _paper(name: str) -> Stage:
    hysteresis = shipped(name).hysteresis
    return lambda drive, period_s: simulate_hysteresis(hysteresis, drive, period_s)


STAGES: dict[str, Stage] = {
    "Eq. 11": _paper("paper-eq11"),
    "Eq. 12": _paper("paper-eq12"),
    "Bouc-Wen": bouc_wen_stage,
}
