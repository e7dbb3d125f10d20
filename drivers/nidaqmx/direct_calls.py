"""The NI-DAQmx channels as C functions, for the compiled loop.

They call functions of the vendor's C library with the handle of the task that the driver has
opened, and do the same as NidaqmxActuator.write and NidaqmxSensor.read. The context is the record
CONTEXT_T of channel.py. Signatures, from NIDAQmx.h:

    int32 DAQmxWriteAnalogScalarF64(TaskHandle, bool32 autoStart, float64 timeout, float64, bool32*)
    int32 DAQmxReadAnalogScalarF64(TaskHandle, float64 timeout, float64 *value, bool32*)
    int32 DAQmxReadAnalogF64(TaskHandle, int32 samples, float64 timeout, bool32 fillMode,
                             float64 *read, uInt32 room, int32 *samplesRead, bool32*)

A result below 0 is an error, one above 0 a warning.
"""

import ctypes
import math
from ctypes.util import find_library
from typing import Any

from llvmlite import ir
from numba import carray, cfunc, types
from numba.extending import intrinsic
from numpy.typing import NDArray

from dehyst.drivers.analog import CLOSED, INT, NOT_IN_RANGE, call_c, explain_with, scaled_mean
from dehyst.drivers.direct_calls import SIGNATURE, Direct
from dehyst.drivers.interface import DriverError
from dehyst.drivers.nidaqmx.channel import CONTEXT_T, fault_of

TEXT_BYTES = 2048  # of a description of an error: the size in NI's examples

_DOUBLE = ir.DoubleType()
_BYTES = ir.IntType(8).as_pointer()


@intrinsic
def _write_scalar(typing: Any, function: Any, task: Any, timeout_s: Any, volts: Any) -> Any:
    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        function, task, timeout_s, volts = arguments
        handle, nothing = builder.inttoptr(task, _BYTES), ir.Constant(_BYTES, None)
        auto_start = ir.Constant(INT, 1)
        return call_c(builder, function, [handle, auto_start, timeout_s, volts, nothing])

    return types.int32(types.int64, types.int64, types.float64, types.float64), codegen


@intrinsic
def _read_scalar(typing: Any, function: Any, task: Any, timeout_s: Any, value_at: Any) -> Any:
    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        function, task, timeout_s, value_at = arguments
        handle, nothing = builder.inttoptr(task, _BYTES), ir.Constant(_BYTES, None)
        value = builder.inttoptr(value_at, _DOUBLE.as_pointer())
        return call_c(builder, function, [handle, timeout_s, value, nothing])

    return types.int32(types.int64, types.int64, types.float64, types.int64), codegen


@intrinsic
def _read_many(
    typing: Any, function: Any, task: Any, count: Any, timeout_s: Any, samples_at: Any
) -> Any:
    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        function, task, count, timeout_s, samples_at = arguments
        handle, nothing = builder.inttoptr(task, _BYTES), ir.Constant(_BYTES, None)
        number, by_channel = builder.trunc(count, INT), ir.Constant(INT, 0)
        samples = builder.inttoptr(samples_at, _DOUBLE.as_pointer())
        after = builder.bitcast(builder.gep(samples, [count]), INT.as_pointer())
        return call_c(
            builder,
            function,
            [handle, number, timeout_s, by_channel, samples, number, after, nothing],
        )

    kinds = (types.int64, types.int64, types.int64, types.float64, types.int64)
    return types.int32(*kinds), codegen


@cfunc(SIGNATURE, cache=True)
def write(context, now_ns, value):  # type: ignore[no-untyped-def]
    """Set the output to value[0], volts at the piezo."""
    c = carray(context, (1,), CONTEXT_T)[0]
    volts = value[0]
    if c.task == 0:
        return CLOSED
    if not c.minimum <= volts <= c.maximum:
        return NOT_IN_RANGE
    status = _write_scalar(c.function, c.task, c.timeout_s, volts / c.gain + c.zero)
    if status < 0:
        return status
    c.output_v = volts
    return 0


@cfunc(SIGNATURE, cache=True)
def read(context, now_ns, value):  # type: ignore[no-untyped-def]
    """Store one reading [um] in value[0]; NaN if the input is out of its range."""
    c = carray(context, (1,), CONTEXT_T)[0]
    shown = carray(value, (1,), types.float64)
    if c.task == 0:
        return CLOSED
    status = _read_scalar(c.function, c.task, c.timeout_s, shown.ctypes.data)
    if status < 0:
        return status
    found = shown[0]
    shown[0] = (found - c.zero) * c.gain if c.minimum <= found <= c.maximum else math.nan
    return 0


@cfunc(SIGNATURE, cache=True)
def read_mean(context, now_ns, value):  # type: ignore[no-untyped-def]
    """Store the mean of several samples [um] in value[0]; NaN if any is out of range."""
    c = carray(context, (1,), CONTEXT_T)[0]
    shown = carray(value, (1,), types.float64)
    if c.task == 0:
        return CLOSED
    status = _read_many(c.function, c.task, c.count, c.timeout_s, c.samples)
    if status < 0:
        return status
    shown[0] = scaled_mean(c)
    return 0


def actuator(channel: str, context: NDArray[Any]) -> Direct | None:
    """Return the output of an open driver; None if the C library or its task is missing."""
    return _direct(channel, context, write.address, "DAQmxWriteAnalogScalarF64")


def sensor(channel: str, context: NDArray[Any]) -> Direct | None:
    """Return the input of an open driver; None as in actuator."""
    if context["count"][0]:
        return _direct(channel, context, read_mean.address, "DAQmxReadAnalogF64")
    return _direct(channel, context, read.address, "DAQmxReadAnalogScalarF64")


def _direct(channel: str, context: NDArray[Any], ours: int, theirs: str) -> Direct | None:
    name = find_library("nidaqmx")
    if name is None or context["task"][0] == 0:
        return None
    library = ctypes.CDLL(name)
    context["function"] = ctypes.cast(getattr(library, theirs), ctypes.c_void_p).value

    def vendors_fault(code: int) -> DriverError:
        text = ctypes.create_string_buffer(TEXT_BYTES)
        library.DAQmxGetErrorString(ctypes.c_int32(code), text, ctypes.c_uint32(TEXT_BYTES))
        words = text.value.decode("utf-8", "replace") or "no description"
        return fault_of(channel, code, f"{words} (status code {code})")

    explain = explain_with(f"nidaqmx {channel}", vendors_fault)
    return Direct(ours, context.ctypes.data, explain, (context, library))
