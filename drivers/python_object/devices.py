"""Any Python object as a device: one that sets a voltage, one that reads a displacement.

A factory named in the settings makes the object, and makes a new one after a fault; the settings
also name its methods and attributes. Its calls are timed at the start, and it is an error if they
cannot sustain the declared rate. It must have its own time-outs: a call that never returns stops
the loop's process, which the supervisor then ends.
"""

import math
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any, ClassVar

from dehyst.drivers.call_times import Batches
from dehyst.drivers.driver import IdentifiedDriver, found_outside, out_of_range
from dehyst.drivers.interface import (
    DeviceGone,
    DeviceNotFound,
    DeviceSpec,
    DeviceTimeout,
    DriverError,
    UnitIdentity,
    refuse_another,
)
from dehyst.drivers.python_object.endpoint import getter, one_number_of, setter
from dehyst.drivers.python_object.settings import (
    PythonActuatorSettings,
    PythonSensorSettings,
    PythonSettings,
)
from dehyst.drivers.python_object.shared import describe_error, object_of

BATCHES = Batches()

EXPECTED_S, MOST_HZ = 0.01, 10_000.0
"""Until the object has been timed: the duration of a call and the highest rate, both of them
guesses."""


class _PythonDevice(IdentifiedDriver):
    """Shared parts of both kinds: share the object, call it, time it, identify its unit."""

    settings_type: ClassVar[type[PythonSettings]]
    settings: PythonSettings
    spec: DeviceSpec

    def __init__(
        self, settings: PythonSettings, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.settings = settings
        self._clock = clock
        self._shared = object_of(settings)
        self._object: Any = None
        self._timed = False
        declared_hz = settings.max_rate_hz
        latency_s = 0.5 / declared_hz if declared_hz else EXPECTED_S
        self.spec = DeviceSpec("v", 0.0, 1.0, 0.0, declared_hz or MOST_HZ, latency_s)

    def open(self) -> None:
        """Make the object, or share one that exists; identify it, and time its calls. Raises
        DriverConfigError, DeviceNotFound, ForeignUnit."""
        if self._object is not None:
            return
        self._object = self._shared.connect(id(self))
        with self._closed_on_failure():
            try:
                self._identify()
                self._prepare(self._object)
                self._time()
            except DeviceGone as error:
                raise DeviceNotFound(str(error)) from None

    def close(self) -> None:
        """Stop using the object; an output stays where it is. Safe to call twice."""
        self._object = None
        self._forget()
        self._shared.release(id(self))

    def _prepare(self, made: Any) -> None:
        raise TypeError(f"{type(self).__name__} prepares nothing")

    def _forget(self) -> None:
        """Drop all references to the object: some objects close when the last one is dropped."""
        raise TypeError(f"{type(self).__name__} forgets nothing")

    def _timed_call(self) -> Callable[[], object] | None:
        raise TypeError(f"{type(self).__name__} times nothing")

    def _call(self, call: Callable[..., Any] | None, *arguments: Any) -> Any:
        """Call the object. Raises DeviceTimeout for a TimeoutError, DeviceGone for any other
        exception; reconnect() then makes a new object."""
        if self._object is None or call is None:
            raise DeviceGone(f"python {self.settings.object} is not open")
        try:
            with self._shared.calls:
                return call(*arguments)
        except DriverError:
            raise
        except Exception as error:  # whatever other people's code raises
            self._shared.drop(self._object)
            self.close()
            kind = DeviceTimeout if isinstance(error, TimeoutError) else DeviceGone
            raise kind(f"python {self.settings.object}: {describe_error(error)}") from None

    def _identify(self) -> None:
        name = self.settings.serial_number
        kind = type(self._object).__qualname__
        found = UnitIdentity("", kind, self.settings.object)
        if name:
            serial = str(self._call(getter(self._object, name, ()))).strip()
            found = UnitIdentity(serial, kind, self.settings.object)
            refuse_another(self.settings.object, found, self._known)
            self.unit = self._known = found
        self.spec = replace(
            self.spec,
            identity=f"{kind} of {self.settings.object}"
            + (f" serial {found.serial}" if found.serial else ""),
        )

    def _time(self) -> None:
        """Time the calls, only once: a reconnect must not take longer than necessary."""
        call = self._timed_call()
        if self._timed or call is None:
            return
        times, settings = BATCHES.best(call, self._clock), self.settings
        who = f"python {settings.object}"
        self.spec = BATCHES.with_rate(self.spec, times, settings.max_rate_hz, who)
        self._timed = True


class PythonActuator(_PythonDevice):
    """Any Python object with a method that sets a voltage."""

    settings_type = PythonActuatorSettings
    settings: PythonActuatorSettings

    def __init__(
        self, settings: PythonActuatorSettings, clock: Callable[[], float] = time.monotonic
    ) -> None:
        super().__init__(settings, clock)
        self._set: Callable[[float], None] | None = None
        self._report: Callable[[], Any] | None = None
        self._set_v = math.nan if settings.initial_v is None else settings.initial_v
        self.spec = replace(
            self.spec,
            minimum=settings.min_v,
            maximum=settings.max_v,
            resolution=settings.step_v,
            output_known=bool(settings.output),
        )

    def write(self, volts: float) -> None:
        """Set the voltage at the piezo. Raises OutOfRange (nothing written), DeviceTimeout,
        DeviceGone, ProtocolError."""
        settings = self.settings
        if not settings.min_v <= volts <= settings.max_v:  # NaN included
            raise out_of_range(f"python {settings.object}", volts, settings.min_v, settings.max_v)
        self._call(self._set, volts / settings.gain)
        self._set_v = volts

    def output(self) -> float:
        """Return the last written voltage, or the object's report, or initial_v; NaN if unknown."""
        return self._set_v

    def _prepare(self, made: Any) -> None:
        settings = self.settings
        self._set = setter(made, settings.write, settings.write_arguments)
        if not settings.output:
            return
        self._report = getter(made, settings.output, settings.output_arguments)
        stands_v = self._reported_v()
        if not settings.min_v <= stands_v <= settings.max_v:
            who = f"python {settings.object}"
            raise found_outside(who, stands_v, settings.min_v, settings.max_v)
        if not abs(stands_v - self._set_v) <= settings.step_v:  # off by more than the last step
            self._set_v = stands_v

    def _forget(self) -> None:
        self._set = self._report = None

    def _reported_v(self) -> float:
        return one_number_of(self._call(self._report), self.settings.output) * self.settings.gain

    def _timed_call(self) -> Callable[[], object] | None:
        return self._reported_v if self.settings.output else None


class PythonSensor(_PythonDevice):
    """Any Python object with a method that reads a displacement."""

    settings_type = PythonSensorSettings
    settings: PythonSensorSettings

    def __init__(
        self, settings: PythonSensorSettings, clock: Callable[[], float] = time.monotonic
    ) -> None:
        super().__init__(settings, clock)
        self._get: Callable[[], Any] | None = None
        self.spec = replace(
            self.spec,
            unit="um",
            minimum=settings.min_um,
            maximum=settings.max_um,
            resolution=settings.step_um,
        )

    def read(self) -> float:
        """Take one reading [um]; NaN if it is out of range. Raises DeviceTimeout, DeviceGone,
        ProtocolError."""
        settings = self.settings
        value = one_number_of(self._call(self._get), settings.read)
        um = (value - settings.zero) * settings.um_per_unit
        return um if settings.min_um <= um <= settings.max_um else math.nan

    def _prepare(self, made: Any) -> None:
        self._get = getter(made, self.settings.read, self.settings.read_arguments)

    def _forget(self) -> None:
        self._get = None

    def _timed_call(self) -> Callable[[], object] | None:
        return self.read
