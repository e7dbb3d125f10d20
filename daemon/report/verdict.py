"""State in words whether a residual has reached the noise."""

import math

from dehyst.models.diagnosis.tuning import TUNING as DIAGNOSIS
from dehyst.models.identify import Identification
from dehyst.models.units import spell_unit

AT_NOISE = 1.1  # residual over noise


def verdict(result: Identification) -> str:
    """State whether the residual has reached the noise, and what to do if it has not."""
    fit, unit = result.model.fit, spell_unit(result.model.displacement_unit)
    rms, noise = fit.rms or 0.0, result.noise_rms
    if not math.isfinite(noise) or noise <= 0.0:
        return (
            f"The model leaves {rms:.3g} {unit} rms; the recording shows no noise to compare with."
        )
    ratio = rms / noise
    if ratio <= AT_NOISE:
        return (
            f"The residual is at the noise: the model leaves {rms:.3g} {unit} rms, the noise is "
            f"about {noise:.3g} {unit}. This recording leaves little to explain."
        )
    excess = math.sqrt(max(rms**2 - noise**2, 0.0))
    rows = max(one.size for one in result.residuals)
    asked = "Ask `dehyst diagnose` which physics is missing."
    if rows < DIAGNOSIS.least_samples:
        asked = f"`dehyst diagnose` needs {DIAGNOSIS.least_samples} rows to say which; record more."
    return (
        f"The residual is {ratio:.1f} times the noise: the model leaves {rms:.3g} {unit} rms, the "
        f"noise is about {noise:.3g} {unit}, so {excess:.3g} {unit} are left that a better model "
        f"could explain. {asked}"
    )
