"""Any Python object as a device: the contracts, wrong names, rates, faults, sharing."""

import math
from itertools import count
from pathlib import Path
from typing import Any

import pytest
from tests.drivers.python_object.amplifier import Unit

from dehyst.drivers.contract import ActuatorContract, SensorContract
from dehyst.drivers.interface import (
    DeviceGone,
    DeviceNotFound,
    DeviceTimeout,
    DriverConfigError,
    DriverError,
    ForeignUnit,
    OutOfRange,
    ProtocolError,
    UnitIdentity,
)
from dehyst.drivers.python_object import PythonActuator, PythonSensor

MODULE = "tests.drivers.python_object.amplifier"
OBJECT = f"{MODULE}:Amplifier"
ACTUATOR = {"object": OBJECT, "write": "voltage", "output": "voltage", "max_v": 150.0}
SENSOR = {"object": OBJECT, "read": "get_positions", "read_arguments": ("1",),
          "um_per_unit": 0.002, "zero": 1000.0, "min_um": -1.0, "max_um": 20.0}  # fmt: skip


@pytest.fixture(autouse=True)
def unit() -> None:
    Unit.volts, Unit.plugged, Unit.serial, Unit.raises = 20.0, True, "A7", OSError
    Unit.made = Unit.closed = 0


class Plug:
    """Unplugs the unit for both contracts."""

    def unplug(self, device: Any) -> None:
        Unit.plugged = False

    def replug(self, device: Any) -> None:
        Unit.plugged = True


class TestPythonActuator(Plug, ActuatorContract):
    def make(self) -> PythonActuator:
        return PythonActuator.from_settings({**ACTUATOR, "close": "shut"})

    def true_output(self, device: PythonActuator) -> float:
        return Unit.volts


class TestPythonActuatorByMethod(Plug, ActuatorContract):
    """A method with a channel, into an amplifier of gain 15; the object has no readback."""

    def make(self) -> PythonActuator:
        settings = {"object": OBJECT, "write": "channel.set_voltage", "write_arguments": (2,)}
        settings |= {"gain": 15.0, "max_v": 100.0, "initial_v": 0.0, "max_rate_hz": 200.0}
        return PythonActuator.from_settings(settings)

    def true_output(self, device: PythonActuator) -> float:
        return Unit.volts * 15.0


class TestPythonSensor(Plug, SensorContract):
    tolerance = 1e-9

    def make(self) -> PythonSensor:
        return PythonSensor.from_settings({**SENSOR, "serial_number": "get_serial"})

    def true_value(self, device: PythonSensor) -> float:
        return 2.0


def opened(kind: Any, settings: dict[str, Any], **more: Any) -> Any:
    device = kind.from_settings({**settings, **more})
    device.open()
    return device


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"object": "no_such_package:Make"}, "No module named.*install its package"),
        ({"object": f"{MODULE}:Absent"}, "Absent"),
        ({"object": f"{MODULE}:Unit.volts"}, "cannot be called"),
        ({"object": f"{MODULE}:gives_nothing"}, "returned no object"),
        ({"write": "volts"}, "the object has no volts"),
        ({"write": "channel.absent.volts"}, "the object has no channel.absent.volts"),
        ({"write": "set_later"}, "set_later is asynchronous"),
        ({"write_arguments": (1,)}, "voltage is an attribute and takes no arguments"),
        ({"output_arguments": (1,)}, "voltage is an attribute and takes no arguments"),
        ({"max_v": 10.0}, "output is at 20 V, outside the 0 to 10 V"),
    ],
)
def test_what_does_not_fit_is_named_and_nothing_is_written(settings: dict, says: str) -> None:
    device = PythonActuator.from_settings({**ACTUATOR, **settings})
    with pytest.raises(DriverConfigError, match=says):
        device.open()
    assert Unit.volts == 20.0


@pytest.mark.parametrize(
    ("kind", "settings", "says"),
    [
        (PythonActuator, {**ACTUATOR, "object": "module"}, 'written as "module:factory"'),
        (PythonActuator, {**ACTUATOR, "object": "os:system('x')"}, 'written as "module:factory"'),
        (PythonActuator, {**ACTUATOR, "min_v": 150.0}, "min_v.*below max_v"),
        (PythonActuator, {**ACTUATOR, "output": ""}, "initial_v"),
        (PythonActuator, {**ACTUATOR, "initial_v": 3.0}, "initial_v.*left out"),
        (PythonActuator, {**ACTUATOR, "output": "", "initial_v": 3.0}, "max_rate_hz"),
        (PythonActuator, {**ACTUATOR, "gain": 0.0}, "gain"),
        (PythonActuator, {"object": OBJECT, "write": "voltage"}, "max_v is missing"),
        (PythonSensor, {**SENSOR, "um_per_unit": 0.0}, "um_per_unit"),
        (PythonSensor, {**SENSOR, "min_um": 20.0}, "min_um.*below max_um"),
        (PythonSensor, {**SENSOR, "read_arguments": [None]}, "a list of strings and numbers"),
    ],
)
def test_wrong_settings_are_named(kind: Any, settings: dict, says: str) -> None:
    with pytest.raises(DriverConfigError, match=says):
        kind.from_settings(settings)


def test_what_the_factory_raises_is_one_line_with_its_arguments() -> None:
    settings = {**ACTUATOR, "object": f"{MODULE}:fails", "arguments": {"address": 5}}
    with pytest.raises(DeviceNotFound, match=r"^python .*fails: RuntimeError: .*\['address'\]$"):
        PythonActuator.from_settings(settings).open()


def ticking(step_s: float) -> Any:
    """Return a clock that advances by step_s with each call."""
    ticks = count()
    return lambda: next(ticks) * step_s


def test_calls_are_timed_and_a_rate_that_they_do_not_sustain_is_refused() -> None:
    settings = PythonSensor.settings_type(**{**SENSOR, "max_rate_hz": 500.0})
    device = PythonSensor(settings, ticking(0.004))
    with pytest.raises(DriverConfigError, match=r"max_rate_hz = 500, .*4 ms.*at most 250 Hz"):
        device.open()
    slow = PythonSensor(PythonSensor.settings_type(**SENSOR), ticking(0.004))
    slow.open()
    assert slow.spec.max_rate_hz == pytest.approx(250.0)
    assert slow.spec.latency_s == pytest.approx(0.004)
    declared = PythonSensor(settings, ticking(0.001))
    declared.open()
    assert declared.spec.max_rate_hz == 500.0


@pytest.mark.parametrize("value", ["get_serial", "nothing", "flag"])
def test_what_is_no_number_is_a_protocol_error(value: str) -> None:
    with pytest.raises(ProtocolError, match=f"{value} returned"):
        opened(PythonSensor, SENSOR, read=value, read_arguments=())


def test_several_numbers_are_not_one() -> None:
    with pytest.raises(ProtocolError, match="not one number"):
        opened(PythonSensor, SENSOR, read_arguments=("1", "2"))


@pytest.mark.parametrize(("volts", "inside"), [(0.0, True), (200.0, True), (200.1, False)])
def test_a_reading_out_of_range_is_nan(volts: float, inside: bool) -> None:
    device = opened(PythonSensor, SENSOR)
    Unit.volts = volts
    assert math.isnan(device.read()) is not inside


@pytest.mark.parametrize(
    ("raises", "kind"),
    [(TimeoutError, DeviceTimeout), (OSError, DeviceGone), (KeyError, DeviceGone)],
)
def test_what_the_object_raises_is_a_fault_and_the_object_is_made_anew(
    raises: type[Exception], kind: type[DriverError]
) -> None:
    device = opened(PythonActuator, ACTUATOR)
    device.write(30.0)
    Unit.plugged, Unit.raises = False, raises
    with pytest.raises(kind, match=raises.__name__):
        device.write(40.0)
    assert device.output() == 30.0
    Unit.plugged = True
    with pytest.raises(DeviceGone, match="not open"):
        device.write(40.0)
    device.reconnect()
    assert (Unit.made, Unit.volts, device.output()) == (2, 30.0, 30.0)


def test_an_amplifier_and_a_sensor_of_one_object_share_it() -> None:
    actuator = opened(PythonActuator, ACTUATOR, close="shut")
    sensor = opened(PythonSensor, SENSOR, close="shut")
    assert Unit.made == 1
    actuator.write(40.0)
    assert sensor.read() == pytest.approx(4.0)
    Unit.plugged = False
    with pytest.raises(DeviceGone):
        sensor.read()
    Unit.plugged = True
    sensor.reconnect()
    assert sensor.read() == pytest.approx(4.0)
    actuator.reconnect()  # uses the object that the sensor has made
    assert Unit.made == 2
    actuator.close()
    assert Unit.closed == 0  # it could not be closed while it was unplugged
    assert sensor.read() == pytest.approx(4.0)
    sensor.close()
    assert Unit.closed == 1


def test_another_unit_is_refused_before_a_voltage() -> None:
    device = PythonActuator.from_settings({**ACTUATOR, "serial_number": "get_serial"})
    device.expect(UnitIdentity("A8"))
    with pytest.raises(ForeignUnit, match=r"A7.*A8"):
        device.open()
    first = opened(PythonActuator, ACTUATOR, serial_number="get_serial")
    assert first.unit == UnitIdentity("A7", "Amplifier", OBJECT)
    assert first.spec.identity == f"Amplifier of {OBJECT} serial A7"
    first.close()
    Unit.serial = "B1"
    with pytest.raises(ForeignUnit, match=r"B1.*A7"):
        first.open()


def test_a_voltage_out_of_range_never_reaches_the_object() -> None:
    device = opened(PythonActuator, ACTUATOR)
    for volts in (-0.001, 150.001, math.nan, math.inf):
        with pytest.raises(OutOfRange):
            device.write(volts)
    assert Unit.volts == 20.0


def test_a_module_in_a_folder_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.path", [*__import__("sys").path])
    (tmp_path / "my_own_gauge.py").write_text("class Gauge:\n    um = 3.5\n")
    settings = {"object": "my_own_gauge:Gauge", "read": "um", "min_um": 0.0, "max_um": 9.0}
    with pytest.raises(DriverConfigError, match="folder"):
        opened(PythonSensor, settings)
    assert opened(PythonSensor, settings, folder=str(tmp_path)).read() == 3.5
