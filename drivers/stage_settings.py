"""Settings of the simulated stage: every effect has its numbers, and 0 switches it off.

The defaults are a PZS001 stack (1.4 uF, 17.4 um at 150 V) on an MDT693B: 150 ohm and 60 mA in
front of the capacitor, 10 to 15 % hysteresis, creep of 1.2 % per decade, one mechanical mode and
a bridge with a filter and noise. Hum, drift, coupling, friction and rate dependence are off.
"""

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

from dehyst.drivers.interface import DriverConfigError

POSITIVE = ("full_scale_v", "stroke_um")
NOT_NEGATIVE = (
    "dac_step_v",
    "ext_gain",
    "amplifier_tau_s",
    "slew_v_per_s",
    "rc_tau_s",
    "rate_per_decade",
    "mode_hz",
    "friction_um",
    "hum_hz",
    "sensor_tau_s",
    "sensor_delay_s",
    "sensor_noise_um",
    "adc_step_um",
)
# name: (smallest, largest) where the model itself would break outside
RANGES = {
    "hysteresis_width": (0.0, 0.2),
    "asymmetry": (-1.0, 1.0),
    "creep_gain_per_decade": (0.0, 0.2),
    "mode_damping": (0.0, 0.99),
    "mode_share": (0.0, 1.0),
    "sensor_delay_s": (0.0, 0.05),
    "rate_per_decade": (0.0, 0.5),
}


@dataclass(frozen=True)
class StageSettings:
    """The stage in numbers, in the order in which the effects act. 0 switches an effect off."""

    # scale: the virgin stage moves by stroke_um from 0 V to full_scale_v
    full_scale_v: float = 150.0
    stroke_um: float = 17.4
    origin_um: float = 0.0  # displacement of the de-energised stage
    seed: int = 1  # of the sensor noise
    # electrical
    dac_step_v: float = 150.0 / 54545.0  # 2.75 mV, 16 bit
    ext_gain: float = 15.0  # volts at the output per volt at the EXT input
    clip_min_v: float = -0.5
    clip_max_v: float = 150.5
    amplifier_tau_s: float = 0.0  # first-order lag of the amplifier itself
    slew_v_per_s: float = 42857.0  # 60 mA into 1.4 uF
    rc_tau_s: float = 210e-6  # 150 ohm and 1.4 uF
    # piezo
    hysteresis_width: float = 0.12  # widest place of the full loop, as a share of its stroke
    asymmetry: float = 0.15  # exponential bow of the static map behind the hysteresis
    rate_per_decade: float = 0.0  # friction grows by 1 + this log10(1 + rate / (range per s))
    creep_gain_per_decade: float = 0.012
    # mechanics
    mode_hz: float = 780.0
    mode_damping: float = 0.02
    mode_share: float = 0.3  # share of the displacement that passes through the mode
    friction_um: float = 0.0  # half width of the guide's stick range
    # what moves the stage besides its drive
    gain_per_k: float = 0.0
    expansion_um_per_k: float = 0.0
    drift_um_per_s: float = 0.0
    coupling_um_per_v: float = 0.0  # from the other axis' voltage
    hum_um: float = 0.0
    hum_hz: float = 50.0
    # sensor
    sensor_tau_s: float = 150e-6
    sensor_delay_s: float = 0.0
    sensor_gain: float = 1.0
    sensor_offset_um: float = 0.0
    sensor_bow: float = 0.0  # parabolic error at mid-stroke, as a share of the stroke
    sensor_noise_um: float = 0.02  # standard deviation of one reading
    adc_step_um: float = 0.0005

    def __post_init__(self) -> None:
        """Refuse numbers outside their range: DriverConfigError names the key."""
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            kind = "whole number" if field.name == "seed" else "number"
            good = isinstance(value, int if field.name == "seed" else (int, float))
            if isinstance(value, bool) or not good or not math.isfinite(value):
                raise DriverConfigError(f"stage: {field.name} = {value!r} must be a {kind}")
        for name in POSITIVE:
            if getattr(self, name) <= 0:
                raise DriverConfigError(f"stage: {name} = {getattr(self, name)} must be above 0")
        for name in NOT_NEGATIVE:
            if getattr(self, name) < 0:
                raise DriverConfigError(f"stage: {name} = {getattr(self, name)} is below 0")
        for name, (low, high) in RANGES.items():
            if not low <= getattr(self, name) <= high:
                raise DriverConfigError(
                    f"stage: {name} = {getattr(self, name)} is outside {low} to {high}"
                )
        if self.clip_min_v >= self.clip_max_v:
            raise DriverConfigError(
                f"stage: clip_min_v = {self.clip_min_v} is not below clip_max_v = {self.clip_max_v}"
            )
        if self.seed < 0:
            raise DriverConfigError(f"stage: seed = {self.seed} is below 0")

    @classmethod
    def from_mapping(cls, table: Mapping[str, Any]) -> Self:
        """Settings from a table; DriverConfigError names an unknown key and the known ones."""
        unknown = sorted(set(table) - set(STAGE_KEYS))
        if unknown:
            raise DriverConfigError(
                f"unknown stage setting '{unknown[0]}'; known: {', '.join(STAGE_KEYS)}"
            )
        return cls(**table)

    def quiet(self, **others: float) -> Self:
        """This stage with every effect behind the drive but its scale switched off, for tests."""
        off = dict.fromkeys(OFF_FOR_QUIET, 0.0)
        return dataclasses.replace(self, **{**off, **others})  # type: ignore[arg-type]


STAGE_KEYS = tuple(field.name for field in dataclasses.fields(StageSettings))
OFF_FOR_QUIET = (
    "dac_step_v",
    "amplifier_tau_s",
    "slew_v_per_s",
    "rc_tau_s",
    "hysteresis_width",
    "asymmetry",
    "rate_per_decade",
    "creep_gain_per_decade",
    "mode_hz",
    "friction_um",
    "sensor_tau_s",
    "sensor_delay_s",
    "sensor_noise_um",
    "adc_step_um",
)
