"""A channel of an IIO device: its file of raw counts, kept open, and its scale and offset.

    path/name, path/in_voltage0_raw (or in_voltage0-voltage1_raw), ..._scale, ..._offset
    path/out_voltage0_raw, ..._scale, ..._offset

The voltage in millivolts is (raw + offset) x scale, according to the kernel's ABI document
(Documentation/ABI/testing/sysfs-bus-iio). Each read from the start of the file triggers one
conversion, each write to it sets the output; both work on a file that stays open.
"""

import errno
import os
import re
from pathlib import Path

import numpy as np

from dehyst.drivers.interface import (
    DeviceGone,
    DeviceNotFound,
    DeviceTimeout,
    DriverError,
    ProtocolError,
)

TEXT_BYTES = 64
"""Bytes read of a file: more than the longest number with its line end."""
NUMBER = re.compile(rb" *([+-]?[0-9]{1,18}) *(?:[\n\0]|\Z)")
REFUSED = (errno.EINVAL, errno.ERANGE, errno.EOVERFLOW)

CONTEXT_T = np.dtype(
    [
        ("file", np.int64),  # descriptor of the open file of raw counts; -1 while closed
        ("offset", np.float64),
        ("scale_mv", np.float64),  # millivolts per count
        ("gain", np.float64),  # um per mV, or piezo volts per volt
        ("zero_mv", np.float64),
        ("low", np.int64),  # lowest and highest counts that are read or may be written
        ("high", np.int64),
        ("minimum_v", np.float64),  # what may be written
        ("maximum_v", np.float64),
        ("output_v", np.float64),  # the last voltage written, by either loop
        ("size", np.int64),  # length in bytes of the text read last
        ("text", np.uint8, (TEXT_BYTES,)),
    ]
)
"""Channel data that both loops share; iio/direct_calls.py works on it."""


def fault_of(file: Path, number: int) -> DriverError:
    """Return the error for an errno from reading or writing a channel's file."""
    if number == errno.ETIMEDOUT:  # the kernel driver's wait for the converter timed out
        return DeviceTimeout(f"iio: {file}: the converter did not finish in time")
    kind = ProtocolError if number in REFUSED else DeviceGone
    return kind(f"iio: {file}: {os.strerror(number)}")


def counts_in(file: Path, text: bytes) -> int:
    """Return the number at the start of a file's text. Raises DeviceGone if the file is empty,
    ProtocolError if the text is not a number."""
    if not text:
        raise DeviceGone(f"iio: {file} is empty")
    found = NUMBER.match(text)
    if found is None:
        said = text.decode("latin-1")
        raise ProtocolError(f"iio: {file} contains {said!r}, which is not a number")
    return int(found.group(1))


class Channel:
    """A channel of a device. direction: "in" or "out"; name: e.g. "voltage0"; context: (1,) of
    CONTEXT_T."""

    def __init__(self, path: str, direction: str, name: str) -> None:
        self.folder = Path(path)
        self.direction = direction
        self.name = name
        self.file = self.folder / f"{direction}_{name}_raw"
        self.context = np.zeros(1, CONTEXT_T)
        self.context["file"] = -1

    @property
    def is_open(self) -> bool:
        """Whether the file is open."""
        return bool(self.context["file"][0] >= 0)

    def open(self) -> None:
        """Find and open the file of raw counts. Moves nothing."""
        if not self.folder.is_dir():
            raise DeviceNotFound(
                f"iio: there is no device {self.folder}; see `ls /sys/bus/iio/devices`"
            )
        if not self.file.is_file():
            found = self.folder.glob(f"{self.direction}_*_raw")
            seen = sorted(p.name[len(self.direction) + 1 : -4] for p in found)
            raise DeviceNotFound(
                f"iio: there is no {self.file}; channels here: {', '.join(seen) or 'none'}"
            )
        access = os.O_RDONLY if self.direction == "in" else os.O_RDWR
        try:
            self.context["file"] = os.open(self.file, access | os.O_CLOEXEC)
        except OSError as error:
            raise DeviceNotFound(f"iio: {self.file}: {error.strerror}") from None

    def close(self) -> None:
        """Close the file. Safe to call twice."""
        if self.is_open:
            file = int(self.context["file"][0])
            self.context["file"] = -1
            os.close(file)

    def read_counts(self) -> int:
        """Run one conversion, or read the present counts of an output."""
        try:
            text = os.pread(self._ready(), TEXT_BYTES, 0)
        except OSError as error:
            raise fault_of(self.file, error.errno or 0) from None
        return counts_in(self.file, text)

    def write_counts(self, counts: int) -> None:
        """Set an output to these counts."""
        try:
            os.pwrite(self._ready(), b"%d\n" % counts, 0)
        except OSError as error:
            raise fault_of(self.file, error.errno or 0) from None

    def attribute(self, name: str) -> float | None:
        """Return the channel's own attribute, or that of its kind; None if there is neither."""
        found = re.match("[a-z]+", self.name)
        kind = found.group() if found else "voltage"
        for owner in (self.name, kind, f"{kind}-{kind}"):
            file = self.folder / f"{self.direction}_{owner}_{name}"
            text = self.text(file)
            if text is None:
                continue
            try:
                return float(text)
            except ValueError:
                raise ProtocolError(
                    f"iio: {file} contains {text!r}, which is not a number"
                ) from None
        return None

    def text(self, file: Path) -> str | None:
        """Return the text of a file; None if it does not exist."""
        try:
            return file.read_text().strip()
        except OSError:
            return None

    def identity(self) -> str:
        """Return device and channel, for the log."""
        return f"IIO {self.text(self.folder / 'name') or 'unnamed'} {self.name}"

    def _ready(self) -> int:
        if not self.is_open:
            raise DeviceGone(f"iio: {self.file} is not open")
        return int(self.context["file"][0])


def count_range(bits: int, unsigned: bool) -> tuple[int, int]:
    """Return the smallest and largest counts of a converter."""
    if unsigned:
        return 0, 2**bits - 1
    return -(2 ** (bits - 1)), 2 ** (bits - 1) - 1
