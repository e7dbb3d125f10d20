"""Whether the error follows the correction as a right gauge shows it on a stage like its model.

A gauge that reads G times the place reports (G - 1) r for a target r that the stage is on, and
follows a correction by the factor G; learning then puts that report into the motion. A stage whose
gain differs from its model's looks the same, and learning would make it better. The two cannot be
distinguished by the gauge alone, so what could make the stage worse is not learned.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dehyst.models.learning.tuning import TUNING
from dehyst.models.model import Floats

Spectrum = NDArray[np.complex128] | Floats


class Following:
    """Judges one pass after the other. target: (lines,) spectrum of a pass. `first`: (error,
    correction) of the first pass that was judged, None: none yet."""

    def __init__(self, target: Spectrum) -> None:
        self._target = target[1:]
        self.first: tuple[Spectrum, Spectrum] | None = None
        self._strange = 0  # passes in a row

    def begin_anew(self) -> None:
        """What was reported of the error before counts no more."""
        self.first, self._strange = None, 0

    def wrong(self, e: Spectrum, u: Spectrum, noise: Floats) -> str:
        """What is wrong with the gauge, in words, or "". (lines,) error, correction in force, power
        of the noise."""
        if self.first is None:
            self.first = e, u
            return ""
        de, du = (x[1:] - x0[1:] for x, x0 in zip((e, u), self.first, strict=True))
        lines = np.abs(du) ** 2 > TUNING.seen * noise[1:]
        power = power_of(du[lines])
        if power == 0.0:
            return ""
        factor = complex(np.vdot(du[lines], de[lines])) / power
        strange = not abs(factor - 1.0) < TUNING.follows or self._explains(factor, noise)
        self._strange = self._strange + 1 if strange else 0
        if self._strange < TUNING.strange_passes:
            return ""
        return (
            f"the gauge follows the correction by a factor of {factor.real:.2g}{_late(factor)}, "
            "not 1 (check its sign, scale and delay, or identify the stage again)"
        )

    def _explains(self, factor: complex, noise: Floats) -> bool:
        """Whether a gauge of this factor would account for nearly all of the first error, so that
        the stage itself was closer to the target than learning would bring it."""
        if self.first is None or abs(factor - 1.0) < TUNING.follows_explained:
            return False
        error = self.first[0][1:]
        reported: Any = (factor - 1.0) * self._target
        left = error - (reported if np.iscomplexobj(error) else reported.real)
        expected = float(np.sum(noise[1:]))
        whole, rest = (max(power_of(x) - expected, 0.0) for x in (error, left))
        return rest < TUNING.explained * whole


def power_of(x: Spectrum) -> float:
    """Sum of the lines' powers."""
    return float(np.sum(np.abs(x) ** 2))


def _late(factor: complex) -> str:
    """The phase in words, where there is one that matters."""
    degrees = float(np.degrees(np.angle(factor)))
    return f" and {-degrees:.0f} degrees late" if -135.0 < degrees < -5.0 else ""
