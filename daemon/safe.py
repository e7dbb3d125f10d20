"""Bring the output to its configured state without the loop: after the core's death."""

from dehyst.daemon.checks import check_limits, past_output
from dehyst.daemon.config import Config
from dehyst.daemon.devices import Link, ramp
from dehyst.drivers.registry import load_actuator

SHORTEST_PERIOD_S = 0.005


def make_safe(config: Config) -> float:
    """Ramp to the safe voltage, or leave the output, as `safe.on_fault` says; returns volts.

    Raises DriverError where the amplifier cannot be reached.
    """
    actuator = load_actuator(config.actuator.driver).from_settings(config.actuator.settings)
    actuator.open()
    link = Link("actuator", actuator)
    try:
        check_limits(config, actuator.spec)
        volts = float(past_output(config, float(actuator.output()))[-1])
        if config.safe.on_fault == "ramp":
            period_s = max(SHORTEST_PERIOD_S, 1.0 / actuator.spec.max_rate_hz)
            volts = ramp(link, volts, config.safe.voltage_v, config.safe.ramp_v_per_s, period_s)
        return volts
    finally:
        link.close()
