"""Base classes of the drivers, and the errors for voltages outside a range."""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, ClassVar, Self

from dehyst.drivers.interface import DriverConfigError, OutOfRange, UnitIdentity
from dehyst.drivers.settings import Settings, read_settings


class Driver(ABC):
    """A driver that is made from settings of `settings_type`, and reconnects by opening again."""

    settings_type: ClassVar[type[Settings]]

    @abstractmethod
    def __init__(self, settings: Any) -> None:
        """Connect nothing."""

    @classmethod
    def from_settings(cls, settings: Mapping[str, Any]) -> Self:
        """Make a driver from its configuration table; DriverConfigError names a wrong key."""
        return cls(read_settings(cls.settings_type, settings))

    @abstractmethod
    def open(self) -> None:
        """Connect. Moves nothing."""

    def reconnect(self) -> None:
        """Connect again, and check that the same unit answers; an output does not move."""
        self.close()
        self.open()

    @abstractmethod
    def close(self) -> None:
        """Release the device; an output stays where it is. Safe to call twice."""

    @contextmanager
    def _closed_on_failure(self) -> Iterator[None]:
        """Close the device if the block raises anything, an interrupt included."""
        try:
            yield
        except BaseException:
            self.close()
            raise


class IdentifiedDriver(Driver):
    """A driver that can distinguish its unit from others. unit: the one that open() found; None
    before."""

    unit: UnitIdentity | None = None
    _known: UnitIdentity | None = None

    def expect(self, unit: UnitIdentity) -> None:
        """From now on open() and reconnect() raise ForeignUnit if a different unit answers."""
        self._known = unit


def out_of_range(who: str, volts: float, low_v: float, high_v: float) -> OutOfRange:
    """Return the error for a voltage that must not be written. who: the device."""
    return OutOfRange(f"{who}: {volts} V is outside {low_v} to {high_v} V; nothing was written")


def found_outside(who: str, stands_v: float, low_v: float, high_v: float) -> DriverConfigError:
    """Return the error for an output that is found outside the range allowed. who: the device."""
    return DriverConfigError(
        f"{who}: the output is at {stands_v:g} V, outside the {low_v:g} to {high_v:g} V allowed; "
        "bring it into that range by hand, or change the limits"
    )
