"""A channel as a task of the vendor's package, and the conversion of its errors."""

import importlib
from typing import Any

import numpy as np

from dehyst.drivers.driver import IdentifiedDriver
from dehyst.drivers.interface import (
    DeviceGone,
    DeviceNotFound,
    DeviceTimeout,
    DriverError,
    UnitIdentity,
    refuse_another,
)

TIMED_OUT = (-200284, -200292, -200474, -200560)
"""Status codes of NI-DAQmx for time-outs: samples not yet available, samples that cannot be written
yet, an operation timed out, a task that is not done. Every other error of a task that had been
started means that its device cannot be used."""

CONTEXT_T = np.dtype(
    [
        ("task", np.int64),  # task handle; 0 while the channel is closed
        ("function", np.int64),  # address of the C function
        ("timeout_s", np.float64),
        ("gain", np.float64),  # piezo volts per EXT volt; um per unit of the input
        ("zero", np.float64),  # EXT volts at 0 V; the input at displacement 0
        ("minimum", np.float64),  # what may be written [V]; input values that are valid readings
        ("maximum", np.float64),
        ("output_v", np.float64),  # the last voltage written, by either loop
        ("count", np.int64),  # samples per reading; 0: a single value, read on its own
        ("samples", np.int64),  # address of a buffer for these and one more number
    ]
)
"""Channel data that both loops share; nidaqmx/direct_calls.py works on it."""


def vendor() -> Any:
    """Return the vendor package; DeviceNotFound says how to install it."""
    try:
        return importlib.import_module("nidaqmx")
    except ImportError as error:
        raise DeviceNotFound(
            "the NI-DAQmx package is not installed: pip install dehyst[nidaqmx], and the NI-DAQmx "
            f"driver from National Instruments ({error})"
        ) from None


def fault_of(channel: str, status: int, text: str) -> DriverError:
    """Return the error of a call that failed. status: of NI-DAQmx, below 0; text: its message."""
    kind = DeviceTimeout if status in TIMED_OUT else DeviceGone
    return kind(f"nidaqmx {channel}: {' '.join(text.split())}")


class Channel(IdentifiedDriver):
    """A task with one channel; the driver subclass defines it."""

    channel = ""

    def __init__(self) -> None:
        self._task: Any = None
        self._error: type[Exception] = OSError
        self._context = np.zeros(1, CONTEXT_T)
        self.product = ""

    def open(self) -> None:
        """Reserve the channel, identify its device, and start it. Moves nothing."""
        if self._task is not None:
            return
        package = vendor()
        self._error = package.errors.Error  # base class of all its errors, DaqError included
        task = None
        try:
            task = package.Task()
            self._add_channel(task, package.constants)
            self._identify(task)
            self._set_clock(task, package.constants)
            task.start()
            self._started(task, package.constants)
            self._task = task
            self._context["task"] = handle_of(task)
            self._prove()
        except (self._error, OSError) as error:
            self._abandon(task)
            raise DeviceNotFound(f"nidaqmx {self.channel}: {error}") from None
        except BaseException:
            self._abandon(task)
            raise

    def close(self) -> None:
        """Release the channel; an output stays where it is. Safe to call twice."""
        task, self._task = self._task, None
        self._context["task"] = 0
        self._abandon(task)

    def _abandon(self, task: Any) -> None:
        self._task = None
        self._context["task"] = 0
        try:
            if task is not None:
                task.close()
        except self._error:  # the device has gone; there is nothing left to release
            return

    def _add_channel(self, task: Any, constants: Any) -> None:
        raise TypeError(f"{type(self).__name__} has no channel")

    def _set_clock(self, task: Any, constants: Any) -> None:
        """Set the sample clock, if the settings require one."""

    def _started(self, task: Any, constants: Any) -> None:
        """Set what can be set only on a running task."""

    def _prove(self) -> None:
        """Test the open channel before it is used."""

    def _identify(self, task: Any) -> None:
        """Identify the device of the channel; one that NI simulates has no serial number."""
        device = next(iter(task.devices))
        self.product = str(device.product_type)
        number = int(device.dev_serial_num)
        if number:  # printed on the device in hexadecimal
            found = UnitIdentity(f"{number:X}", self.product, self.channel)
            refuse_another(self.channel, found, self._known)
            self.unit = self._known = found

    def _ready(self) -> Any:
        if self._task is None:
            raise DeviceGone(f"nidaqmx {self.channel} is not open")
        return self._task

    def _failed(self, error: Exception) -> DriverError:
        """Release the channel after a failed call; return the error for it."""
        self.close()
        return fault_of(self.channel, getattr(error, "error_code", 0), str(error))


def handle_of(task: Any) -> int:
    """Return the C library's handle of a task: an address, 0 if the task has none (a task on
    another computer). The package keeps it private and has no public equivalent."""
    handle = getattr(task, "_handle", None)
    return int(getattr(handle, "value", None) or 0)
