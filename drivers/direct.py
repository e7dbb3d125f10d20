"""Devices that a compiled loop can call: a C function, a context, and nothing of Python.

A driver that can be reached this way has a method `direct()` that returns a Direct (or None
where the present settings do not allow it). Both kinds of device use one signature:

    int32_t call(void *context, int64_t now_ns, double *value)

An actuator takes *value (volts, already within its range), a sensor fills it. now_ns is the
loop's CLOCK_MONOTONIC. The result is 0, or a code that Direct.meaning turns into words; the loop
then goes to its fault state, and `reconnect()` is called by a thread as with any other driver.
The call must not block longer than the period, must not allocate and must not raise. A vendor's
C library fits behind a few lines of C or a numba `cfunc`.

The rest is how compiled code finds arrays by address: a table of (address, rows, columns), made
with `Addresses`, so that one small array stands for many and each of them may be exchanged.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

import numpy as np
from llvmlite import ir
from numba import carray, njit, types
from numba.extending import intrinsic
from numpy.typing import NDArray

Words = NDArray[np.int64]


@dataclass(frozen=True)
class Direct:
    """A device's C function and its context, as addresses; keep: what they point into."""

    function: int
    context: int
    meaning: Mapping[int, str] = field(default_factory=dict)
    keep: tuple[Any, ...] = ()

    def words(self, code: int) -> str:
        """What a call's result means."""
        return self.meaning.get(code, f"the driver's function returned {code}")


@runtime_checkable
class Reachable(Protocol):
    """A driver that compiled code may be able to call; ask after open()."""

    def direct(self) -> Direct | None:
        """The function, or None where only Python reaches the device."""
        ...


class Addresses:
    """Arrays by address: `words` is (3 n,) int64, [address, rows, columns] for each place.

    The arrays are kept alive; they must be C-contiguous and stay where they are.
    """

    def __init__(self, places: int) -> None:
        self.words: Words = np.zeros(3 * places, np.int64)
        self.kept: dict[int, NDArray[Any]] = {}

    def put(self, place: int, array: NDArray[Any]) -> None:
        """Let a place stand for `array`, one- or two-dimensional."""
        if not array.flags.c_contiguous or array.ndim not in (1, 2):
            raise ValueError(f"place {place}: a C-contiguous array of one or two dimensions")
        self.kept[place] = array
        columns = array.shape[1] if array.ndim == 2 else 1
        self.words[3 * place : 3 * place + 3] = array.ctypes.data, array.shape[0], columns

    @property
    def address(self) -> int:
        """Where the table itself is."""
        return int(self.words.ctypes.data)


@intrinsic
def pointer(typing: Any, address: Any) -> Any:
    """An address as a void pointer."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], context.get_value_type(types.voidptr))

    return types.voidptr(types.int64), codegen


@intrinsic
def call(typing: Any, function: Any, context_address: Any, now_ns: Any, value_address: Any) -> Any:
    """Call a Direct's function: its result."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        word, byte = ir.IntType(64), ir.IntType(8).as_pointer()
        kind = ir.FunctionType(ir.IntType(32), [byte, word, ir.DoubleType().as_pointer()])
        target = builder.inttoptr(arguments[0], kind.as_pointer())
        where = builder.inttoptr(arguments[1], byte)
        value = builder.inttoptr(arguments[3], ir.DoubleType().as_pointer())
        return builder.call(target, [where, arguments[2], value])

    return types.int32(types.int64, types.int64, types.int64, types.int64), codegen


@njit(cache=True, nogil=True)
def table_at(address: int, places: int) -> Words:
    """The table at an address."""
    return carray(pointer(address), (3 * places,), types.int64)


@njit(cache=True, nogil=True)
def floats_at(table: Words, place: int) -> NDArray[np.float64]:
    """The (n,) float array at a place."""
    return carray(pointer(table[3 * place]), (table[3 * place + 1],), types.float64)


@njit(cache=True, nogil=True)
def grid_at(table: Words, place: int) -> NDArray[np.float64]:
    """The (n, m) float array at a place."""
    shape = (table[3 * place + 1], table[3 * place + 2])
    return carray(pointer(table[3 * place]), shape, types.float64)


@njit(cache=True, nogil=True)
def whole_at(table: Words, place: int) -> Words:
    """The (n,) integer array at a place."""
    return carray(pointer(table[3 * place]), (table[3 * place + 1],), types.int64)


@njit(cache=True, nogil=True)
def whole_grid_at(table: Words, place: int) -> NDArray[np.int64]:
    """The (n, m) integer array at a place."""
    shape = (table[3 * place + 1], table[3 * place + 2])
    return carray(pointer(table[3 * place]), shape, types.int64)
