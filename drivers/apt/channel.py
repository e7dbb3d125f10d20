"""A channel of an APT unit. All roles of all channels of one unit share its port."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from dehyst.drivers.apt.codec import AptMessage, encode_apt
from dehyst.drivers.apt.link import AptKind, AptLink
from dehyst.drivers.apt.settings import AptSettings
from dehyst.drivers.interface import DeviceGone, DriverConfigError, UnitIdentity
from dehyst.drivers.shared import Shared, shared_by


class AptChannel:
    """One channel in one role, by its number from 1. Its calls raise DeviceTimeout, DeviceGone or
    ProtocolError; calls of the other roles wait until the current one is done."""

    def __init__(
        self, kind: AptKind, settings: AptSettings, clock: Callable[[], float], number: int = 1
    ) -> None:
        self._kind, self._settings, self._clock = kind, settings, clock
        self._address = kind.channels[number - 1]
        self._shared: Shared | None = None
        self._link: AptLink | None = None

    @property
    def path(self) -> str:
        """The port's path; the configured one while it is not open."""
        return self._link.path if self._link is not None else self._settings.port

    @property
    def is_open(self) -> bool:
        """Whether connect() has succeeded and close() has not been called since."""
        return self._link is not None

    def connect(self, known: UnitIdentity | None) -> None:
        """Open the port, or share it if it is open. Raises DeviceNotFound, and DriverConfigError if
        the roles give different values to a setting of the port that they share."""
        settings, kind = self._settings, self._kind
        wanted = settings.serial_number or (known.serial if known else None)
        path = kind.find_port(settings.port, wanted)

        def make() -> AptLink:
            times = settings.timeout_s, settings.rtscts, self._clock
            return AptLink(path, *times, kind.addresses)

        self._shared = shared_by(repr(("apt", os.path.realpath(path))), make, AptLink.close)
        link: AptLink = self._shared.connect(id(self), make)
        self._link = link
        if (link.timeout_s, link.rtscts) != (settings.timeout_s, settings.rtscts):
            self.close()
            raise DriverConfigError(
                f"{path}: the outputs and gauges of one unit share its port; give them the same "
                "timeout_s and rtscts"
            )

    def identify(self, known: UnitIdentity | None) -> tuple[UnitIdentity, str]:
        """Identify the unit, as AptLink.identify does."""
        with self._in_use() as link:
            return link.identify(self._kind, self._settings.serial_number, known)

    def encode(self, name: str, **values: int) -> bytes:
        """Return the bytes of a message to this channel."""
        return encode_apt(name, destination=self._address, chan=1, **values)

    def send(self, name: str, **values: int) -> None:
        """Send this channel a message that has no reply."""
        with self._in_use() as link:
            link.send(name, self._address, chan=1, **values)

    def ask(
        self, request: str, wanted: str, first: bytes = b"", to: int | None = None, **values: int
    ) -> AptMessage:
        """Ask as AptLink.ask does, adding the channel's number; to another address, send `values`
        alone."""
        if to is None:
            to, values = self._address, {"chan": 1, **values}
        with self._in_use() as link:
            return link.ask(request, wanted, first, to, **values)

    def close(self) -> None:
        """Stop using the port; the last role closes it. Safe to call twice."""
        self._link = None
        if self._shared is not None:
            self._shared.release(id(self))

    @contextmanager
    def _in_use(self) -> Iterator[AptLink]:
        """Yield the link, for one call at a time; if its port is gone, drop it for all roles."""
        shared, link = self._shared, self._link
        if shared is None or link is None:
            raise DeviceGone(f"{self._kind.driver} at {self._settings.port} is not open")
        with shared.calls:
            try:
                yield link
            except DeviceGone:
                shared.drop(link)
                raise
