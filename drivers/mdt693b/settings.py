"""The settings of the MDT693B and MDT694B drivers, and the search for their port."""

from typing import Annotated, ClassVar, Literal

from msgspec import Meta

from dehyst.drivers.interface import DeviceNotFound, DriverConfigError
from dehyst.drivers.serial_port import find_usb_ports, list_serial_ports
from dehyst.drivers.settings import Settings

THREE_AXES_ID, ONE_AXIS_ID = (0x1313, 0x1003), (0x1313, 0x1004)
USB_IDS = (THREE_AXES_ID, ONE_AXIS_ID)
"""USB ids (vendor, product) of the MDT693B and MDT694B. Older units use an FTDI converter, as many
instruments do: for those the port must be given."""

HIGHEST_V = 150.0
"""The highest position of the limit switch."""


class Mdt69xConfig(Settings, frozen=True):
    """The settings that both drivers share. model: the only accepted one, "": either; usb_ids:
    those that port = "auto" looks for."""

    driver = "mdt69x"
    model: ClassVar[str] = ""
    usb_ids: ClassVar[tuple[tuple[int, int], ...]] = USB_IDS

    port: Annotated[
        str,
        Meta(min_length=1, description='path of the serial port; "auto": the one MDT69xB on USB'),
    ] = "auto"
    timeout_s: Annotated[float, Meta(gt=0, description="longest wait for a reply")] = 0.25
    write_timeout_s: Annotated[
        float, Meta(gt=0, description="longest time that a write to the port may block")
    ] = 0.2
    idle_s: Annotated[
        float, Meta(gt=0, description="silence that ends a reply of old firmware; below timeout_s")
    ] = 0.05
    baud: Annotated[int, Meta(gt=0, description="bits per second of the serial line")] = 115200
    rate_hz: (
        Annotated[
            float, Meta(gt=0, description="highest rate of sets; measured at start if left out")
        ]
        | None
    ) = None
    max_v: (
        Annotated[
            float,
            Meta(gt=0, description="upper limit of the output, where lower than the unit's own"),
        ]
        | None
    ) = None
    initial_v: (
        Annotated[
            float,
            Meta(
                ge=0, description="set-point at start, where it is known better than the readback"
            ),
        ]
        | None
    ) = None
    serial_number: Annotated[str, Meta(description="accept only this unit")] | None = None

    @property
    def axis(self) -> str:
        """The output that drives the stage; the only one if there is no such setting."""
        return "x"

    def check(self) -> None:
        """Refuse an idle_s that no reply could wait for, and a set-point out of range."""
        if self.idle_s >= self.timeout_s:
            raise self.wrong("idle_s", f"below timeout_s = {self.timeout_s:g}")
        highest_v = HIGHEST_V if self.max_v is None else self.max_v
        if self.initial_v is not None and self.initial_v > highest_v:
            raise self.wrong("initial_v", f"at most {highest_v:g}, the highest output")


class Mdt693bConfig(Mdt69xConfig, frozen=True):
    """Settings of one of three outputs; an MDT694B has only the first."""

    driver = "mdt693b"

    axis: Annotated[Literal["x", "y", "z"], Meta(description="output that drives the stage")] = "x"


class Mdt694bConfig(Mdt69xConfig, frozen=True):
    """Settings of the only output of an MDT694B."""

    driver = "mdt694b"
    model = "MDT694B"
    usb_ids = (ONE_AXIS_ID,)


def find_port(config: Mdt69xConfig, serial_number: str | None = None) -> str:
    """Return the path to open. serial_number: that of the unit to find again, if it is known.
    Raises DeviceNotFound if "auto" finds none, DriverConfigError if it finds several."""
    if config.port != "auto":
        return config.port
    found = find_usb_ports(config.usb_ids)
    wanted = config.serial_number or serial_number
    if wanted and len(found) > 1:
        found = [p for p in found if p.serial_number == wanted] or found
    if not found:
        seen = ", ".join(p.path for p in list_serial_ports()) or "none"
        raise DeviceNotFound(
            f'port = "auto": no {config.model or "MDT693B or MDT694B"} on USB (serial ports here: '
            f"{seen}); plug it in or give the port by its path"
        )
    if len(found) > 1:
        listed = ", ".join(f"{p.path} ({p.serial_number or 'no serial number'})" for p in found)
        raise DriverConfigError(f'port = "auto" finds several units: {listed}; choose one')
    return found[0].path
