"""Shared parts of the drivers of analog outputs and inputs: the voltage range that the EXT input
can reach, the scale of a reading, and calls of a vendor's C function from compiled code."""

import math
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from llvmlite import ir
from numba import carray, njit, types

from dehyst.drivers.interface import DeviceGone, DriverConfigError, DriverError, OutOfRange
from dehyst.models.addresses import pointer

INT = ir.IntType(32)
CLOSED, NOT_IN_RANGE = 1, 2  # results of the compiled functions, next to the vendor's own


class OutputRange(Protocol):
    """The settings of an analog output into the amplifier's EXT input."""

    @property
    def gain(self) -> float: ...
    @property
    def zero_v(self) -> float: ...
    @property
    def min_v(self) -> float: ...
    @property
    def max_v(self) -> float: ...
    @property
    def device_min_v(self) -> float: ...
    @property
    def device_max_v(self) -> float: ...

    def wrong(self, key: str, allowed: str) -> DriverConfigError:
        """Behaves as dehyst.drivers.settings.Settings.wrong."""


def check_output_range(settings: OutputRange, where: str) -> None:
    """Raise DriverConfigError unless the output can reach min_v to max_v [V at the piezo]. where:
    the device's output, for the message."""
    if settings.gain == 0:
        raise settings.wrong("gain", "a number other than 0")
    if not settings.min_v < settings.max_v:
        raise settings.wrong("min_v", f"below max_v = {settings.max_v:g}")
    low_v, high_v = settings.device_min_v, settings.device_max_v
    if not low_v < high_v:
        raise settings.wrong("device_min_v", f"below device_max_v = {high_v:g}")
    for key in ("min_v", "max_v"):
        volts = getattr(settings, key) / settings.gain + settings.zero_v
        if not low_v <= volts <= high_v:
            raise settings.wrong(
                key,
                f"within the {low_v:g} to {high_v:g} V of {where}; at gain {settings.gain:g} it "
                f"would be {volts:g} V",
            )


def explain_with(who: str, fault_of: Callable[[int], DriverError]) -> Callable[[int], DriverError]:
    """Return what explains the results of a channel's compiled functions. who: the channel;
    fault_of: explains the vendor's codes."""

    def explain(code: int) -> DriverError:
        if code == CLOSED:
            return DeviceGone(f"{who} is not open")
        if code == NOT_IN_RANGE:
            return OutOfRange(f"{who}: the value is outside its range; nothing was written")
        return fault_of(code)

    return explain


def call_c(builder: Any, address: Any, arguments: list[Any]) -> Any:
    """Call the C function at an address, inside a numba intrinsic, and return its int."""
    kind = ir.FunctionType(INT, [argument.type for argument in arguments])
    return builder.call(builder.inttoptr(address, kind.as_pointer()), arguments)


@njit(cache=True)
def scaled_mean(context: np.record) -> float:
    """Return the mean of the samples at context.samples as a reading, (mean - `zero`) * `gain`; NaN
    if any sample is outside `minimum` to `maximum`."""
    samples = carray(pointer(context.samples), (context.count,), types.float64)
    total = 0.0
    for sample in samples:
        if not context.minimum <= sample <= context.maximum:
            return math.nan
        total += sample
    return (total / context.count - context.zero) * context.gain
