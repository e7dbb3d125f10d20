"""What every driver must do: tests to subclass, for the drivers here and for plugins elsewhere.

    from dehyst.drivers.contract import ActuatorContract

    class TestMyAmp(ActuatorContract):
        def make(self): return MyAmp.from_settings({"port": ...})     # not open yet
        def true_output(self, device): return meter.volts()           # optional, independent
        def unplug(self, device): ...                                 # optional, with replug
        def replug(self, device): ...

Run them with pytest. Optional hooks that a subclass leaves out skip the tests that need them.
`setup_method` and `teardown_method` of pytest are free for the subclass.
"""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any
from unittest import SkipTest

from dehyst.drivers.interface import (
    Actuator,
    DeviceSpec,
    DriverConfigError,
    DriverError,
    OutOfRange,
    Sensor,
)


def refused(kind: type[Exception], job: Callable[[], Any], what: str) -> Exception:
    """Return the error of `kind` that `job` raises; AssertionError if it raises none."""
    try:
        job()
    except kind as error:
        return error
    raise AssertionError(f"{what} must raise {kind.__name__}")


class _DriverContract:
    """Tests and hooks that actuators and sensors have in common."""

    protocol: Any = object

    def make(self) -> Any:
        """Return a new driver that has not been opened."""
        raise SkipTest("the contract itself; a subclass gives it a driver with make()")

    def unplug(self, device: Any) -> None:
        """Make the device vanish while it is open."""
        raise SkipTest("this driver's tests do not unplug")

    def replug(self, device: Any) -> None:
        """Plug the device back in."""

    def use(self, device: Any) -> None:
        """Make one call of the kind that the loop makes."""

    @contextmanager
    def opened(self) -> Iterator[Any]:
        """Yield an open driver from make() and close it at the end."""
        device = self.make()
        device.open()
        try:
            yield device
        finally:
            device.close()

    def check_spec(self, spec: DeviceSpec) -> None:
        numbers = (spec.minimum, spec.maximum, spec.resolution, spec.max_rate_hz, spec.latency_s)
        assert all(math.isfinite(x) for x in numbers), f"not finite: {spec}"
        assert spec.minimum < spec.maximum, f"an empty range: {spec}"
        assert 0.0 <= spec.resolution < spec.maximum - spec.minimum, f"resolution: {spec}"
        assert spec.max_rate_hz > 0.0, f"max_rate_hz: {spec}"
        assert spec.latency_s >= 0.0, f"latency_s: {spec}"
        assert spec.unit, f"no unit: {spec}"

    def test_fulfils_the_interface(self) -> None:
        device = self.make()
        assert isinstance(device, self.protocol), f"{type(device)} lacks part of {self.protocol}"
        assert isinstance(device.spec, DeviceSpec)

    def test_an_unknown_setting_is_refused_by_name(self) -> None:
        make = type(self.make()).from_settings
        error = refused(DriverConfigError, lambda: make({"no_such_setting": 1}), "a wrong key")
        assert "no_such_setting" in str(error), f"the message does not name the key: {error}"

    def test_use_before_open_is_a_driver_error(self) -> None:
        device = self.make()
        refused(DriverError, lambda: self.use(device), "use before open()")
        device.close()

    def test_spec_after_open(self) -> None:
        with self.opened() as device:
            self.check_spec(device.spec)
            assert device.spec.identity, "no identity: the log could not distinguish two units"

    def test_open_and_close_twice(self) -> None:
        with self.opened() as device:
            device.open()
            self.use(device)
            device.close()
            device.close()
            refused(DriverError, lambda: self.use(device), "use after close()")

    def test_can_be_opened_again(self) -> None:
        with self.opened() as device:
            self.use(device)
            device.close()
            device.open()
            self.use(device)

    def test_reconnect_when_nothing_is_wrong(self) -> None:
        with self.opened() as device:
            self.use(device)
            device.reconnect()
            self.use(device)

    def test_unplug_is_told_and_reconnect_restores(self) -> None:
        with self.opened() as device:
            self.use(device)
            self.unplug(device)
            refused(DriverError, lambda: self.use(device), "use while unplugged")
            refused(DriverError, device.reconnect, "reconnect() while unplugged")
            refused(DriverError, lambda: self.use(device), "use after a failed reconnect()")
            self.replug(device)
            device.reconnect()
            self.use(device)

    def test_closing_an_unplugged_device(self) -> None:
        with self.opened() as device:
            self.unplug(device)
            device.close()


class ActuatorContract(_DriverContract):
    """Tests that every actuator passes. Hooks: make, true_output, unplug, replug."""

    protocol = Actuator

    def true_output(self, device: Actuator) -> float | None:
        """Return the output voltage from an independent source; None where there is none."""
        return None

    def use(self, device: Actuator) -> None:
        device.write((device.spec.minimum + device.spec.maximum) / 2.0)

    def check_stands_at(self, device: Actuator, volts: float) -> None:
        tolerance = max(device.spec.resolution, 1e-9)
        assert abs(device.output() - volts) <= tolerance, f"{device.output()} V, not {volts} V"
        true = self.true_output(device)
        assert true is None or abs(true - volts) <= tolerance, f"really {true} V, not {volts} V"

    def inside(self, device: Actuator, share: float) -> float:
        return device.spec.minimum + share * (device.spec.maximum - device.spec.minimum)

    def test_unit_is_volts(self) -> None:
        with self.opened() as device:
            assert device.spec.unit == "v"

    def test_writes_are_carried_out(self) -> None:
        with self.opened() as device:
            for share in (0.5, 0.1234567, 0.0, 1.0, 0.9999999, 0.25):
                volts = self.inside(device, share)
                device.write(volts)
                self.check_stands_at(device, volts)

    def test_outside_the_range_nothing_is_written(self) -> None:
        with self.opened() as device:
            stands = self.inside(device, 0.3)
            device.write(stands)
            span = device.spec.maximum - device.spec.minimum
            wrong = (
                device.spec.minimum - 1e-3 * span,
                device.spec.maximum + 1e-3 * span,
                device.spec.maximum + 100.0 * span,
                math.nan,
                math.inf,
                -math.inf,
            )
            for volts in wrong:
                refused(OutOfRange, partial(device.write, volts), f"write({volts})")
                self.check_stands_at(device, stands)

    def test_open_close_and_reconnect_do_not_move_the_output(self) -> None:
        with self.opened() as device:
            stands = self.inside(device, 0.4)
            device.write(stands)
            device.reconnect()
            self.check_stands_at(device, stands)
            device.close()
            before = self.true_output(device)
            device.open()
            after = self.true_output(device)
            assert before == after, f"open() moved the output from {before} to {after} V"

    def test_unplug_does_not_move_the_output(self) -> None:
        with self.opened() as device:
            stands = self.inside(device, 0.6)
            device.write(stands)
            self.unplug(device)
            refused(DriverError, lambda: device.write(stands), "write() while unplugged")
            self.replug(device)
            device.reconnect()
            self.check_stands_at(device, stands)


class SensorContract(_DriverContract):
    """Tests that every sensor passes. Hooks: make, true_value, tolerance, unplug, replug."""

    protocol = Sensor

    def true_value(self, device: Sensor) -> float | None:
        """Return the correct reading from an independent source; None where there is none."""
        return None

    tolerance = 0.0
    """How far a reading may be from true_value()."""

    def use(self, device: Sensor) -> None:
        device.read()

    def test_readings_are_numbers_in_range(self) -> None:
        with self.opened() as device:
            for _ in range(5):
                value = device.read()
                assert isinstance(value, float), f"{value!r} is no float"
                inside = device.spec.minimum <= value <= device.spec.maximum
                assert math.isnan(value) or inside, f"{value} outside {device.spec}"

    def test_readings_are_true(self) -> None:
        with self.opened() as device:
            true = self.true_value(device)
            if true is None:
                raise SkipTest("no independent value to compare with")
            off = abs(device.read() - true)
            assert off <= self.tolerance, f"off by {off}, tolerance {self.tolerance}"
