"""A register of a LabJack through the vendor's package, and the conversion of its errors."""

import ctypes
import importlib
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from dehyst.drivers.call_times import Batches
from dehyst.drivers.driver import IdentifiedDriver
from dehyst.drivers.interface import (
    DeviceGone,
    DeviceNotFound,
    DeviceSpec,
    DeviceTimeout,
    DriverError,
    UnitIdentity,
    refuse_another,
)
from dehyst.drivers.labjack.settings import LabjackSettings
from dehyst.drivers.shared import shared_by

LIBRARY = "libLabJackM.so"

TIMED_OUT = (1206, 1263, 1306)
"""Error codes of LJM for time-outs: the unit is busy, no byte of a reply arrived, no
synchronisation in time. Every other error means that the unit cannot be used."""

EXPECTED_S, MOST_HZ = 6e-4, 5000.0
"""Until the unit has been timed: the duration of a call (0.6 ms on USB, by its data sheet), and the
highest rate, which is above what such calls allow."""

BATCHES = Batches()

CONTEXT_T = np.dtype(
    [
        ("handle", np.int64),  # handle of the open unit; 0 while the channel is closed
        ("function", np.int64),  # address of the C function
        ("name", np.int64),  # address of the register's name, or of a list of such addresses
        ("gain", np.float64),  # piezo volts per EXT volt; um per volt
        ("zero", np.float64),  # EXT volts at 0 V; volts at displacement 0
        ("minimum", np.float64),  # what may be written [V]; volts that are valid readings
        ("maximum", np.float64),
        ("output_v", np.float64),  # the last voltage written, by either loop
        ("count", np.int64),  # samples per reading
        ("samples", np.int64),  # address of a buffer for these and one more number
    ]
)
"""Channel data that both loops share; labjack/direct_calls.py works on it."""


def vendor() -> Any:
    """Return the vendor package; DeviceNotFound says how to install it."""
    try:
        ljm = importlib.import_module("labjack.ljm")
    except ImportError as error:
        raise DeviceNotFound(
            "the LabJack package is not installed: pip install dehyst[labjack], and the LJM "
            f"library from LabJack ({error})"
        ) from None
    load_ljm()  # without it, the package only prints a message
    return ljm


def load_ljm() -> ctypes.CDLL:
    """Load LJM from where the package finds it. Raises DeviceNotFound if it is not installed."""
    try:
        return ctypes.CDLL(LIBRARY)
    except OSError as error:
        raise DeviceNotFound(
            f"LabJack's LJM library is not installed: get it from LabJack ({error})"
        ) from None


def fault_of(channel: str, code: int | None, text: str) -> DriverError:
    """Return the error of a call that failed. code: of LJM; text: its message."""
    kind = DeviceTimeout if code in TIMED_OUT else DeviceGone
    return kind(f"labjack {channel}: {' '.join(text.split())}")


class Channel(IdentifiedDriver):
    """One register of a unit; the driver subclass defines it. A unit's registers share its
    handle."""

    spec: DeviceSpec

    def __init__(
        self, settings: LabjackSettings, channel: str, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._unit_settings, self.channel, self._clock = settings, channel.upper(), clock
        key = repr(("labjack", settings.device, settings.connection, settings.identifier))
        self._shared = shared_by(key, self._connect, disconnect)
        self._ljm: Any = None
        self._handle = 0
        self._timed = False
        self._context = np.zeros(1, CONTEXT_T)
        self._name = np.frombuffer(self.channel.encode() + b"\0", np.uint8)
        self._context["name"] = self._name.ctypes.data

    def open(self) -> None:
        """Connect, identify the unit, set up an input, time a few calls. Moves nothing."""
        if self._handle:
            return
        self._ljm = vendor()
        self._handle = self._shared.connect(id(self))
        self._context["handle"] = self._handle
        with self._closed_on_failure():
            try:
                self._identify()
                self._prepare()
                self._time()
            except self._ljm.LJMError as error:
                raise DeviceNotFound(f"labjack {self.channel}: {error}") from None

    def close(self) -> None:
        """Stop using the unit; an output stays where it is. Safe to call twice."""
        self._handle = 0
        self._context["handle"] = 0
        self._shared.release(id(self))

    def _prepare(self) -> None:
        """Prepare an open channel for use."""

    def _timed_call(self) -> object:
        """Make a call that takes as long as the loop's calls and moves nothing."""
        raise TypeError(f"{type(self).__name__} times nothing")

    def _connect(self) -> int:
        settings, ljm = self._unit_settings, vendor()
        try:
            ljm.writeLibraryConfigS("LJM_SEND_RECEIVE_TIMEOUT_MS", 1e3 * settings.timeout_s)
            return int(ljm.openS(settings.device, settings.connection, settings.identifier))
        except ljm.LJMError as error:
            raise DeviceNotFound(
                f"labjack {settings.device} {settings.identifier}: {' '.join(str(error).split())}"
            ) from None

    def _identify(self) -> None:
        kind, _, number, *_ = self._ljm.getHandleInfo(self._handle)
        found = UnitIdentity(str(number), f"LabJack T{kind}", self._unit_settings.connection)
        refuse_another(f"labjack {self.channel}", found, self._known)
        self.unit = self._known = found
        self.spec = replace(
            self.spec, identity=f"{found.kind} serial {number} {self.channel}{self._more_words()}"
        )

    def _more_words(self) -> str:
        return ""

    def _time(self) -> None:
        """Time the calls, only once: a reconnect must not take longer than necessary."""
        if self._timed:
            return
        times = BATCHES.best(self._timed_call, self._clock)
        declared_hz = self._unit_settings.max_rate_hz
        self.spec = BATCHES.with_rate(self.spec, times, declared_hz, f"labjack {self.channel}")
        self._timed = True

    def _ready(self) -> Any:
        if not self._handle:
            raise DeviceGone(f"labjack {self.channel} is not open")
        return self._ljm

    def _failed(self, error: Any) -> DriverError:
        """Release the unit after a failed call; return the error for it."""
        self._shared.drop(self._handle)
        self.close()
        return fault_of(self.channel, error.errorCode, str(error))


def disconnect(handle: int) -> None:
    """Close a connection; errors are ignored, because the unit may have gone."""
    ljm = vendor()
    with suppress(ljm.LJMError):
        ljm.close(handle)
