"""A channel as a task of the vendor's package, and what its errors mean."""

import importlib
from typing import Any

import numpy as np

from dehyst.drivers.interface import DeviceGone, DeviceNotFound, DeviceTimeout, DriverError

TIMED_OUT = (-200284, -200292, -200474, -200560)
"""Status codes of NI-DAQmx for what did not happen in time: samples not yet available, samples
that cannot be written yet, an operation timed out, a task that is not done. Every other error of
a task that had been started means that its device cannot be used."""

CONTEXT_T = np.dtype(
    [
        ("task", np.int64),  # handle of the task; 0 while the channel is closed
        ("function", np.int64),  # address of the C function
        ("timeout_s", np.float64),
        ("gain", np.float64),  # piezo volts per EXT volt; um per bridge ratio
        ("zero", np.float64),  # bridge ratio at displacement 0
        ("minimum", np.float64),  # what may be written [V]; bridge ratios that are readings
        ("maximum", np.float64),
        ("output_v", np.float64),  # the last voltage that was written, by whichever loop
    ]
)
"""What both loops know of a channel; nidaqmx/direct_calls.py works on it."""


def vendor() -> Any:
    """The vendor package; DeviceNotFound says how to install it."""
    try:
        return importlib.import_module("nidaqmx")
    except ImportError as error:
        raise DeviceNotFound(
            "the NI-DAQmx package is not installed: pip install dehyst[nidaqmx], and the NI-DAQmx "
            f"driver from National Instruments ({error})"
        ) from None


def fault_of(channel: str, status: int, text: str) -> DriverError:
    """The error of a call that failed. status: of NI-DAQmx, below 0; text: its words."""
    kind = DeviceTimeout if status in TIMED_OUT else DeviceGone
    return kind(f"nidaqmx {channel}: {' '.join(text.split())}")


class Channel:
    """A task with one channel; a driver says which."""

    channel = ""

    def __init__(self) -> None:
        self._task: Any = None
        self._error: type[Exception] = OSError
        self._context = np.zeros(1, CONTEXT_T)

    def open(self) -> None:
        """Reserve the channel. Moves nothing."""
        if self._task is not None:
            return
        package = vendor()
        self._error = package.errors.Error  # of all its errors; DaqError is one of them
        task = None
        try:
            task = package.Task()
            self._add_channel(task, package.constants)
            task.start()
        except (self._error, OSError) as error:
            if task is not None:
                task.close()
            raise DeviceNotFound(f"nidaqmx {self.channel}: {error}") from None
        self._task = task
        self._context["task"] = handle_of(task)

    def reconnect(self) -> None:
        """Reserve the channel again; the output does not move."""
        self.close()
        self.open()

    def close(self) -> None:
        """Release the channel; an output stays where it is. Safe to call twice."""
        if self._task is None:
            return
        task, self._task = self._task, None
        self._context["task"] = 0
        try:
            task.close()
        except self._error:  # the device has gone; there is nothing left to release
            return

    def _add_channel(self, task: Any, constants: Any) -> None:
        raise TypeError(f"{type(self).__name__} has no channel")

    def _ready(self) -> Any:
        if self._task is None:
            raise DeviceGone(f"nidaqmx {self.channel} is not open")
        return self._task

    def _failed(self, error: Exception) -> DriverError:
        """Release the channel after a call that failed: the error for it."""
        self.close()
        return fault_of(self.channel, getattr(error, "error_code", 0), str(error))


def handle_of(task: Any) -> int:
    """The C library's handle of a task: an address, 0 where the task has none (a task on another
    computer). The package keeps it to itself and offers nothing of its kind in public."""
    handle = getattr(task, "_handle", None)
    return int(getattr(handle, "value", None) or 0)
