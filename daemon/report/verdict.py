"""State in words whether a residual has reached the noise."""

import math

import numpy as np

from dehyst.models.diagnosis.tuning import TUNING as DIAGNOSIS
from dehyst.models.identify import Identification
from dehyst.models.units import spell_unit

AT_NOISE = 1.1  # residual over noise
MOST_ROWS = 0.9  # share of the rows: fitted ones speak for the whole recording


def verdict(result: Identification) -> str:
    """State whether the residual has reached the noise, and what to do if it has not."""
    fit, unit = result.model.fit, spell_unit(result.model.displacement_unit)
    rms, noise, apart = fit.rms or 0.0, result.noise_rms, ""
    if fit.steady_rms is not None and fit.steady_rms < rms:
        rms, apart = fit.steady_rms, " apart from the drift"  # which is reported by itself
    left = f"the model leaves {rms:.3g} {unit} rms{apart}"
    if not math.isfinite(noise) or noise <= 0.0:
        return f"T{left[1:]}; the recording shows no noise to compare with."
    ratio, floor = rms / noise, f"the noise is about {noise:.3g} {unit}"
    if ratio <= AT_NOISE:
        return f"The residual is at the noise level: {left}, {floor}. {_state_rest(result)}"
    excess = math.sqrt(max(rms**2 - noise**2, 0.0))
    rows = max(one.size for one in result.residuals)
    asked = "Run `dehyst diagnose` to find which physics is missing."
    if rows < DIAGNOSIS.least_samples:
        asked = f"`dehyst diagnose` needs {DIAGNOSIS.least_samples} rows to name it; record more."
    return (
        f"The residual is {ratio:.1f} times the noise: {left}, {floor}, so a better model could "
        f"explain another {excess:.3g} {unit}. {asked}"
    )


def _state_rest(result: Identification) -> str:
    """State how much of the recordings a residual at the noise concerns."""
    rows = sum(int(np.count_nonzero(~np.isnan(one))) for one in result.residuals)
    fitted = sum(int(np.count_nonzero(one)) for one in result.used)
    if fitted >= MOST_ROWS * rows:
        return "Little is left to explain in this recording."
    return f"This holds for the {fitted} of {rows} rows that were fitted."
