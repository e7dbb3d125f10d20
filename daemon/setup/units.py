"""Find the connected units by letting the drivers probe each port. Moves nothing."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from dehyst.daemon.loop.checks import highest_rate, joined
from dehyst.drivers.apt.link import USB_IDS
from dehyst.drivers.interface import (
    Actuator,
    DeviceSpec,
    DeviceTimeout,
    DriverConfigError,
    ForeignUnit,
    Identifiable,
    ProtocolError,
    Sensor,
)
from dehyst.drivers.mdt693b.settings import USB_IDS as AMPLIFIERS
from dehyst.drivers.mdt693b.settings import Mdt694bConfig
from dehyst.drivers.registry import load_actuator, load_sensor
from dehyst.drivers.serial_port import find_usb_ports

ACTUATOR, PIEZO, SENSOR = ("actuator", "mdt693b"), ("actuator", "kpz101"), ("sensor", "ksg101")
"""Units that may be connected to a serial port. Units that speak APT are probed first: their query
has no line end, so an MDT693B takes it as half a command, which its own driver then discards."""
WITH_GAUGES = (("actuator", "kpc101"), ("actuator", "bpc303"))
"""Amplifiers with a strain gauge input, which the sensor driver of the same name reads."""
APT_UNITS = (SENSOR, PIEZO, *WITH_GAUGES)
ANY_UNIT = (*APT_UNITS, ACTUATOR)
ATTEMPTS = 2
"""How often each unit is asked for at a port: one that has just been switched on, or a computer
that is busy, may be too late for the first answer."""


@dataclass(frozen=True)
class FoundUnit:
    """One unit. kind: "actuator" or "sensor"; spec: its DeviceSpec, measured just now."""

    kind: str
    driver: str
    port: str
    spec: DeviceSpec
    serial: str = ""

    @property
    def settings(self) -> dict[str, Any]:
        """Settings of its driver: the port, and the serial number if it has one."""
        return settings_for(self.port, self.serial)


def settings_for(port: str, serial: str) -> dict[str, Any]:
    """Return settings that find a unit and, if it has a serial number, accept no other."""
    return {"port": port} | ({"serial_number": serial} if serial else {})


def output_of(driver: str, axis: str) -> dict[str, Any]:
    """Return the setting that selects an amplifier's output; {} if it has only one output."""
    settings = getattr(load_actuator(driver), "settings_type", None)
    return {"axis": axis} if "axis" in getattr(settings, "__struct_fields__", ()) else {}


def known_ports() -> dict[str, tuple[tuple[str, str], ...]]:
    """Return the ports with the USB ids of known units, and the units that may be at each."""
    found: dict[str, tuple[tuple[str, str], ...]] = {}
    for ids, units in ((AMPLIFIERS, (ACTUATOR,)), (USB_IDS, APT_UNITS)):
        found |= {port.path: units for port in find_usb_ports(ids)}
    return found


def ask_port(
    path: str, axis: str, expected: tuple[tuple[str, str], ...] = ANY_UNIT
) -> FoundUnit | None:
    """Return the unit at this port, or None if it is none of the expected ones. Raises DriverError
    if the port cannot be opened, or if the unit is there but cannot be used as it is."""
    for kind, driver in ATTEMPTS * expected:
        settings: dict[str, Any] = {"port": path}
        device: Actuator | Sensor
        if kind == "actuator":
            device = load_actuator(driver).from_settings(settings | output_of(driver, axis))
        else:
            device = load_sensor(driver).from_settings(settings)
        try:
            device.open()
        except (DeviceTimeout, ProtocolError, ForeignUnit):  # no unit, or one of another kind
            continue
        finally:
            device.close()
        unit = device.unit if isinstance(device, Identifiable) else None
        if unit and unit.kind.startswith(Mdt694bConfig.model):
            driver = Mdt694bConfig.driver  # the same firmware with one output
        return FoundUnit(kind, driver, path, device.spec, unit.serial if unit else "")
    return None


def units_at(path: str, axis: str, expected: tuple[tuple[str, str], ...]) -> list[FoundUnit]:
    """As ask_port, but return a list, with the unit's own gauge if it has one."""
    unit = ask_port(path, axis, expected)
    return [found for found in (unit, unit and gauge_beside(unit)) if found]


def _open_patiently(device: Actuator | Sensor) -> None:
    """Open a unit that is known to be there, again if it was too late for an answer. Raises
    DriverError."""
    for attempts_left in reversed(range(ATTEMPTS)):
        try:
            device.open()
        except DeviceTimeout:
            device.close()
            if not attempts_left:
                raise
        else:
            return


def gauge_beside(unit: FoundUnit) -> FoundUnit | None:
    """Return an amplifier's own gauge; None if it has none, or none is connected. Raises
    DriverError."""
    if (unit.kind, unit.driver) not in WITH_GAUGES:
        return None
    device = load_sensor(unit.driver).from_settings(unit.settings)
    try:
        _open_patiently(device)
    except DriverConfigError:
        return None
    finally:
        device.close()
    return FoundUnit("sensor", unit.driver, unit.port, device.spec, unit.serial)


def measure_rate(unit: FoundUnit, axes: Sequence[str], gauges: Sequence[FoundUnit]) -> float:
    """Return the highest loop rate [Hz] with these axes of an amplifier driven and one gauge per
    axis read, measured now. Raises DriverError."""
    driver = load_actuator(unit.driver)
    outputs = [driver.from_settings(unit.settings | {"axis": axis}) for axis in axes]
    try:
        for output in outputs:
            _open_patiently(output)
        pairs = zip(outputs, gauges, strict=True)
        specs = [(output.spec, gauge.spec) for output, gauge in pairs]
        return highest_rate(specs, joined(outputs))
    finally:
        for output in outputs:
            output.close()
