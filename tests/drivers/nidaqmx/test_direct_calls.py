"""NI-DAQmx channels called by compiled code, on a stand-in of the vendor's C library."""

import itertools
import math
import time
from typing import Any

import numpy as np
import pytest
from tests.rigs import direct_calls
from tests.rigs.daqmx.standin import Standin, compile_library
from tests.rigs.direct_calls import direct_of
from tests.rigs.two_loops import Rig, setpoint

from dehyst.daemon.loop.status import PLACE
from dehyst.daemon.rings.records import Flag, State
from dehyst.drivers.interface import DeviceGone, DeviceTimeout, DriverError, OutOfRange
from dehyst.drivers.nidaqmx import NidaqmxActuator, NidaqmxSensor

ACTUATOR = {"channel": "Dev1/ao0", "gain": 15.0, "timeout_s": 0.05}
SENSOR = {"channel": "Mod1/ai0", "um_per_v_per_v": 8000.0, "zero_v_per_v": 2e-4, "timeout_s": 0.07}
LOOPS = pytest.mark.parametrize("compiled", [False, True], ids=["python", "compiled"])
pytestmark = pytest.mark.processes  # because of the compiler
names = (f"daqmx-{i}" for i in itertools.count())


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> str:
    return compile_library(tmp_path_factory.mktemp("standin"))


@pytest.fixture
def standin(library: str, monkeypatch: pytest.MonkeyPatch) -> Standin:
    return Standin(library, monkeypatch)


def opened() -> tuple[NidaqmxActuator, NidaqmxSensor]:
    devices = NidaqmxActuator.from_settings(ACTUATOR), NidaqmxSensor.from_settings(SENSOR)
    for device in devices:
        device.open()
    return devices


def raised(call: Any, *arguments: Any) -> type[DriverError]:
    with pytest.raises(DriverError) as error:
        call(*arguments)
    return error.type


def test_a_write_arrives_as_the_python_call_writes_it(standin: Standin) -> None:
    actuator, _ = opened()
    direct = direct_of(actuator)
    for volts in (0.0, 150.0, 7.3, 1 / 3, 149.999999):
        actuator.write(volts)
        by_python = standin.device.output_v
        standin.device.output_v = -1.0
        assert direct_calls.write(direct, volts) is None
        assert standin.device.output_v == by_python == volts / 15.0
        assert actuator.output() == volts
    assert standin.device.timeout_s == 0.05


def test_a_reading_is_the_one_of_the_python_call(standin: Standin) -> None:
    _, sensor = opened()
    direct = direct_of(sensor)
    for volts in (0.0, 3.3, 10.0):
        standin.device.output_v = volts
        standin.device.calls = 0
        by_python = [sensor.read() for _ in range(10)]
        standin.device.calls = 0
        assert [direct_calls.read(direct) for _ in range(10)] == by_python
        # a bridge ratio of 1e-4 per volt above its zero, times 8000 um
        assert by_python[6] == pytest.approx(volts * 0.8, abs=1e-9)
    assert standin.device.timeout_s == 0.07


@pytest.mark.parametrize("ratio", [0.0251, -0.0251, 3.0, math.inf, math.nan])
def test_a_bridge_out_of_its_range_is_nan(standin: Standin, ratio: float) -> None:
    _, sensor = opened()
    standin.device.broken_ratio = ratio
    assert math.isnan(sensor.read())
    value = direct_calls.read(direct_of(sensor))
    assert isinstance(value, float)
    assert math.isnan(value)


@pytest.mark.parametrize("volts", [-0.001, 150.001, 1e6, -math.inf, math.inf, math.nan])
def test_a_voltage_out_of_range_never_reaches_the_library(standin: Standin, volts: float) -> None:
    actuator, _ = opened()
    direct = direct_of(actuator)
    direct_calls.write(direct, 30.0)
    calls = standin.device.calls
    assert isinstance(direct_calls.write(direct, volts), OutOfRange)
    assert standin.device.calls == calls
    assert (standin.device.output_v, actuator.output()) == (2.0, 30.0)


@pytest.mark.parametrize(
    ("status", "kind"),
    [(-200284, DeviceTimeout), (-200292, DeviceTimeout), (-200474, DeviceTimeout),
     (-200560, DeviceTimeout), (-200324, DeviceGone), (-200088, DeviceGone), (-1, DeviceGone)],
)  # fmt: skip
def test_a_failing_call_is_the_fault_that_python_makes_of_it(
    standin: Standin, status: int, kind: type
) -> None:
    actuator, sensor = opened()
    write, read = direct_of(actuator), direct_of(sensor)
    direct_calls.write(write, 30.0)
    standin.fail(status)
    for error in (direct_calls.write(write, 45.0), direct_calls.read(read)):
        assert type(error) is kind
        assert f"words of the library for {status}" in str(error)
        assert str(error).startswith("nidaqmx ")
    assert actuator.output() == 30.0
    assert raised(actuator.write, 45.0) is kind
    assert raised(sensor.read) is kind


def test_a_warning_is_no_fault(standin: Standin) -> None:
    actuator, sensor = opened()
    standin.device.warning = 200012
    assert direct_calls.write(direct_of(actuator), 30.0) is None
    assert isinstance(direct_calls.read(direct_of(sensor)), float)


def test_a_closed_channel_is_gone_and_serves_again_when_it_is_open(standin: Standin) -> None:
    actuator, sensor = opened()
    write, read = direct_of(actuator), direct_of(sensor)
    for device in (actuator, sensor):
        device.close()
    calls = standin.device.calls
    assert isinstance(direct_calls.write(write, 30.0), DeviceGone)
    assert isinstance(direct_calls.read(read), DeviceGone)
    assert standin.device.calls == calls
    standin.device.task = 0xBEEF  # the library returns another handle this time
    for device in (actuator, sensor):
        device.reconnect()
    assert direct_calls.write(write, 30.0) is None
    assert isinstance(direct_calls.read(read), float)


def test_without_the_library_or_a_handle_only_python_reaches_it(
    standin: Standin, monkeypatch: pytest.MonkeyPatch
) -> None:
    actuator, _ = opened()
    actuator._task._handle = None  # a task on another computer has none
    actuator.close()
    assert actuator.direct() is None
    actuator.open()
    assert actuator.direct() is not None
    monkeypatch.setattr("dehyst.drivers.nidaqmx.direct_calls.find_library", lambda name: None)
    assert actuator.direct() is None


@pytest.mark.parametrize("mode", ["static", "preview"])
def test_both_loops_give_the_same_records(
    library: str, monkeypatch: pytest.MonkeyPatch, mode: str
) -> None:
    records, outputs = [], []
    for compiled in (False, True):
        standin = Standin(library, monkeypatch)
        devices = opened()
        standin.device.calls = 0  # how often an input was timed is not part of the step
        rig = Rig(next(names), mode, [300_000, 0, 1_400_000], devices=devices)
        batches = [setpoint(4.0), setpoint(-3.0), setpoint(9.0), setpoint(2.0)]
        records.append(rig.play(batches, 150, compiled))
        records[-1]["cause"] = 0  # the cause of this machine's delay is not part of the step
        outputs.append(standin.device.output_v)
    assert records[0].tobytes() == records[1].tobytes()
    assert outputs[0] == outputs[1] == records[1]["volts"][-1] / 15.0
    assert np.ptp(records[1]["measured"]) > 3.0


@LOOPS
@pytest.mark.parametrize(("status", "kind"), [(-200284, "DeviceTimeout"), (-200324, "DeviceGone")])
def test_a_failing_call_in_the_loop_is_reported_by_its_kind_and_the_output_stays(
    standin: Standin, compiled: bool, status: int, kind: str
) -> None:
    rig = Rig(next(names), devices=opened())
    rig.play([setpoint(9.0)], 60, compiled)
    held = standin.device.output_v
    standin.plugged = False
    standin.fail(status)
    records = rig.play([setpoint(1.0)], 60, compiled)[60:]
    assert records["flags"][0] & (Flag.WRITE_FAILED | Flag.SENSOR_INVALID)
    assert State(records["state"][-1]) is State.FAULT
    assert standin.device.output_v == held
    assert held > 0.0
    reported = [str(event["text"]) for event in rig.rings["event"].read(0)[0]]
    assert any(kind in text and str(status) in text for text in reported), reported


@LOOPS
def test_an_unplugged_device_comes_back(standin: Standin, compiled: bool) -> None:
    rig = Rig(next(names), devices=opened())
    rig.play([setpoint(9.0)], 60, compiled)
    held = standin.device.output_v
    standin.plugged = False
    rig.play([setpoint(1.0)], 60, compiled)
    standin.plugged = True
    end_s = time.monotonic() + 20.0
    while not (
        rig.monitor.numbers[PLACE["actuator_ok"]] and rig.monitor.numbers[PLACE["sensor_ok"]]
    ):
        assert time.monotonic() < end_s, "it did not come back"
        rig.play([setpoint(1.0)], 20, compiled)
        time.sleep(0.01)  # the reconnecting thread runs in real time
    records = rig.play([setpoint(1.0)], 900, compiled)
    steps = np.abs(np.diff(records["volts"][60:]))
    assert records["volts"][60] == pytest.approx(held * 15.0)
    assert np.nanmax(steps) <= 4.0 * (1 + 1e-9)  # 4000 V/s at 1 kHz: it moved, and did not jump
    assert standin.device.output_v == records["volts"][-1] / 15.0
