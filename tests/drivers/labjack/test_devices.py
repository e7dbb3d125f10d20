"""The LabJack drivers through LabJack's package, on a stand-in of its library, in both loops."""

import itertools
import math
import sys
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from tests.rigs import direct_calls
from tests.rigs.direct_calls import direct_of
from tests.rigs.ljm.standin import Unit, compile_library, plug
from tests.rigs.two_loops import Rig, setpoint

from dehyst.drivers.contract import ActuatorContract, SensorContract
from dehyst.drivers.interface import (
    DeviceGone,
    DeviceNotFound,
    DeviceTimeout,
    DriverConfigError,
    ForeignUnit,
    OutOfRange,
    UnitIdentity,
)
from dehyst.drivers.labjack import LabjackActuator, LabjackSensor

pytestmark = pytest.mark.processes  # because of the compiler
ACTUATOR = {"gain": 15.0, "max_v": 75.0}
SENSOR = {"um_per_v": 5.0, "zero_v": 0.5, "average": 5}
TICK = {"channel": "TDAC0", "max_v": 150.0, "device_min_v": -10.0, "device_max_v": 10.0,
        "initial_v": 0.0}  # fmt: skip
in_use: list[Any] = []
names = (f"ljm-{i}" for i in itertools.count())


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> str:
    return compile_library(tmp_path_factory.mktemp("standin"))


@pytest.fixture(autouse=True)
def unit(
    request: pytest.FixtureRequest, library: str, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Unit]:
    made = plug(library, monkeypatch)
    if request.instance is not None:
        request.instance.unit = made
    yield made
    while in_use:
        in_use.pop().close()


class Plug:
    """Unplugs the unit for both contracts."""

    unit: Unit

    def unplug(self, device: Any) -> None:
        self.unit.plugged = 0

    def replug(self, device: Any) -> None:
        self.unit.plugged = 1


class TestLabjackActuator(Plug, ActuatorContract):
    def make(self) -> LabjackActuator:
        return LabjackActuator.from_settings(ACTUATOR)

    def true_output(self, device: LabjackActuator) -> float:
        return self.unit.register("DAC0") * 15.0


class TestLabjackTick(Plug, ActuatorContract):
    """An LJTick-DAC, which has no readback, into an inverting amplifier with an offset."""

    def make(self) -> LabjackActuator:
        return LabjackActuator.from_settings({**TICK, "gain": -20.0, "zero_v": 5.0})

    def true_output(self, device: LabjackActuator) -> float | None:
        volts = self.unit.register("TDAC0")
        return (volts - 5.0) * -20.0 if volts else None


class TestLabjackSensor(Plug, SensorContract):
    tolerance = 5.0 * 2e-4

    def make(self) -> LabjackSensor:
        return LabjackSensor.from_settings(SENSOR)

    def true_value(self, device: LabjackSensor) -> float:
        return 0.0


def used(device: Any) -> Any:
    """Open the device and return it; release its handle when the test ends."""
    in_use.append(device)
    device.open()
    return device


def opened(**more: Any) -> tuple[LabjackActuator, LabjackSensor]:
    actuator = used(LabjackActuator.from_settings(ACTUATOR))
    return actuator, used(LabjackSensor.from_settings(SENSOR | more))


def test_an_output_and_an_input_of_one_unit_share_its_handle(unit: Unit) -> None:
    actuator, sensor = opened()
    assert unit.opened == 1
    actuator.write(60.0)
    assert unit.register("DAC0") == 4.0
    assert sensor.read() == pytest.approx(0.8 * 4.0 * 5.0)
    actuator.close()
    assert sensor.read() == pytest.approx(16.0)
    sensor.close()
    assert not unit.is_open
    assert unit.timeout_ms == 200.0


def test_the_input_is_set_up_as_it_is_wired(unit: Unit) -> None:
    sensor = LabjackSensor.from_settings(
        {**SENSOR, "range_v": 1.0, "max_v": 1.0, "negative": "AIN1", "resolution_index": 8,
         "settling_s": 1e-4}
    )  # fmt: skip
    sensor.open()
    registers = [unit.register(f"AIN0_{name}") for name in ("RANGE", "NEGATIVE_CH",
                 "RESOLUTION_INDEX", "SETTLING_US")]  # fmt: skip
    assert registers == [1.0, 1.0, 8.0, pytest.approx(100.0)]
    sensor.close()


def test_the_unit_is_known_by_its_serial_number(unit: Unit) -> None:
    actuator, sensor = opened()
    assert actuator.unit == UnitIdentity("470012345", "LabJack T7", "ANY")
    assert actuator.spec.identity == "LabJack T7 serial 470012345 DAC0 into EXT, gain 15"
    assert sensor.spec.identity == "LabJack T7 serial 470012345 AIN0, mean of 5"
    for device in (actuator, sensor):
        device.close()
    unit.serial = 470099999
    with pytest.raises(ForeignUnit, match=r"470099999.*470012345"):
        actuator.open()
    assert unit.register("DAC0") == 0.0


def test_the_output_is_asked_where_it_stands(unit: Unit) -> None:
    first, _ = opened()
    first.write(45.0)
    first.close()
    second = LabjackActuator.from_settings(ACTUATOR)
    second.open()
    assert second.output() == pytest.approx(45.0)
    assert second.spec.output_known
    second.close()
    less = LabjackActuator.from_settings({"max_v": 30.0})
    with pytest.raises(DriverConfigError, match="output is at 45 V, outside the 0 to 30 V"):
        less.open()
    assert not LabjackActuator.from_settings(TICK).spec.output_known


@pytest.mark.parametrize(
    ("code", "kind"), [(1263, DeviceTimeout), (1306, DeviceTimeout), (1239, DeviceGone)]
)
def test_a_failing_call_is_the_same_fault_in_both(unit: Unit, code: int, kind: type) -> None:
    actuator, sensor = opened()
    write, read = direct_of(actuator), direct_of(sensor)
    direct_calls.write(write, 30.0)
    unit.status, unit.fail_in = code, 0
    for error in (direct_calls.write(write, 45.0), direct_calls.read(read)):
        assert type(error) is kind
        assert f"error code {code} words of the library for {code}" in str(error)
    with pytest.raises(kind, match=f"^labjack AIN0: .*{code}"):
        sensor.read()
    unit.fail_in = -1
    with pytest.raises(DeviceGone):  # its handle was closed with the sensor's
        actuator.write(45.0)
    assert (actuator.output(), unit.register("DAC0")) == (30.0, 2.0)
    for device in (actuator, sensor):
        device.reconnect()
    assert unit.opened == 2
    actuator.write(45.0)
    assert direct_calls.write(write, 60.0) is None  # the same function uses the new handle
    assert unit.register("DAC0") == 4.0


def test_compiled_code_reads_and_writes_what_python_does(unit: Unit) -> None:
    actuator, sensor = opened()
    write, read = direct_of(actuator), direct_of(sensor)
    for volts in (0.0, 75.0, 7.3, 1 / 3):
        actuator.write(volts)
        by_python = unit.register("DAC0")
        assert direct_calls.write(write, volts) is None
        assert unit.register("DAC0") == by_python
        unit.calls = 0
        shown = sensor.read()
        unit.calls = 0
        assert direct_calls.read(read) == shown
        assert shown == pytest.approx(by_python * 0.8 * 5.0)  # the noise has a period of 5
    calls = unit.calls
    for volts in (-0.001, 75.001, math.nan, math.inf):
        assert isinstance(direct_calls.write(write, volts), OutOfRange)
        with pytest.raises(OutOfRange):
            actuator.write(volts)
    assert unit.calls == calls
    for volts in (10.01, -9999.0):  # the unit reports -9999 for out of range
        unit.broken_v = volts
        assert math.isnan(sensor.read())
        assert math.isnan(direct_calls.read(read))  # type: ignore[arg-type]


def test_an_inverting_amplifier_with_an_offset_is_the_same_in_both(unit: Unit) -> None:
    settings = {**TICK, "gain": -20.0, "zero_v": 5.0}
    actuator = used(LabjackActuator.from_settings(settings))
    direct = direct_of(actuator)
    for volts, device_v in ((0.0, 5.0), (100.0, 0.0), (150.0, -2.5)):
        actuator.write(volts)
        assert unit.register("TDAC0") == device_v
        unit.values[0] = 9.0
        assert direct_calls.write(direct, volts) is None
        assert unit.register("TDAC0") == device_v


def test_both_loops_give_the_same_records(library: str, monkeypatch: pytest.MonkeyPatch) -> None:
    records = []
    for compiled in (False, True):
        unit = plug(library, monkeypatch)
        actuator = used(LabjackActuator.from_settings(TICK))
        sensor = used(LabjackSensor.from_settings(SENSOR))
        unit.calls = 0
        rig = Rig(next(names), "static", [300_000, 0, 900_000], devices=(actuator, sensor))
        records.append(rig.play([setpoint(4.0), setpoint(9.0), setpoint(2.0)], 150, compiled))
        records[-1]["cause"] = 0  # the cause of this machine's delay is not part of the step
        assert records[-1]["volts"][-1] == unit.register("TDAC0") * 15.0
        for device in (actuator, sensor):
            device.close()
    assert records[0].tobytes() == records[1].tobytes()
    assert np.ptp(records[1]["measured"]) > 3.0


def test_a_rate_that_calls_do_not_sustain_is_refused() -> None:
    ticks = itertools.count()
    settings = LabjackSensor.settings_type(**SENSOR, max_rate_hz=800.0)
    sensor = LabjackSensor(settings, lambda: next(ticks) * 2e-3)
    with pytest.raises(DriverConfigError, match=r"max_rate_hz = 800, .*2 ms.*at most 500 Hz"):
        sensor.open()


def test_a_unit_that_is_not_there_is_named(unit: Unit) -> None:
    sensor = LabjackSensor.from_settings({**SENSOR, "identifier": "absent"})
    with pytest.raises(DeviceNotFound, match=r"labjack T7 absent: .*1227"):
        sensor.open()


def test_without_package_or_library_the_error_names_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    sensor = LabjackSensor.from_settings(SENSOR)
    monkeypatch.setattr("dehyst.drivers.labjack.channel.LIBRARY", "libAbsent.so")
    with pytest.raises(DeviceNotFound, match="LJM library is not installed"):
        sensor.open()
    monkeypatch.setitem(sys.modules, "labjack.ljm", None)
    with pytest.raises(DeviceNotFound, match=r"pip install dehyst\[labjack\]"):
        sensor.open()


@pytest.mark.parametrize(
    ("kind", "settings", "says"),
    [
        (LabjackActuator, {"max_v": 80.0}, "max_v.*within the 0 to 5 V of DAC0.*5.33333 V"),
        (LabjackActuator, {"gain": 0.0}, "gain"),
        (LabjackActuator, {"min_v": 75.0}, "min_v.*below max_v"),
        (LabjackActuator, {"initial_v": 0.0}, "initial_v.*DAC0 reports its own output"),
        (LabjackActuator, {**TICK, "initial_v": 151.0}, "initial_v.*TDAC0 reports none"),
        (LabjackSensor, {}, "um_per_v is missing"),
        (LabjackSensor, {"um_per_v": 0.0}, "um_per_v"),
        (LabjackSensor, {"um_per_v": 1.0, "range_v": 5.0}, "range_v.*0.01, 0.1, 1 or 10"),
        (LabjackSensor, {"um_per_v": 1.0, "range_v": 1.0}, "range_v.*as wide"),
        (LabjackSensor, {"um_per_v": 1.0, "average": 15}, "average.*from 1 to 14"),
    ],
)
def test_wrong_settings_are_named(kind: Any, settings: dict, says: str) -> None:
    with pytest.raises(DriverConfigError, match=says):
        kind.from_settings(settings)
