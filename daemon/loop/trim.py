"""Settings of the slow trim for a configuration, model and gauge. dehyst.models.learning.trim
computes the trim."""

import math
from typing import Any

from numpy.typing import NDArray

from dehyst.daemon.config import Config
from dehyst.drivers.interface import DeviceSpec
from dehyst.models.errors import BadInput
from dehyst.models.learning import trim
from dehyst.models.model import Model
from dehyst.models.units import spell_unit

NO_NOISE = 0.002
"""Noise of a gauge whose model states none, as part of the reach."""


def gauge_lag_s(config: Config, model: Model, spec: DeviceSpec | None) -> float:
    """Return the delay with which the loop sees a change [s]: the model's lag and delay of the
    sensor, the driver's call, the wait for the next reading, and the period until the voltage
    acts."""
    period_s = config.period_ns * 1e-9
    every, call_s = 1, 0.0
    if spec is not None:
        every, call_s = max(1, math.ceil(config.loop.rate_hz / spec.max_rate_hz)), spec.latency_s
    return trim.sensor_lag_s(model, period_s) + call_s + period_s * (1.0 + 0.5 * every)


def trim_setting(
    config: Config, model: Model, reach: float, spec: DeviceSpec | None = None
) -> NDArray[Any]:
    """Return (1,) SETTING of dehyst.models.learning.trim. reach: range of displacements that the
    stage attains; spec: the sensor's, None: unknown. Raises BadInput for a time constant that is
    too short for the gauge, and states the shortest one that is long enough."""
    asked, lag_s = config.trim, gauge_lag_s(config, model, spec)
    least_s = trim.least_time_constant_s(lag_s)
    chosen_s = asked.time_constant_s
    if asked.enabled and chosen_s is not None and chosen_s < least_s:
        raise BadInput(
            f"trim.time_constant_s = {chosen_s:g}: the gauge is {lag_s:.3g} s late (its lag and "
            "delay in the model, its reading, the loop's period), so a correction this fast is "
            f"not stable; use {_round_up(least_s):g} s or more"
        )
    if asked.enabled and asked.limit_um is not None and asked.limit_um > reach:
        raise BadInput(
            f"trim.limit_um = {asked.limit_um:g}: the stage's whole reach is {reach:.4g} "
            f"{spell_unit(model.displacement_unit)}, so this bounds nothing; check its unit, or "
            f"use a tenth of the reach, {trim.TUNING.limit * reach:.2g}"
        )
    noise = model.fit.noise_rms or model.fit.rms or NO_NOISE * reach
    return trim.make_trim_setting(
        config.period_ns * 1e-9,
        reach,
        noise,
        asked.enabled,
        max(trim.TUNING.time_constant_s, least_s) if chosen_s is None else chosen_s,
        asked.limit_um,
        asked.rate_um_per_s,
    )


def _round_up(seconds: float) -> float:
    """Round a time up to two digits."""
    step = 10.0 ** (math.floor(math.log10(seconds)) - 1)
    return step * math.ceil(seconds / step - 1e-9)
