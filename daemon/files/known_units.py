"""Units that a daemon knows: stored with its state, and compared before a voltage is set.

    units.json     {"actuator": {...}, "sensor": {...}}: UnitIdentity of devices that can report it

Code that opens a configured device to move it, or to act on its readings, opens it here. The unit
is recorded the first time; afterwards another unit is refused (ForeignUnit) before anything is set
on it. `dehyst config pin` records it again.
"""

import os
from pathlib import Path
from typing import Any

import msgspec

from dehyst.daemon.config import Config
from dehyst.daemon.files.models import write_text
from dehyst.daemon.files.outputs import report_failures
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
    """Return the file in which the units of an axis are kept: next to its cases, or in the run
    folder."""
    folder = config.watch_directory if config.watch.directory else config.directory
    return folder / FILE


def read_units(config: Config) -> dict[str, UnitIdentity]:
    """Return the known units by device; empty if none is known yet. Raises BadInput if they cannot
    be read."""
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
    """Store these units. Raises NotNow if they cannot be written, BadInput for a bad run folder."""
    path = units_file(config)
    with report_failures(path, NotNow):
        if path.parent == config.directory:
            make_run_folder(path.parent)
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        write_text(path, msgspec.json.format(msgspec.json.encode(units)).decode() + "\n")


def forget_unit(config: Config, which: str) -> None:
    """Forget a unit, so that the next one opened is recorded. which: ACTUATOR or SENSOR."""
    known = read_units(config)
    if known.pop(which, None) is not None:
        write_units(config, known)


def expect_known(config: Config, which: str, device: Any) -> None:
    """Make the device accept only the known unit; call before it is opened. which: ACTUATOR or
    SENSOR."""
    known = read_units(config).get(which)
    if known is not None and isinstance(device, Identifiable):
        device.expect(known)


def open_known(config: Config, which: str, device: Any) -> None:
    """Open a device of an axis, and record its unit the first time. Raises the errors of open() and
    of reading the known units; the device is then closed."""
    expect_known(config, which, device)
    device.open()
    try:
        unit = device.unit if isinstance(device, Identifiable) else None
        if unit is not None and (known := read_units(config)).get(which) != unit:
            write_units(config, known | {which: unit})
    except BaseException:
        device.close()
        raise
