"""The IIO channels as C functions, for the compiled loop: pread and pwrite on the open file.

They do what IioSensor.read and IioActuator.write do. The context is the record CONTEXT_T of
channel.py; a file's text is stored in the channel's own `text`, so that nothing is allocated. A
result above 0 is an errno, one below 0 is a code of this file.
"""

import errno
import math
from collections.abc import Callable

import numpy as np
from numba import carray, cfunc, njit, types

from dehyst.drivers.direct_calls import SIGNATURE, Direct
from dehyst.drivers.iio.channel import CONTEXT_T, TEXT_BYTES, Channel, counts_in, fault_of
from dehyst.drivers.interface import DeviceGone, DriverError, OutOfRange, ProtocolError
from dehyst.models.addresses import Words, pointer

CLOSED, NO_NUMBER, EMPTY, NOT_IN_RANGE = -1, -2, -3, -4
MOST_DIGITS = 18
INTERRUPTIONS = 16  # signals that may interrupt a call before it is given up
SPACE, PLUS, MINUS, ZERO, NINE, NEWLINE = 32, 43, 45, 48, 57, 10

_pread = types.ExternalFunction(
    "pread", types.int64(types.int32, types.uintp, types.uint64, types.int64)
)
_pwrite = types.ExternalFunction(
    "pwrite", types.int64(types.int32, types.uintp, types.uint64, types.int64)
)
_errno_at = types.ExternalFunction("__errno_location", types.uintp())


@njit(cache=True, nogil=True)
def _errno() -> int:
    return carray(pointer(np.int64(_errno_at())), (1,), types.int32)[0]


@njit(cache=True, nogil=True)
def _parse(text: Words, size: int) -> tuple[int, int]:
    """Return (0 or NO_NUMBER, the number) at the start of the text, as channel.NUMBER parses it."""
    at = 0
    while at < size and text[at] == SPACE:
        at += 1
    sign = -1 if at < size and text[at] == MINUS else 1
    if at < size and (text[at] == MINUS or text[at] == PLUS):
        at += 1
    digits, number = 0, 0
    while at < size and ZERO <= text[at] <= NINE:
        number = 10 * number + text[at] - ZERO
        digits += 1
        at += 1
        if digits > MOST_DIGITS:
            return NO_NUMBER, 0
    while at < size and text[at] == SPACE:
        at += 1
    if digits == 0 or (at < size and text[at] != NEWLINE and text[at] != 0):
        return NO_NUMBER, 0
    return 0, sign * number


@njit(cache=True, nogil=True)
def _format(text: Words, number: int) -> int:
    """Write the number and a newline into the text; return the number of bytes."""
    size, left = 0, abs(number)
    while left > 0 or size == 0:  # the digits, last one first
        text[size] = ZERO + left % 10
        left //= 10
        size += 1
    if number < 0:
        text[size] = MINUS
        size += 1
    for i in range(size // 2):
        text[i], text[size - 1 - i] = text[size - 1 - i], text[i]
    text[size] = NEWLINE
    return size + 1


@cfunc(SIGNATURE, cache=True)
def read(context, now_ns, value):  # type: ignore[no-untyped-def]
    """Store one reading [um] in value[0]; NaN if the converter is at an end of its range."""
    c = carray(context, (1,), CONTEXT_T)[0]
    shown = carray(value, (1,), types.float64)
    if c.file < 0:
        return CLOSED
    size = -1
    for _ in range(INTERRUPTIONS):
        size = _pread(c.file, c.text.ctypes.data, TEXT_BYTES, 0)
        if size >= 0 or _errno() != errno.EINTR:
            break
    if size <= 0:
        return _errno() if size < 0 else EMPTY
    c.size = size
    code, counts = _parse(c.text, size)
    if code != 0:
        return code
    inside = c.low < counts < c.high
    um = ((counts + c.offset) * c.scale_mv - c.zero_mv) * c.gain
    shown[0] = um if inside else math.nan
    return 0


@cfunc(SIGNATURE, cache=True)
def write(context, now_ns, value):  # type: ignore[no-untyped-def]
    """Set the output to value[0], volts at the piezo."""
    c = carray(context, (1,), CONTEXT_T)[0]
    volts = value[0]
    if c.file < 0:
        return CLOSED
    if not c.minimum_v <= volts <= c.maximum_v:
        return NOT_IN_RANGE
    exact = np.rint(volts / c.gain * 1000.0 / c.scale_mv - c.offset)
    size = _format(c.text, int(min(max(exact, float(c.low)), float(c.high))))
    for _ in range(INTERRUPTIONS):
        if _pwrite(c.file, c.text.ctypes.data, size, 0) >= 0:
            c.output_v = volts
            return 0
        if _errno() != errno.EINTR:
            break
    return _errno()


def sensor(channel: Channel) -> Direct:
    """Return the input of an open driver."""
    return _direct(channel, read.address)


def actuator(channel: Channel) -> Direct:
    """Return the output of an open driver."""
    return _direct(channel, write.address)


def _direct(channel: Channel, function: int) -> Direct:
    return Direct(function, channel.context.ctypes.data, _explain(channel), (channel,))


def _explain(channel: Channel) -> Callable[[int], DriverError]:
    def explain(code: int) -> DriverError:
        if code > 0:
            return fault_of(channel.file, code)
        if code == CLOSED:
            return DeviceGone(f"iio: {channel.file} is not open")
        if code == NOT_IN_RANGE:
            return OutOfRange(
                f"iio: the value is outside the range of {channel.file}; nothing was written"
            )
        c = channel.context[0]
        text = b"" if code == EMPTY else c["text"].tobytes()[: c["size"]]
        try:
            counts_in(channel.file, text)
        except DriverError as error:
            return error
        return ProtocolError(f"iio: {channel.file} contained something that is not a number")

    return explain
