"""What must agree before a voltage moves: ranges, rates, origin, and the last known output."""

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dehyst.daemon.config import Config
from dehyst.daemon.records import TELEMETRY
from dehyst.daemon.ring import Ring
from dehyst.drivers.interface import DeviceSpec
from dehyst.models.errors import BadInput
from dehyst.models.forward import simulate
from dehyst.models.model import Model

REPLAY_SAMPLES = 20_000
OUTPUT_AGREES_V = 1.0  # an MDT693B's readback is off by up to 0.3 V
REMANENCE = 0.2  # of the range: how far the loop may stay off the virgin stage's zero
SPARE = 0.8  # share of the period that device calls may take


def reach(model: Model, drive_min: float, drive_max: float) -> tuple[float, float]:
    """Displacements on the major loop between two drives [model units]."""
    way = np.linspace(drive_min, drive_max, 2001)
    y = simulate(model.hysteresis, np.concatenate([way, way[::-1], way]), 1e9)[way.size :]
    return float(np.min(y)), float(np.max(y))


def origin(choice: str | float, low: float, high: float) -> float:
    """Model displacement at set-point 0 (see SetpointConfig.origin)."""
    if not isinstance(choice, str):
        return float(choice)
    margin = REMANENCE * (high - low)
    arbitrary = not low - margin <= 0.0 <= high + margin
    if choice == "mid-range" or (choice == "auto" and arbitrary):
        return 0.5 * (low + high)
    return 0.0


def check_rates(config: Config, actuator: DeviceSpec, sensor: DeviceSpec) -> int:
    """How often the sensor is read (every n-th sample); BadInput where the loop is too fast."""
    rate = config.loop.rate_hz
    if rate > actuator.max_rate_hz:
        raise BadInput(
            f"loop.rate_hz = {rate:g}: actuator {config.actuator.driver} sustains "
            f"{actuator.max_rate_hz:.0f} Hz as measured on this unit; set loop.rate_hz to "
            f"{_round_down(actuator.max_rate_hz):g} or less, or drive the stage through an "
            f"analog input"
        )
    every = max(1, math.ceil(rate / sensor.max_rate_hz))
    io_s = actuator.latency_s + sensor.latency_s
    if io_s * rate > SPARE:
        raise BadInput(
            f"loop.rate_hz = {rate:g}: device calls take {io_s * 1e3:.2f} ms of the "
            f"{1e3 / rate:.2f} ms period; set loop.rate_hz to {_round_down(SPARE / io_s):g} or less"
        )
    return every


def _round_down(rate_hz: float) -> float:
    """The next rate below with two digits."""
    step = 10.0 ** (math.floor(math.log10(rate_hz)) - 1)
    return step * math.floor(rate_hz / step)


def check_limits(config: Config, spec: DeviceSpec) -> tuple[float, float]:
    """The voltage range of this run; BadInput where the configuration asks more than the unit."""
    limits = config.limits
    if limits.min_v < spec.minimum or limits.max_v > spec.maximum:
        raise BadInput(
            f"limits {limits.min_v:g} to {limits.max_v:g} V are wider than the unit's own "
            f"{spec.minimum:g} to {spec.maximum:g} V ({spec.identity or config.actuator.driver})"
        )
    return limits.min_v, limits.max_v


def drive_range(config: Config, model: Model) -> tuple[float, float]:
    """Drives that both the limits and the model's validity allow [drive unit]."""
    gain, valid = config.actuator.gain, model.validity
    low = max(config.limits.min_v / gain, valid.drive_min)
    high = min(config.limits.max_v / gain, valid.drive_max)
    if low >= high:
        raise BadInput(
            f"the model is valid from {valid.drive_min:g} to {valid.drive_max:g} "
            f"{model.drive_unit}, the limits allow {config.limits.min_v / gain:g} to "
            f"{config.limits.max_v / gain:g}: check limits and actuator.gain"
        )
    return low, high


def past_output(config: Config, reported_v: float) -> NDArray[np.float64]:
    """Voltages written so far, oldest first, ending with what the output stands at now.

    An earlier core's ring knows them better than the unit's own report, as long as the two agree;
    otherwise the report alone is returned.
    """
    try:
        ring = Ring.attach(Path(config.directory) / "telemetry.ring", TELEMETRY)
    except BadInput:
        return np.array([reported_v])
    records, _, _ = ring.read(max(0, ring.head - REPLAY_SAMPLES))
    ring.close()
    volts = np.array(records["volts"], dtype=np.float64)
    inside = (volts >= config.limits.min_v) & (volts <= config.limits.max_v)
    if volts.size and inside.all() and abs(volts[-1] - reported_v) <= OUTPUT_AGREES_V:
        return volts
    return np.array([reported_v])
