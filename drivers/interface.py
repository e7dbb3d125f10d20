"""The two small interfaces that every amplifier driver and every sensor driver implements.

DriverError                     (a DehystError: the message is for the user)
├── DriverConfigError           a setting is wrong or missing: fix the configuration
├── DeviceNotFound              no such port or device: plug it in, check the path
│   └── ForeignUnit             a different unit answers than the known one
├── DeviceTimeout               the device does not answer in time
├── DeviceGone                  it was there and is gone (unplugged): reconnect() may succeed
├── ProtocolError               it answered something that is not in its protocol
└── OutOfRange                  a value outside what the device takes; nothing was written

A driver is made from a table of settings (`from_settings`), does nothing until `open()`, and is
used by one thread. `write()` and `read()` typically take at most `spec.latency_s` and never block
longer than the driver's own time-out. A reply that arrives after its time-out is never mistaken for
the reply to the next request. A driver never clips: a value outside [spec.minimum, spec.maximum]
raises OutOfRange and leaves the output as it was. After DeviceGone, `reconnect()` restores the link
without moving the output, or raises again.

A driver whose device can be called without Python may add `direct()` (see
dehyst.drivers.direct_calls): the compiled loop then uses it.

A driver of an amplifier with several outputs on one link may add `join()`: see Joinable. One whose
unit measures its output may add `readback()`, which returns this voltage: the loop compares it with
the output that was set. One whose unit has an identity adds `unit` and `expect()`: see
Identifiable.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, Self, runtime_checkable

from dehyst.models.errors import DehystError


class DriverError(DehystError):
    """Base class of every error that a driver raises."""


class DriverConfigError(DriverError):
    """A setting is wrong or missing."""


class DeviceNotFound(DriverError):
    """There is no such port or device."""


class ForeignUnit(DeviceNotFound):
    """A different unit answers than the known one; nothing was set on it."""


class DeviceTimeout(DriverError):
    """The device did not answer in time."""


class DeviceGone(DriverError):
    """The device was there and is gone."""


class ProtocolError(DriverError):
    """The device answered something that is not in its protocol."""


class OutOfRange(DriverError):
    """The value is outside what the device takes; nothing was written."""


@dataclass(frozen=True)
class DeviceSpec:
    """What a device can do, as far as it is known after open().

    unit: "v", "um", ...; minimum, maximum, resolution: in that unit; max_rate_hz: the highest rate
    of write() or read() that this unit sustains (measured where possible); latency_s: typical
    duration of one call; identity: model, firmware, serial number; late_s: time that few calls
    exceed, 0 if unknown (latency_s is then used instead); output_known: False where the hardware
    cannot be queried, so that output() is a setting until the first write.
    """

    unit: str
    minimum: float
    maximum: float
    resolution: float
    max_rate_hz: float
    latency_s: float
    identity: str = ""
    late_s: float = 0.0
    output_known: bool = True

    @property
    def call_s(self) -> float:
        """Return the time that a loop has to reserve for one call, even a late one."""
        return max(self.late_s, self.latency_s)


@dataclass(frozen=True)
class UnitIdentity:
    """What distinguishes a unit from others of its kind.

    serial: "" if the unit has none; kind: model, and other properties that the unit reports; place:
    where it is plugged in. A serial number alone is decisive. Without one, kind and place must
    agree, and so must the output wherever it is known (see the drivers).
    """

    serial: str
    kind: str = ""
    place: str = ""

    def __str__(self) -> str:
        if self.serial:
            return f"serial number {self.serial}"
        return f"no serial number, {self.kind or 'unknown kind'}, at {self.place or '?'}"

    def is_another(self, known: "UnitIdentity") -> bool:
        """Return True if this is not the known unit."""
        return self != known if not (self.serial and known.serial) else self.serial != known.serial


def refuse_another(port: str, found: UnitIdentity, known: UnitIdentity | None) -> None:
    """Raise ForeignUnit if a different unit answers than the known one; None: none is known."""
    if known is not None and found.is_another(known):
        raise ForeignUnit(
            f"{port}: another unit is plugged in ({found}; the known one has {known}). Nothing "
            "was set on it. Put the known unit back, or accept this one with `dehyst config pin`"
        )


@runtime_checkable
class Identifiable(Protocol):
    """A device that can report which unit it is."""

    unit: UnitIdentity | None
    """The unit that open() found; None before."""

    def expect(self, unit: UnitIdentity) -> None:
        """From now on open() and reconnect() raise ForeignUnit if a different unit answers."""
        ...


@runtime_checkable
class Actuator(Protocol):
    """A voltage source: the piezo amplifier."""

    spec: DeviceSpec

    @classmethod
    def from_settings(cls, settings: Mapping[str, Any]) -> Self:
        """Make a driver from its configuration table; DriverConfigError names a wrong key."""
        ...

    def open(self) -> None:
        """Connect and learn the limits. Does not move the output."""
        ...

    def write(self, volts: float) -> None:
        """Set the output. Raises OutOfRange outside [spec.minimum, spec.maximum]."""
        ...

    def output(self) -> float:
        """Return the output voltage as far as it is known (the last write, or what the unit
        reported when it was opened)."""
        ...

    def reconnect(self) -> None:
        """After DeviceGone or DeviceTimeout: restore the link; the output does not move."""
        ...

    def close(self) -> None:
        """Release the device; the output stays where it is. Safe to call twice."""
        ...


@runtime_checkable
class Sensor(Protocol):
    """A displacement reading: the strain-gauge bridge."""

    spec: DeviceSpec

    @classmethod
    def from_settings(cls, settings: Mapping[str, Any]) -> Self:
        """Make a driver from its configuration table; DriverConfigError names a wrong key."""
        ...

    def open(self) -> None:
        """Connect. Moves nothing."""
        ...

    def read(self) -> float:
        """Take one reading in spec.unit. NaN where the device itself reports an invalid reading."""
        ...

    def reconnect(self) -> None:
        """After DeviceGone or DeviceTimeout: restore the link."""
        ...

    def close(self) -> None:
        """Release the device. Safe to call twice."""
        ...


class Joint(Protocol):
    """Several open outputs of one amplifier that share one link.

    together: `write_all` sets all of them in one command.
    """

    together: bool

    def rate_hz(self, driven: int) -> float:
        """Return the highest measured rate at which this number of outputs can be set."""
        ...

    def late_s(self, driven: int) -> float:
        """Return the time that few sets of this number of outputs exceed."""
        ...

    def write_all(self, volts: Sequence[float]) -> None:
        """Set all outputs, in their order. Raises OutOfRange before anything is written."""
        ...


@runtime_checkable
class Joinable(Protocol):
    """An actuator whose unit may have further outputs."""

    unit_key: str
    """The same string for all outputs of one unit."""

    def join(self, others: Sequence[Any]) -> Joint:
        """Combine this output and others of the same unit, all open."""
        ...
