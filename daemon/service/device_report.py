"""Report what the devices of a configuration say about themselves, opened as the daemon does."""

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from dehyst.daemon.config import Config
from dehyst.daemon.files.known_units import ACTUATOR, SENSOR, expect_known
from dehyst.daemon.loop.checks import devices_of
from dehyst.drivers.direct_calls import Reachable
from dehyst.drivers.interface import Actuator
from dehyst.drivers.settings import UNITS

NUMBERS = ("minimum", "maximum", "resolution", "max_rate_hz", "latency_s", "late_s")


def report_devices(config: Config) -> dict[str, dict[str, Any]]:
    """Return for "actuator" and "sensor" the driver, the numbers of its DeviceSpec, whether the
    compiled loop can call it, and its present output or reading. Moves nothing. Raises
    DriverError, BadInput."""
    actuator, sensor = devices_of(config)
    found = {}
    for which, driver, device in (
        (ACTUATOR, config.actuator.driver, actuator),
        (SENSOR, config.sensor.driver, sensor),
    ):
        expect_known(config, which, device)
        try:
            device.open()
            stands = device.output() if isinstance(device, Actuator) else device.read()
            compiled = isinstance(device, Reachable) and device.direct() is not None
            spec = asdict(device.spec)
            found[which] = {
                "driver": driver,
                "identity": spec["identity"],
                "unit": spec["unit"],
                **{name: spec[name] for name in NUMBERS},
                "stands_at": stands if stands == stands else None,  # JSON has no NaN
                "stands_at_is_known": spec["output_known"],
                "compiled": compiled,
            }
        finally:
            device.close()
    return found


def lines_of(which: str, device: Mapping[str, Any]) -> list[str]:
    """Format the report of one device (see report_devices) as lines of text."""
    unit, at = UNITS.get(device["unit"], device["unit"]), device["stands_at"]
    stands = "no valid reading" if at is None else f"{at:.6g} {unit}"
    if not device["stands_at_is_known"]:
        stands += " (as configured; the device does not report it)"
    late = f", rarely longer than {1e3 * device['late_s']:.3g} ms" if device["late_s"] else ""
    return [
        f"{which}: {device['driver']}: {device['identity']}",
        f"  {device['minimum']:g} to {device['maximum']:g} {unit} in steps of "
        f"{device['resolution']:.3g} {unit}; now at {stands}",
        f"  a call takes {1e3 * device['latency_s']:.3g} ms{late}; {device['max_rate_hz']:.0f} Hz "
        f"sustained; {'compiled' if device['compiled'] else 'Python'} loop",
    ]
