"""The LabJack channels as C functions, for the compiled loop.

They call functions of LJM, which is thread-safe, with the handle that the driver has opened, and do
the same as LabjackActuator.write and LabjackSensor.read. The context is the record CONTEXT_T of
channel.py. Signatures, from LabJackM.h:

    int LJM_eWriteName(int Handle, const char *Name, double Value)
    int LJM_eReadNames(int Handle, int NumFrames, const char **aNames, double *aValues,
                       int *ErrorAddress)

A non-zero result is an error or a warning; the package raises for both.
"""

import ctypes
from typing import Any

from llvmlite import ir
from numba import carray, cfunc, types
from numba.extending import intrinsic
from numpy.typing import NDArray

from dehyst.drivers.analog import CLOSED, INT, NOT_IN_RANGE, call_c, explain_with, scaled_mean
from dehyst.drivers.direct_calls import SIGNATURE, Direct
from dehyst.drivers.labjack.channel import CONTEXT_T, fault_of, load_ljm

_DOUBLE = ir.DoubleType()
_BYTES = ir.IntType(8).as_pointer()


@intrinsic
def _write_name(typing: Any, function: Any, handle: Any, name: Any, volts: Any) -> Any:
    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        function, handle, name, volts = arguments
        unit, text = builder.trunc(handle, INT), builder.inttoptr(name, _BYTES)
        return call_c(builder, function, [unit, text, volts])

    return types.int32(types.int64, types.int64, types.int64, types.float64), codegen


@intrinsic
def _read_names(
    typing: Any, function: Any, handle: Any, count: Any, names: Any, samples_at: Any
) -> Any:
    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        function, handle, count, names, samples_at = arguments
        unit, number = builder.trunc(handle, INT), builder.trunc(count, INT)
        samples = builder.inttoptr(samples_at, _DOUBLE.as_pointer())
        after = builder.bitcast(builder.gep(samples, [count]), INT.as_pointer())
        texts = builder.inttoptr(names, _BYTES.as_pointer())
        return call_c(builder, function, [unit, number, texts, samples, after])

    return types.int32(types.int64, types.int64, types.int64, types.int64, types.int64), codegen


@cfunc(SIGNATURE, cache=True)
def write(context, now_ns, value):  # type: ignore[no-untyped-def]
    """Set the output to value[0], volts at the piezo."""
    c = carray(context, (1,), CONTEXT_T)[0]
    volts = value[0]
    if c.handle == 0:
        return CLOSED
    if not c.minimum <= volts <= c.maximum:
        return NOT_IN_RANGE
    status = _write_name(c.function, c.handle, c.name, volts / c.gain + c.zero)
    if status != 0:
        return status
    c.output_v = volts
    return 0


@cfunc(SIGNATURE, cache=True)
def read(context, now_ns, value):  # type: ignore[no-untyped-def]
    """Store the mean of the samples [um] in value[0]; NaN if any is out of range."""
    c = carray(context, (1,), CONTEXT_T)[0]
    shown = carray(value, (1,), types.float64)
    if c.handle == 0:
        return CLOSED
    status = _read_names(c.function, c.handle, c.count, c.name, c.samples)
    if status != 0:
        return status
    shown[0] = scaled_mean(c)
    return 0


def actuator(channel: str, context: NDArray[Any], ljm: Any) -> Direct | None:
    """Return the output of an open driver; None if it is not open."""
    return _direct(channel, context, ljm, write.address, "LJM_eWriteName")


def sensor(channel: str, context: NDArray[Any], ljm: Any) -> Direct | None:
    """Return the input of an open driver; None as in actuator."""
    return _direct(channel, context, ljm, read.address, "LJM_eReadNames")


def _direct(channel: str, context: NDArray[Any], ljm: Any, ours: int, theirs: str) -> Direct | None:
    if context["handle"][0] == 0:
        return None
    vendors = load_ljm()
    context["function"] = ctypes.cast(getattr(vendors, theirs), ctypes.c_void_p).value
    explain = explain_with(
        f"labjack {channel}", lambda code: fault_of(channel, code, str(ljm.LJMError(code)))
    )
    return Direct(ours, context.ctypes.data, explain, (context, vendors))
