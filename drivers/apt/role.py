"""What the amplifier and the gauge of an APT unit have in common: both use one of its channels."""

import time
from collections.abc import Callable
from typing import Any, ClassVar

from dehyst.drivers.apt.channel import AptChannel
from dehyst.drivers.apt.link import AptKind
from dehyst.drivers.apt.settings import AptSettings
from dehyst.drivers.driver import IdentifiedDriver


class AptRole(IdentifiedDriver):
    """One role of one channel of a unit of `kind`."""

    kind: ClassVar[AptKind]
    settings_type: ClassVar[type[AptSettings]]

    def __init__(self, settings: Any, clock: Callable[[], float] = time.monotonic) -> None:
        self.settings = settings
        self._clock = clock
        self._channel = AptChannel(self.kind, settings, clock, self.number)

    @property
    def number(self) -> int:
        """The channel's number, from 1."""
        return 1

    def close(self) -> None:
        """Close the port; an output stays where it is. Safe to call twice."""
        self._channel.close()

    def _check_channel(self, channel: AptChannel) -> None:
        """Raise DriverConfigError if the unit has no such channel."""

    def _more_words(self) -> str:
        """Return which channel this is, for the identity; "" if the unit has only one."""
        return ""
