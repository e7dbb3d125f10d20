"""System calls for compiled code, without the interpreter: clock, absolute sleep, thread counters.

The functions are called by name (numba's ExternalFunction), so that kernels that use them can be
cached on disk. `buffer` is the caller's integer array of at least 32 words.
"""

import os
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from numba import njit, types
from numpy.typing import NDArray

from dehyst.daemon import clock
from dehyst.models.addresses import Words

NS = 1_000_000_000
_RUSAGE_THREAD = 1
_MINOR, _MAJOR, _VOLUNTARY, _INVOLUNTARY = 8, 9, 16, 17  # words of struct rusage
TEXT = 18  # words of the buffer from here on hold text
_TEXT_BYTES = 8 * 14

_nanosleep = types.ExternalFunction(
    "clock_nanosleep", types.int32(types.int32, types.int32, types.uintp, types.uintp)
)
_gettime = types.ExternalFunction("clock_gettime", types.int32(types.int32, types.uintp))
_getrusage = types.ExternalFunction("getrusage", types.int32(types.int32, types.uintp))
_pread = types.ExternalFunction(
    "pread", types.int64(types.int32, types.uintp, types.uint64, types.int64)
)
_getcpu = types.ExternalFunction("sched_getcpu", types.int32())


@njit(cache=True, nogil=True)
def read_clock_ns(buffer: Words) -> int:
    """Return CLOCK_MONOTONIC [ns]."""
    _gettime(1, buffer.ctypes.data)
    return buffer[0] * NS + buffer[1]


@njit(cache=True, nogil=True)
def sleep_until_ns(buffer: Words, deadline_ns: int) -> None:
    """Sleep until CLOCK_MONOTONIC reaches the deadline, or a signal arrives."""
    buffer[0], buffer[1] = deadline_ns // NS, deadline_ns % NS
    _nanosleep(1, 1, buffer.ctypes.data, 0)


def sleeper() -> Callable[[int], int]:
    """Return a function, for one thread, that sleeps until CLOCK_MONOTONIC reaches its argument or
    a signal arrives, and returns the time [ns]."""
    buffer = np.zeros(32, np.int64)

    def sleep_until(deadline_ns: int) -> int:
        sleep_until_ns(buffer, deadline_ns)
        return clock.monotonic_ns()

    return sleep_until


@njit(cache=True, nogil=True)
def usage(buffer: Words) -> tuple[int, int, int, int]:
    """Return (major faults, minor faults, voluntary, involuntary switches) of this thread."""
    _getrusage(_RUSAGE_THREAD, buffer.ctypes.data)
    return buffer[_MAJOR], buffer[_MINOR], buffer[_VOLUNTARY], buffer[_INVOLUNTARY]


@njit(cache=True, nogil=True)
def read_proc_number(buffer: Words, file: int, column: int) -> int:
    """Return the number in a column (words count) of a /proc file's first line; -1: unreadable."""
    if file < 0:
        return -1
    size = _pread(file, buffer[TEXT:].ctypes.data, _TEXT_BYTES, 0)
    value, at, inside = -1, -1, False
    for i in range(size):
        byte = (buffer[TEXT + i // 8] >> (8 * (i % 8))) & 255
        if byte == 10:
            break
        if byte == 32:
            inside = False
            continue
        if not inside:
            inside = True
            at += 1
            if at > column:
                break
            value = 0 if at == column else -1
        if at == column and 48 <= byte <= 57:
            value = 10 * value + byte - 48
    return value


@njit(cache=True, nogil=True)
def waited_ns(buffer: Words, schedstat: int) -> int:
    """Return how long this thread has been ready without a CPU [ns]; 0 where it is unknown."""
    return max(0, read_proc_number(buffer, schedstat, 1))


@njit(cache=True, nogil=True)
def cpu() -> int:
    """Return the CPU on which this thread runs."""
    return _getcpu()


def open_schedstat() -> int:
    """Open the calling thread's schedstat and return it; -1 where the kernel has none."""
    try:
        return os.open(
            f"/proc/self/task/{threading.get_native_id()}/schedstat", os.O_RDONLY | os.O_CLOEXEC
        )
    except OSError:
        return -1


@contextmanager
def schedstat_for(meters: Sequence[NDArray[Any]]) -> Iterator[None]:
    """Put the calling thread's open schedstat in each of these meters during the block."""
    opened = open_schedstat()
    for meter in meters:
        meter["schedstat"] = opened
    try:
        yield
    finally:
        for meter in meters:
            meter["schedstat"] = -1
        if opened >= 0:
            os.close(opened)


def open_stat() -> int:
    """Open /proc/stat and return it; -1: none. Column 8 of its first line is the steal time."""
    try:
        return os.open("/proc/stat", os.O_RDONLY | os.O_CLOEXEC)
    except OSError:
        return -1
