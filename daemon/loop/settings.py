"""The settings of a run of the loop, one row per setting: the only place that lists them.

The record that the kernels read (SETTINGS_T, named `p` in the kernels) is made from the rows of
LoopSettings. To add a setting, add a key with its default and bounds in dehyst.daemon.config, a row
and its value here, and use it in a kernel.
"""

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dehyst.daemon.config import Config

LEAST_QUEUE = 65_536  # points in the queue, 1.6 MB: fewer would save nothing that counts
PER_PERIOD = 1.5
"""Points in the queue for each period of what a client may send ahead: they may be 0.7 periods
apart (dehyst.daemon.gateway.trajectory)."""
FLATTEST = 0.5
"""Slope of the hysteresis loop just after a reversal, relative to its mean. A glide is timed in
displacement; with this factor it needs no more volts per second than the ramp even there."""


@dataclass(frozen=True)
class LoopSettings:
    """Settings from configuration, model and device limits; voltages are the actuator's."""

    period_ns: int
    gain: float  # actuator volts per drive unit
    min_v: float
    max_v: float
    slew_v: float  # per period
    safe_v: float
    ramp_v: float  # per period
    glide_um: float  # per period
    ramp_on_stop: int
    ramp_on_fault: int
    stale_ns: int
    hold_ns: int
    approach_um_per_s: float
    queue_points: int
    origin: float  # model displacement at set-point 0

    @classmethod
    def from_config(
        cls, config: Config, origin: float, min_v: float, max_v: float, slope: float
    ) -> "LoopSettings":
        """Return the settings. min_v, max_v: the tighter of the configured limits and the unit's
        own; slope: displacement per drive unit over the whole range."""
        ramp_v = config.safe.ramp_v_per_s * config.period_ns * 1e-9
        return cls(
            period_ns=config.period_ns,
            gain=config.actuator.gain,
            min_v=min_v,
            max_v=max_v,
            slew_v=config.limits.slew_v_per_s * config.period_ns * 1e-9,
            safe_v=min(max(config.safe.voltage_v, min_v), max_v),
            ramp_v=ramp_v,
            glide_um=FLATTEST * abs(slope) * ramp_v / abs(config.actuator.gain),
            ramp_on_stop=config.safe.on_stop == "ramp",
            ramp_on_fault=config.safe.on_fault == "ramp",
            stale_ns=round(config.setpoint.stale_s * 1e9),
            hold_ns=round(config.setpoint.hold_s * 1e9),
            approach_um_per_s=config.setpoint.approach_um_per_s,
            queue_points=max(
                LEAST_QUEUE, round(PER_PERIOD * config.setpoint.queue_s * config.loop.rate_hz)
            ),
            origin=origin,
        )

    def record(self) -> NDArray[Any]:
        """Return the settings as the kernels read them: a (1,) SETTINGS_T array."""
        record = np.zeros(1, SETTINGS_T)
        for name in SETTINGS_T.names or ():
            record[name] = getattr(self, name)
        return record


SETTINGS_T = np.dtype(
    [(row.name, "<i8" if row.type is int else "<f8") for row in fields(LoopSettings)]
)
