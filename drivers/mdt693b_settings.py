"""The settings of the MDT693B driver, and finding its port."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, Self

from dehyst.drivers.interface import DeviceNotFound, DriverConfigError
from dehyst.drivers.serial_port import find_usb_ports, list_serial_ports

USB_IDS = ((0x1313, 0x1003), (0x1313, 0x1004))
"""Vendor and product of the MDT693B and the MDT694B. Older units sit behind an FTDI converter,
which many instruments use: for those the port must be given."""


@dataclass(frozen=True)
class Mdt693bConfig:
    """Settings of one driver, checked.

    port: path of the serial port, or "auto": the one MDT69xB on USB (with `serial_number`: the
    one that has it). axis: "x", "y" or "z". timeout_s: longest wait for a reply.
    write_timeout_s: longest time that a write may block. idle_s: silence that ends those replies
    of old firmware which nothing else ends. baud: bits per second. rate_hz: highest rate of sets,
    where it is known; otherwise it is measured at open(). max_v: upper limit below the unit's
    own. initial_v: the set-point at which the unit stands when it is opened, where it is known
    better than the readback tells. serial_number: accept only this unit.
    """

    port: str = "auto"
    axis: str = "x"
    timeout_s: float = 0.25
    write_timeout_s: float = 0.2
    idle_s: float = 0.05
    baud: int = 115200
    rate_hz: float | None = None
    max_v: float | None = None
    initial_v: float | None = None
    serial_number: str | None = None

    def __post_init__(self) -> None:
        if self.axis not in ("x", "y", "z"):
            raise DriverConfigError(f'setting axis is {self.axis!r}; it must be "x", "y" or "z"')
        for name in ("timeout_s", "write_timeout_s", "idle_s", "rate_hz", "max_v"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0.0):
                raise DriverConfigError(f"setting {name} is {value!r}; it must be above 0")
        if self.idle_s >= self.timeout_s:
            raise DriverConfigError("setting idle_s must be below timeout_s")
        if self.initial_v is not None and not 0.0 <= self.initial_v <= (self.max_v or 150.0):
            raise DriverConfigError(
                f"setting initial_v is {self.initial_v!r}; it must lie within the output range"
            )

    @classmethod
    def from_settings(cls, settings: Mapping[str, Any]) -> Self:
        """From a configuration table; an unknown key or a wrong type raises DriverConfigError."""
        known = {f.name: f.type for f in fields(cls)}
        for key, value in settings.items():
            if key not in known:
                raise DriverConfigError(
                    f"the mdt693b driver has no setting {key!r}; it knows {', '.join(known)}"
                )
            kind = str(known[key])
            number = isinstance(value, int | float) and not isinstance(value, bool)
            if "str" in str(kind):
                right, wanted = isinstance(value, str), "a text"
            elif "float" in str(kind):
                right, wanted = number, "a number"
            else:
                right, wanted = number and isinstance(value, int) and value > 0, "a whole number"
            if not right:
                raise DriverConfigError(f"setting {key} is {value!r}; it must be {wanted}")
        return cls(**settings)


def find_port(config: Mdt693bConfig, serial_number: str | None = None) -> str:
    """The path to open. serial_number: that of the unit to find again, if it is known.
    Raises DeviceNotFound where "auto" finds none, DriverConfigError where it finds several."""
    if config.port != "auto":
        return config.port
    found = find_usb_ports(USB_IDS)
    wanted = config.serial_number or serial_number
    if wanted and len(found) > 1:
        found = [p for p in found if p.serial_number == wanted] or found
    if not found:
        seen = ", ".join(p.path for p in list_serial_ports()) or "none"
        raise DeviceNotFound(
            f'port = "auto": no MDT693B or MDT694B on USB (serial ports here: {seen}); plug it in '
            "or give the port by its path"
        )
    if len(found) > 1:
        listed = ", ".join(f"{p.path} ({p.serial_number or 'no serial number'})" for p in found)
        raise DriverConfigError(f'port = "auto" finds several units: {listed}; choose one')
    return found[0].path
