"""Bring the output to its configured state without the loop: after the core's death."""

from dehyst.daemon import notify
from dehyst.daemon.config import Config
from dehyst.daemon.loop.checks import check_limits, past_output
from dehyst.daemon.loop.devices import DeviceLink, ramp
from dehyst.drivers.registry import load_actuator

SHORTEST_PERIOD_S = 0.005
SPARE_S = 15.0


def make_safe(config: Config) -> float:
    """Ramp to the safe voltage, or leave the output, as `safe.on_fault` says; returns volts.

    Raises DriverError where the amplifier cannot be reached.
    """
    actuator = load_actuator(config.actuator.driver).from_settings(config.actuator.settings)
    actuator.open()
    link = DeviceLink("actuator", actuator)
    try:
        check_limits(config, actuator.spec)
        past, _ = past_output(config, float(actuator.output()))
        volts = float(past[-1])
        if config.safe.on_fault == "ramp":
            ramp_s = abs(config.safe.voltage_v - volts) / config.safe.ramp_v_per_s
            # systemd waits for it, whatever TimeoutStopSec= says
            notify.send(f"EXTEND_TIMEOUT_USEC={round(1e6 * (1.5 * ramp_s + SPARE_S))}")
            period_s = max(SHORTEST_PERIOD_S, 1.0 / actuator.spec.max_rate_hz)
            volts = ramp(link, volts, config.safe.voltage_v, config.safe.ramp_v_per_s, period_s)
        return volts
    finally:
        link.close()
