"""Choose the inverse's mode for a model, and the limits that it respects."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dehyst.models.cascade.step import Packed
from dehyst.models.errors import BadInput
from dehyst.models.hysteresis.forward import simulate_hysteresis
from dehyst.models.inverse.tuning import TUNING
from dehyst.models.model import Model
from dehyst.models.units import spell_unit

MODES = ("hold", "static", "causal", "preview")


class ModeChoice(NamedTuple):
    """mode: "static", "causal" or "preview"; reason: why, for telemetry; planned: True where a
    window of drive values is solved for, False where the exact static inverse is used."""

    mode: str
    reason: str
    planned: bool


def choose_mode(
    model: Model, dynamic: Sequence[str], price: float, mode: str, preview_s: float
) -> ModeChoice:
    """Choose the mode that suits the model and the available look-ahead.

    dynamic: kinds of its blocks that need targets ahead; price: rms difference of the nearest
    monotone model; mode: "auto" or the mode that the user requests.
    """
    h = model.hysteresis
    unit = model.displacement_unit
    low, high = model.validity.drive_min, model.validity.drive_max
    stroke = mean_slope(model, low, high) * (high - low)
    if price > TUNING.too_far * stroke:
        why = f"the weights are so far from monotone ({price:.3g} {unit} rms) that only the"
        return ModeChoice("static", f"{why} nearest monotone model can be used", False)
    if not h.static:
        why = "the model depends on the rate"
        planned = True
    elif price > 0.0:
        why = f"the weights are not monotone (static alone costs {price:.3g} {unit} rms)"
        planned = True
    elif dynamic:
        why = f"the model has {' and '.join(dynamic)}"
        planned = False
    else:
        why, planned = "the model is rate-independent and monotone", False
        if mode == "auto":
            return ModeChoice("static", why, False)
    if mode == "static":
        return ModeChoice("static", "asked for", False)
    if mode == "auto":
        if h.static and not dynamic:
            return ModeChoice("static", why, False)
        if preview_s > 0.0:
            return ModeChoice("preview", f"{why}, targets are known ahead", planned)
        return ModeChoice("static", f"{why}, no look-ahead", False)
    return ModeChoice(mode, f"asked for; {why}", planned)


def check_inverse_settings(
    period_s: float, low: float, high: float, slew_per_s: float, mode: str, preview_s: float
) -> None:
    if not 0 < period_s < math.inf:
        raise BadInput(f"period_s: must be greater than 0, not {period_s:g}")
    if not low < high:
        raise BadInput(f"drive_min: {low:g} must be below drive_max, {high:g}")
    if not slew_per_s > 0:
        raise BadInput(f"slew_per_s: must be greater than 0, not {slew_per_s:g}")
    if not 0 <= preview_s < 60:
        raise BadInput(f"preview_s: must be from 0 to 60 s, not {preview_s:g}")
    if mode not in ("auto", *MODES[1:]):
        raise BadInput(f"mode: one of auto, {', '.join(MODES[1:])} is needed, not {mode!r}")


def limits_of(
    model: Model, packed: Packed, low: float, high: float, rate: float
) -> tuple[float, float, float]:
    """Return the drive range and rate that the limits, the validity and the blocks allow."""
    v = model.validity
    low, high = max(low, v.drive_min), min(high, v.drive_max)
    least, most, fastest = packed.limits
    low, high, rate = max(low, least), min(high, most), min(rate, fastest)
    if v.rate_max and not model.hysteresis.static:
        rate = min(rate, TUNING.rate_margin * v.rate_max)
    if not low < high:
        raise BadInput(
            f"the drive limits leave nothing of the model's range, {v.drive_min:g} to "
            f"{v.drive_max:g} {spell_unit(model.drive_unit)}"
        )
    return low, high, rate


def mean_slope(model: Model, low: float, high: float) -> float:
    """Return the mean |dy/du| over the drive range; 1 where it is 0."""
    h = model.hysteresis
    ends = simulate_hysteresis(h, np.array([low, high, low, high]), 1e9)  # s: at rest
    slope = abs(float(ends[3] - ends[2])) / (high - low)
    return slope if slope != 0.0 and math.isfinite(slope) else 1.0


def noise_of(model: Model, slope: float, low: float, high: float) -> float:
    """Return the model's noise [displacement unit]; where it states none, a share of the stroke."""
    stroke = slope * (high - low)
    stated = model.fit.noise_rms or model.fit.rms
    return max(stated, 1e-6 * stroke) if stated else TUNING.noise_share * stroke  # above rounding
