"""The link to one APT unit on its USB serial port: requests, replies, and the unit's identity.

A rack has a bay of one channel for each output: its motherboard reports the unit's identity, and
all other requests go to its bays.

The FTDI chip holds bytes back for 16 ms unless its latency timer is set to 1 ms (the port does that
if it is allowed to; see also the udev rule).
"""

from collections.abc import Callable, Collection
from dataclasses import dataclass

from dehyst.drivers.apt.codec import HOST, UNIT, AptMessage, Decoder, encode_apt
from dehyst.drivers.interface import (
    DeviceNotFound,
    DeviceTimeout,
    ForeignUnit,
    ProtocolError,
    UnitIdentity,
    refuse_another,
)
from dehyst.drivers.serial_port import SerialPort, find_usb_ports, place_of

USB_IDS = ((0x0403, 0xFAF0),)  # FTDI with Thorlabs' product number


@dataclass(frozen=True)
class AptKind:
    """One kind of unit. driver: the name of its driver; models: the names that such units report;
    prefixes: the first digits of their serial numbers, which USB reports as well; address: where
    the unit's identity is requested; channels: the address of each of its channels."""

    driver: str
    models: tuple[str, ...]
    prefixes: tuple[str, ...]
    address: int = UNIT
    channels: tuple[int, ...] = (UNIT,)

    @property
    def addresses(self) -> tuple[int, ...]:
        """All addresses from which such a unit answers."""
        return tuple(dict.fromkeys((self.address, *self.channels)))

    def find_port(self, path: str, serial_number: str | None) -> str:
        """Return the path to open; for "auto" that of the only such unit on USB. serial_number:
        that of the unit to find, if it is known. Raises DeviceNotFound."""
        if path != "auto":
            return path
        # a port whose serial number the system does not report may belong to any unit
        ports = [
            port
            for port in find_usb_ports(USB_IDS)
            if not port.serial_number or port.serial_number.startswith(self.prefixes)
        ]
        if len(ports) > 1 and serial_number:
            ports = [port for port in ports if port.serial_number == serial_number]
        if len(ports) != 1:
            seen = ", ".join(port.path for port in ports) or "none"
            raise DeviceNotFound(
                f"{self.driver}: port = 'auto' needs one unit on USB, found {seen}"
            )
        return ports[0].path


class AptLink:
    """An open port with a unit on it; used by one thread at a time. Its calls raise DeviceTimeout,
    DeviceGone or ProtocolError. addresses: all from which the unit answers."""

    def __init__(
        self,
        path: str,
        timeout_s: float,
        rtscts: bool,
        clock: Callable[[], float],
        addresses: Collection[int] = (UNIT,),
    ) -> None:
        """Open the port and stop unsolicited updates. Raises DeviceNotFound."""
        self.timeout_s, self.rtscts = timeout_s, rtscts
        self._clock = clock
        self._decoder = Decoder((HOST,), addresses)
        self._late: set[int] = set()  # addresses where a request timed out: a late reply may follow
        self._port = SerialPort(path, write_timeout_s=timeout_s, rtscts=rtscts, clock=clock)
        try:
            for address in addresses:
                self.send("hw_stop_updatemsgs", address)
            self._port.read_available()
        except BaseException:
            self.close()
            raise

    @property
    def path(self) -> str:
        """The port's path."""
        return self._port.path

    def close(self) -> None:
        """Close the port. Safe to call twice."""
        self._port.close()

    def send(self, name: str, to: int = UNIT, **values: int) -> None:
        """Send a message that has no reply."""
        self._port.write(encode_apt(name, destination=to, **values))

    def identify(
        self, kind: AptKind, serial_number: str | None, known: UnitIdentity | None
    ) -> tuple[UnitIdentity, str]:
        """Return which unit answers, and a description of it. Raises ForeignUnit if it is of
        another kind, has a serial number other than the wanted one, or is not the known unit."""
        info = self.ask("hw_req_info", "hw_get_info", to=kind.address).values
        model = bytes(info["model"]).split(b"\0")[0].decode("ascii", "replace").strip()
        minor, interim, major, _ = bytes(info["firmware"])
        if not model.startswith(kind.models):
            raise ForeignUnit(
                f"{self.path}: the unit is a {model!r}, but the configuration asks for a "
                f"{' or '.join(kind.models)}; nothing was set on it"
            )
        number = str(info["serial_number"] or "")
        if serial_number is not None and number != serial_number:
            raise ForeignUnit(
                f"{self.path}: the unit has serial number {number!r}, but the configuration asks "
                f"for {serial_number!r}"
            )
        found = UnitIdentity(number, model, place_of(self.path))
        refuse_another(self.path, found, known)
        return found, f"{model} serial {number or 'blank'} firmware {major}.{interim}.{minor}"

    def ask(
        self, request: str, wanted: str, first: bytes = b"", to: int = UNIT, **values: int
    ) -> AptMessage:
        """Send a request and wait for its reply, at most timeout_s, ignoring other messages. first:
        messages without a reply that are sent ahead of it, in the same write."""
        deadline_s = self._clock() + self.timeout_s
        if to in self._late and wanted != "hw_get_info":
            # replies carry no number: ask for something else first, so that a late reply is not
            # mistaken for the answer to this request
            self._exchange("hw_req_info", "hw_get_info", to, deadline_s)
        return self._exchange(request, wanted, to, deadline_s, first, **values)

    def _exchange(
        self,
        request: str,
        wanted: str,
        to: int,
        deadline_s: float,
        first: bytes = b"",
        **values: int,
    ) -> AptMessage:
        port = self._port
        port.write(first + encode_apt(request, destination=to, **values))
        skipped = self._decoder.skipped
        while True:
            data = port.read_until_deadline(deadline_s)
            for message in self._decoder.feed(data):
                if message.source != to:
                    continue
                if message.name == wanted:
                    self._late.discard(to)
                    return message
                if message.name in ("hw_response", "hw_richresponse"):
                    raise ProtocolError(
                        f"{port.path}: the unit refuses {request}: {message.values}"
                    )
            if not data:
                self._decoder.reset()
                self._late.add(to)
                strange = self._decoder.skipped - skipped
                raise DeviceTimeout(
                    f"{port.path}: no answer to {request} within {self.timeout_s:g} s"
                    + (f" ({strange} bytes arrived that are not an APT message)" if strange else "")
                )
