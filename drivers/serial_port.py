"""A raw serial port with time limits: the only module that imports pyserial.

It converts what pyserial and the operating system raise into driver errors: no such port, no
permission, in use -> DeviceNotFound; vanished while open -> DeviceGone; a write that blocks too
long -> DeviceTimeout. Pseudo-terminals (the emulators) refuse some ioctls with OSError 25 or
ValueError; none of those is needed, so these errors are ignored.
"""

import contextlib
import errno
import os
import select
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import serial
from serial.tools import list_ports

from dehyst.drivers import system
from dehyst.drivers.interface import DeviceGone, DeviceNotFound, DeviceTimeout, DriverConfigError

READ_SIZE = 4096  # bytes that one read returns at most
CLOSED = -1  # no file has this descriptor


@dataclass(frozen=True)
class PortInfo:
    """A serial port of this machine as the operating system describes it."""

    path: str
    vendor: int | None
    product: int | None
    serial_number: str
    description: str


def list_serial_ports() -> list[PortInfo]:
    """Return all serial ports of this machine, ordered by path."""
    return sorted(
        (
            PortInfo(p.device, p.vid, p.pid, p.serial_number or "", p.description or "")
            for p in list_ports.comports()
        ),
        key=lambda info: info.path,
    )


def find_usb_ports(ids: Iterable[tuple[int, int]]) -> list[PortInfo]:
    """Return the serial ports whose USB (vendor, product) is one of `ids`."""
    wanted = set(ids)
    return [p for p in list_serial_ports() if (p.vendor, p.product) in wanted]


BY_PATH = Path("/dev/serial/by-path")


def place_of(path: str) -> str:
    """Return where a port's device is plugged in: the by-path name, which describes the route
    through hubs and sockets and survives renumbering of the ports; the device file itself if it has
    no such name."""
    real = os.path.realpath(path)
    with contextlib.suppress(OSError):
        for link in sorted(BY_PATH.iterdir()):
            if os.path.realpath(link) == real:
                return link.name
    return real


class SerialPort:
    """An open port; bytes only, no protocol. Used by one thread.

    path: e.g. /dev/ttyACM0. baud: bits per second, 8N1, no flow control (rtscts: RTS/CTS).
    write_timeout_s: longest time that one write may block. clock: the clock of all deadlines
    (time.monotonic where none is given).
    Raises DeviceNotFound when it cannot be opened, DriverConfigError for a bad baud rate.
    """

    def __init__(
        self,
        path: str,
        baud: int = 115200,
        write_timeout_s: float = 0.2,
        rtscts: bool = False,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.path = path
        self._clock = clock
        self._write_timeout_s = write_timeout_s
        try:
            # timeout=0: reads never wait; waiting is done here, with select and a deadline.
            self._serial = serial.Serial(path, baud, timeout=0, exclusive=True, rtscts=rtscts)
        except ValueError as error:
            raise DriverConfigError(f"serial port {path}: {error}") from None
        except (serial.SerialException, OSError) as error:
            raise DeviceNotFound(_why_not_open(path, error)) from None
        if system.LINUX:  # FTDI: 1 ms instead of 16 ms
            # a pseudo terminal or an older kernel has no such mode, which is not an error
            with contextlib.suppress(OSError, ValueError):
                self._serial.set_low_latency_mode(True)
        self._fd: int = self._serial.fileno()

    def write(self, data: bytes) -> None:
        """Pass all of `data` to the port. Raises DeviceTimeout when that takes longer than the
        write time-out (an unknown part of it has then been sent), DeviceGone when the port is
        gone."""
        left = memoryview(data)
        deadline_s = self._clock() + self._write_timeout_s
        while left:
            # The port is asked after the clock: a process that was held up for longer than the
            # time-out finds its port writable, and only a port that still accepts nothing hangs.
            # pyserial's own time-out looks at its clock alone and would blame the unit.
            wait_s = max(0.0, deadline_s - self._clock())
            sent = self._send(left) if self._select_writable(wait_s) else 0
            if not sent and wait_s == 0.0:
                raise self._accepts_nothing()
            left = left[sent:]

    def read_available(self) -> bytes:
        """Return what has arrived, without waiting; b"" if nothing has. Raises DeviceGone."""
        return self._read() if self._select_readable(0.0) else b""

    def read_until_deadline(self, deadline_s: float) -> bytes:
        """Wait for at least one byte until the clock reads `deadline_s`; return all bytes that are
        available, or b"" at the deadline. Raises DeviceGone."""
        while True:
            left_s = deadline_s - self._clock()
            if self._select_readable(max(0.0, left_s)):
                return self._read()
            if left_s <= 0.0:
                return b""

    def close(self) -> None:
        """Close the port. Safe to call twice and after an unplug."""
        self._fd = CLOSED  # the next file that is opened gets the old number
        with contextlib.suppress(serial.SerialException, OSError, system.TerminalError):
            self._serial.close()

    def _select_readable(self, wait_s: float) -> bool:
        return self._select([self._fd], [], wait_s)

    def _select_writable(self, wait_s: float) -> bool:
        return self._select([], [self._fd], wait_s)

    def _select(self, readable: list[int], writable: list[int], wait_s: float) -> bool:
        try:
            return any(select.select(readable, writable, [], wait_s))
        except (OSError, ValueError) as error:  # ValueError: the port is closed
            raise self._gone(error) from None

    def _send(self, data: memoryview) -> int:
        """Return how many bytes the port accepted, without waiting."""
        try:
            return os.write(self._fd, data)
        except BlockingIOError:
            return 0
        except OSError as error:
            raise self._gone(error) from None

    def _accepts_nothing(self) -> DeviceTimeout:
        with contextlib.suppress(serial.SerialException, OSError, system.TerminalError):
            self._serial.reset_output_buffer()
        return DeviceTimeout(
            f"{self.path}: the unit accepted no bytes for {self._write_timeout_s:g} s and has "
            "hung: switch it off and on, or unplug it and plug it in again"
        )

    def _read(self) -> bytes:
        try:
            data: bytes = self._serial.read(READ_SIZE)
        except (serial.SerialException, OSError, TypeError) as error:
            raise self._gone(error) from None
        return data

    def _gone(self, error: Exception) -> DeviceGone:
        return DeviceGone(
            f"{self.path}: the port has disappeared; check that the unit is plugged in ({error})"
        )


def _why_not_open(path: str, error: Exception) -> str:
    number = getattr(error, "errno", None)
    if number is None and "exclusively lock" in str(error):
        number = errno.EBUSY
    if number == errno.ENOENT or not os.path.exists(path):
        seen = [p.path for p in list_serial_ports()]
        ports = f"the serial ports here are {', '.join(seen)}" if seen else "there are none here"
        return f"there is no port {path}; {ports}"
    if number in (errno.EACCES, errno.EPERM):
        return f"no permission to open {path}: add your user to the group that owns it (dialout?)"
    if number in (errno.EBUSY, errno.EAGAIN):
        return f"{path} is in use by {_holder(path)}; only one process may hold it"
    if number in (errno.ENOTTY, errno.EINVAL) or "Could not configure" in str(error):
        return f"{path} is not a serial port"
    return f"{path} cannot be opened: {error}"


def _holder(path: str) -> str:
    """Return which process has locked a port, as far as the kernel reports it."""
    if not system.LINUX:
        return "another program"
    with contextlib.suppress(OSError, ValueError):
        port = os.stat(path)
        inode = f"{os.major(port.st_dev):02x}:{os.minor(port.st_dev):02x}:{port.st_ino}"
        for line in Path("/proc/locks").read_text("ascii").splitlines():
            words = line.split()
            if inode in words and "FLOCK" in words:
                pid = int(words[4])
                arguments = Path(f"/proc/{pid}/cmdline").read_bytes().decode("utf-8", "replace")
                return f"process {pid} ({' '.join(arguments.split(chr(0))).strip()})"
    return "another program"
