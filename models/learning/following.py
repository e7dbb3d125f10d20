"""Check that the error follows the correction as it does with a correct gauge and a correct model.

A gauge that reads G times the position reports the error (G - 1) r while the stage is at the target
r, and its reading follows a correction by the factor G; learning would then add that false error to
the motion. A stage whose gain differs from its model's looks the same, and learning would improve
it. The gauge alone cannot distinguish the two, so an error that could make the stage worse is not
learned.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dehyst.models.learning.tuning import TUNING
from dehyst.models.model import Floats

Spectrum = NDArray[np.complex128] | Floats


class FollowingCheck:
    """Check one pass after another. target: (lines,) spectrum of a pass. `first`: (error,
    correction) of the first pass that was checked, None: none yet."""

    def __init__(self, target: Spectrum) -> None:
        self._target = target[1:]
        self.first: tuple[Spectrum, Spectrum] | None = None
        self._strange = 0  # passes in a row

    def forget_errors(self) -> None:
        """Discard the errors of earlier passes."""
        self.first, self._strange = None, 0

    def find_fault(self, e: Spectrum, u: Spectrum, noise: Floats) -> str:
        """Return what is wrong with the gauge as a message, or "". e, u, noise: (lines,) error,
        correction in force, noise power."""
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
        """Return whether a gauge with this factor would explain nearly all of the first error: the
        stage itself was then closer to the target than learning would bring it."""
        if self.first is None or abs(factor - 1.0) < TUNING.follows_explained:
            return False
        error = self.first[0][1:]
        reported: Any = (factor - 1.0) * self._target
        left = error - (reported if np.iscomplexobj(error) else reported.real)
        expected = float(np.sum(noise[1:]))
        whole, rest = (max(power_of(x) - expected, 0.0) for x in (error, left))
        return rest < TUNING.explained * whole


def power_of(x: Spectrum) -> float:
    """Return the sum of the lines' powers."""
    return float(np.sum(np.abs(x) ** 2))


def _late(factor: complex) -> str:
    """Return the phase lag as text, or "" where it is negligible."""
    degrees = float(np.degrees(np.angle(factor)))
    # a phase beyond 135 degrees is a wrong sign, one below 5 is negligible
    return f" and {-degrees:.0f} degrees late" if -135.0 < degrees < -5.0 else ""
