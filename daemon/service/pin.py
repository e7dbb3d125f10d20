"""Record which units a configuration refers to: those that are plugged in now. Moves nothing."""

import re
from pathlib import Path
from typing import Any

from dehyst.daemon.config import Config, Controller
from dehyst.daemon.files.known_units import ACTUATOR, SENSOR, write_units
from dehyst.daemon.files.models import write_text
from dehyst.daemon.files.outputs import report_failures
from dehyst.daemon.loop.checks import LAST, LEFT
from dehyst.daemon.rings import run_folder
from dehyst.drivers.interface import DriverError, Identifiable, UnitIdentity
from dehyst.drivers.registry import load_actuator, load_sensor
from dehyst.models.errors import BadInput

SERIAL = "serial_number"
LOADERS: dict[str, Any] = {ACTUATOR: load_actuator, SENSOR: load_sensor}


def look_at_unit(which: str, driver: str, settings: dict[str, Any]) -> UnitIdentity | None:
    """Return the identity of the unit that answers, ignoring the serial number in the settings;
    None if the driver cannot identify units. which: ACTUATOR or SENSOR. Raises DriverError."""
    anyone = {key: value for key, value in settings.items() if key != SERIAL}
    device = LOADERS[which](driver).from_settings(anyone)
    try:
        device.open()
        return device.unit if isinstance(device, Identifiable) else None
    finally:
        device.close()


def pin_units(controller: Controller, path: Path) -> list[str]:
    """Accept the units that are plugged in as those of this configuration; return what was done,
    as lines of text. A serial number in the file is replaced. Raises InUse while the daemon runs,
    DriverError, and BadInput if the file cannot be changed."""
    said: list[str] = []
    with run_folder.at_work(controller.directory, run_folder.OUTPUT, "config pin", path):
        for config in controller.axes:
            said += _pin(config, path)
    return said


def _pin(config: Config, path: Path) -> list[str]:
    said, units = [], dict[str, UnitIdentity]()
    whose = f"axis {config.axis}: " if config.axis else ""
    for which, device in ((ACTUATOR, config.actuator), (SENSOR, config.sensor)):
        unit = look_at_unit(which, device.driver, device.settings)
        if unit is None:
            said.append(f"{whose}{which}: {device.driver} cannot distinguish one unit from another")
            continue
        units[which] = unit
        said.append(f"{whose}{which}: the unit with {unit}")
        wanted = device.settings.get(SERIAL)
        if wanted is not None and wanted != unit.serial:
            _replace_serial(path, str(wanted), unit.serial)
            said.append(f"{path}: {SERIAL} {wanted!r} is now {unit.serial!r}")
        elif wanted is None and unit.serial:
            said.append(f'to keep it: {which}.settings: {SERIAL} = "{unit.serial}"')
    write_units(config, units)
    # the last output of another unit says nothing about this one
    for name in (LAST, LEFT):
        (config.directory / name).unlink(missing_ok=True)
    return said


def _replace_serial(path: Path, old: str, new: str) -> None:
    text = path.read_text("utf-8")
    pattern = re.compile(rf"(\b{SERIAL}\s*=\s*)([\"'])" + re.escape(old) + r"\2")
    changed = pattern.sub(lambda m: f"{m[1]}{m[2]}{new}{m[2]}", text)
    if changed == text:
        raise BadInput(f"{path}: {SERIAL} = {old!r} was not found; set it to {new!r} by hand")
    with report_failures(path):
        write_text(path, changed)


def with_serial(which: str, driver: str, settings: dict[str, Any]) -> dict[str, Any]:
    """Return the settings with the serial number of the unit that is reachable now; unchanged if
    they contain one, or if there is no such unit or it has no serial number."""
    if SERIAL in settings:
        return settings
    try:
        unit = look_at_unit(which, driver, settings)
    except DriverError:
        return settings
    return settings | ({SERIAL: unit.serial} if unit is not None and unit.serial else {})
