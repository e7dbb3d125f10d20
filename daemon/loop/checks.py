"""What must agree before a voltage moves: ranges, rates, and the last known output.

Nothing here needs the compiler: `dehyst safe` must run when nothing else does.
"""

import math

import numpy as np
from numpy.typing import NDArray

from dehyst.daemon.config import Config
from dehyst.daemon.rings.records import TELEMETRY
from dehyst.daemon.rings.ring_file import RingFile
from dehyst.drivers.interface import Actuator, DeviceSpec, Sensor
from dehyst.drivers.registry import load_actuator, load_sensor
from dehyst.models.errors import BadInput

REPLAY_SAMPLES = 20_000
OUTPUT_AGREES_V = 1.0  # an MDT693B's readback is off by up to 0.3 V
SPARE = 0.8  # share of the period that device calls may take


def devices_of(config: Config) -> tuple[Actuator, Sensor]:
    """The configured drivers, made from their settings and not opened: no device is touched.
    DriverConfigError names what is wrong with a driver's name or settings."""
    actuator = load_actuator(config.actuator.driver).from_settings(config.actuator.settings)
    return actuator, load_sensor(config.sensor.driver).from_settings(config.sensor.settings)


def check_unopened(config: Config) -> None:
    """All that can be wrong with the devices before one is touched: drivers, their settings, limits
    and rates beyond what the drivers know of their units. Raises BadInput or DriverConfigError."""
    actuator, _ = devices_of(config)
    for channel in config.channels.values():
        if channel.driver:
            load_sensor(channel.driver).from_settings(channel.settings)
    spec = getattr(actuator, "spec", None)  # some know nothing before they are open
    if spec is None:
        return
    check_limits(config, spec)
    if config.loop.rate_hz > spec.max_rate_hz:
        raise BadInput(
            f"loop.rate_hz = {config.loop.rate_hz:g}: {config.actuator.driver} is known to sustain "
            f"{spec.max_rate_hz:.0f} Hz; set loop.rate_hz to {_round_down(spec.max_rate_hz):g} or "
            "less, or drive the stage through an analog input"
        )


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


def highest_rate(actuator: DeviceSpec, sensor: DeviceSpec) -> float:
    """The highest loop rate [Hz], with two digits, that `check_rates` lets these units have, the
    sensor read at every sample."""
    io_s = actuator.latency_s + sensor.latency_s
    return _round_down(min(actuator.max_rate_hz, sensor.max_rate_hz, SPARE / io_s))


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


def past_output(config: Config, reported_v: float) -> tuple[NDArray[np.float64], list[str]]:
    """Voltages written so far, oldest first, ending with what the output stands at now; and what
    is to be said of them.

    An earlier core's ring knows them better than the unit's own report, as long as the two agree;
    otherwise the report alone is returned.
    """
    reported, path = np.array([reported_v]), config.directory / "telemetry.ring"
    if not path.exists():
        return reported, []
    try:
        with RingFile(path, TELEMETRY) as ring:
            head, _ = ring.place()
            records, _ = ring.read(max(0, head - REPLAY_SAMPLES))
    except BadInput as error:
        return reported, [f"what was written before is not known: {error}"]
    volts = np.array(records["volts"], dtype=np.float64)
    inside = (volts >= config.limits.min_v) & (volts <= config.limits.max_v)
    if volts.size and inside.all() and abs(volts[-1] - reported_v) <= OUTPUT_AGREES_V:
        return volts, []
    return reported, []
