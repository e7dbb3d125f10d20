"""The rounding of a reading to the steps of its gauge."""

import numpy as np

from dehyst.models.recording import Floats

ROWS = 20_000
"""Number of rows of a reading in which its smallest step is searched."""


def quantum(y: Floats) -> float:
    """Return the smallest step of the reading that occurs."""
    steps = np.diff(np.unique(y[: min(y.size, ROWS)]))
    steps = steps[steps > 1e-9 * max(1.0, float(np.abs(y).max()))]
    return float(steps.min()) if steps.size else 0.0


def rounding_rms(step: float) -> float:
    """Return the rms error of a reading that is rounded to multiples of `step`: the error is
    uniform over one step."""
    return step / float(np.sqrt(12.0))
