"""The units that a daemon knows: kept beside its state, compared before a voltage is set.

    units.json     {"actuator": {...}, "sensor": {...}}: UnitIdentity of devices that can tell it

Whoever opens a device of a configuration to move it, or to go by what it reads, opens it here:
the first time the unit is learned, from then on another one is refused (ForeignUnit) before
anything is set on it. `dehyst config pin` learns anew.
"""

import os
from pathlib import Path
from typing import Any

import msgspec

from dehyst.daemon.config import Config
from dehyst.daemon.files.models import write_text
from dehyst.daemon.input_file import NotReadable, read_text
from dehyst.daemon.prepared import resolve_classes
from dehyst.daemon.rings.run_folder import make_run_folder
from dehyst.drivers import system
from dehyst.drivers.interface import Identifiable, UnitIdentity
from dehyst.models.errors import BadInput, NotNow

FILE, LARGEST_BYTES = "units.json", 1 << 16
ACTUATOR, SENSOR = "actuator", "sensor"
resolve_classes(UnitIdentity)


def units_file(config: Config) -> Path:
    """Where the units of an axis are kept: with its cases, or in the run folder."""
    folder = config.watch_directory if config.watch.directory else config.directory
    return folder / FILE


def read_units(config: Config) -> dict[str, UnitIdentity]:
    """The known units by device; empty: none yet. Raises BadInput where they cannot be read."""
    path = units_file(config)
    try:
        found = os.lstat(path)
    except FileNotFoundError:
        return {}
    except OSError as error:
        raise BadInput(f"{path}: the known units cannot be read: {error.strerror}") from None
    if found.st_uid not in (system.user_id(), 0):
        raise BadInput(f"{path}: it belongs to user {found.st_uid}, and is not trusted; remove it")
    try:
        return msgspec.json.decode(read_text(path, LARGEST_BYTES), type=dict[str, UnitIdentity])
    except (NotReadable, msgspec.MsgspecError) as error:
        raise BadInput(
            f"{path}: the known units cannot be read ({error}); `dehyst config pin` records "
            "them again"
        ) from None


def write_units(config: Config, units: dict[str, UnitIdentity]) -> None:
    """Keep these. Raises NotNow where there is no place for them, BadInput for a bad run folder."""
    path = units_file(config)
    try:
        if path.parent == config.directory:
            make_run_folder(path.parent)
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        write_text(path, msgspec.json.format(msgspec.json.encode(units)).decode() + "\n")
    except OSError as error:
        raise NotNow(f"{path}: cannot be written: {error.strerror or error}") from None


def forget_unit(config: Config, which: str) -> None:
    """The next one that is opened is learned. which: ACTUATOR or SENSOR."""
    known = read_units(config)
    if known.pop(which, None) is not None:
        write_units(config, known)


def expect_known(config: Config, which: str, device: Any) -> None:
    """Before the device is opened: none but the known unit. which: ACTUATOR or SENSOR."""
    known = read_units(config).get(which)
    if known is not None and isinstance(device, Identifiable):
        device.expect(known)


def open_known(config: Config, which: str, device: Any) -> None:
    """Open a device of an axis; the first time its unit is learned. Raises what open() and the
    reading of what is known raise; the device is closed then."""
    expect_known(config, which, device)
    device.open()
    try:
        unit = device.unit if isinstance(device, Identifiable) else None
        if unit is not None and (known := read_units(config)).get(which) != unit:
            write_units(config, known | {which: unit})
    except BaseException:
        device.close()
        raise
