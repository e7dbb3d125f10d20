"""A driver's C function called as the compiled loop calls it, from Python."""

import ctypes
from typing import Any

from dehyst.drivers.direct_calls import Direct
from dehyst.drivers.interface import DriverError

FUNCTION = ctypes.CFUNCTYPE(
    ctypes.c_int32, ctypes.c_void_p, ctypes.c_int64, ctypes.POINTER(ctypes.c_double)
)


def direct_of(device: Any) -> Direct:
    """What an open driver offers; it must offer something."""
    direct = device.direct()
    assert direct is not None
    return direct


def write(direct: Direct, volts: float) -> DriverError | None:
    """Write; the error that the result stands for."""
    code = FUNCTION(direct.function)(direct.context, 0, ctypes.byref(ctypes.c_double(volts)))
    return None if code == 0 else direct.explain(code)


def read(direct: Direct) -> float | DriverError:
    """Read; the error that the result stands for in place of a value."""
    value = ctypes.c_double(-1.0)
    code = FUNCTION(direct.function)(direct.context, 0, ctypes.byref(value))
    return value.value if code == 0 else direct.explain(code)
