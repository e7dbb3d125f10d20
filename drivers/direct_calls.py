"""Devices that a compiled loop can call: a C function and a context, without any Python.

A driver that can be reached this way has a method `direct()` that returns a Direct (or None if the
present settings do not allow it). Both kinds of device use one signature:

    int32_t call(void *context, int64_t now_ns, double *value)

An actuator takes *value (volts, already within its range), a sensor fills it. now_ns is the loop's
CLOCK_MONOTONIC. The result is 0, or a code that Direct.explain turns into the error that the
driver's Python call would have raised; the loop then goes to its fault state, and `reconnect()` is
called by a thread as with any other driver. The call must not block longer than the period, must
not allocate and must not raise. A few lines of C or a numba `cfunc` suffice to wrap a vendor's C
library.

Compiled code finds its arrays by address: see dehyst.models.addresses.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from dehyst.drivers.interface import DriverError

SIGNATURE = types.int32(types.voidptr, types.int64, types.CPointer(types.float64))
"""The signature of every such function, for numba's `cfunc`."""


@dataclass(frozen=True)
class Direct:
    """A device's C function and its context, as addresses. explain: returns the error that a
    non-zero result means, called in Python afterwards; keep: the objects that the addresses point
    into."""

    function: int
    context: int
    explain: Callable[[int], DriverError]
    keep: tuple[Any, ...] = ()


@runtime_checkable
class Reachable(Protocol):
    """A driver that compiled code may be able to call; call direct() only after open()."""

    def direct(self) -> Direct | None:
        """Return the function, or None if only Python can reach the device."""
        ...


@intrinsic
def call(typing: Any, function: Any, context_address: Any, now_ns: Any, value_address: Any) -> Any:
    """Call a Direct's function and return its result."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        word, byte = ir.IntType(64), ir.IntType(8).as_pointer()
        kind = ir.FunctionType(ir.IntType(32), [byte, word, ir.DoubleType().as_pointer()])
        target = builder.inttoptr(arguments[0], kind.as_pointer())
        where = builder.inttoptr(arguments[1], byte)
        value = builder.inttoptr(arguments[3], ir.DoubleType().as_pointer())
        return builder.call(target, [where, arguments[2], value])

    return types.int32(types.int64, types.int64, types.int64, types.int64), codegen
