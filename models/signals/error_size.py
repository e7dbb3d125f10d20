"""The size of an error."""

import numpy as np

from dehyst.models.arrays import Floats

Z95 = 1.96
"""Standard deviations to either side of the mean that hold 95 % of normal noise."""


def rms(x: Floats) -> float:
    """Return the root mean square of x (N,); NaN for an empty array."""
    return float(np.sqrt(np.mean(x**2))) if x.size else float("nan")


def finite_rms(x: Floats) -> float:
    """Return the root mean square of the finite values of x (N,); 0 if there is none."""
    x = x[np.isfinite(x)]
    return rms(x) if x.size else 0.0
