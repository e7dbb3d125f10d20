"""Call a driver's C function from Python as the compiled loop calls it."""

import ctypes
from typing import Any

from dehyst.drivers.direct_calls import Direct
from dehyst.drivers.interface import DriverError

FUNCTION = ctypes.CFUNCTYPE(
    ctypes.c_int32, ctypes.c_void_p, ctypes.c_int64, ctypes.POINTER(ctypes.c_double)
)


def direct_of(device: Any) -> Direct:
    """Return the Direct of an open driver; it must have one."""
    direct = device.direct()
    assert direct is not None
    return direct


def write(direct: Direct, volts: float) -> DriverError | None:
    """Write a voltage; return the error that the result means, if any."""
    code = FUNCTION(direct.function)(direct.context, 0, ctypes.byref(ctypes.c_double(volts)))
    return None if code == 0 else direct.explain(code)


def read(direct: Direct) -> float | DriverError:
    """Read a value; return the error instead if the result means one."""
    value = ctypes.c_double(-1.0)
    code = FUNCTION(direct.function)(direct.context, 0, ctypes.byref(value))
    return value.value if code == 0 else direct.explain(code)
