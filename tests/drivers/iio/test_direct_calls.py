"""IIO channels called by compiled code, on files laid out like sysfs and on a kernel file."""

import itertools
import math
import resource
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.rigs import direct_calls
from tests.rigs.direct_calls import direct_of
from tests.rigs.sysfs import KernelFile, lay_out, put_back, take_away
from tests.rigs.two_loops import Rig, setpoint

from dehyst.daemon.loop.status import PLACE
from dehyst.daemon.rings.records import Flag, State
from dehyst.drivers.iio import IioActuator, IioSensor
from dehyst.drivers.iio.channel import fault_of
from dehyst.drivers.interface import (
    DeviceGone,
    DeviceTimeout,
    DriverError,
    OutOfRange,
    ProtocolError,
)

SCALE_MV = 10000 / 65535  # 16 bits over 10 V
LOOPS = pytest.mark.parametrize("compiled", [False, True], ids=["python", "compiled"])
names = (f"iio-{i}" for i in itertools.count())


def stage(folder: Path) -> Path:
    """Return a converter whose input is wired to its output."""
    files = {"name": "wired", "out_voltage0_raw": "0", "out_voltage0_scale": str(SCALE_MV)}
    lay_out(folder, {**files, "in_voltage0_scale": str(SCALE_MV), "in_voltage0_offset": "3"})
    (folder / "in_voltage0_raw").symlink_to("out_voltage0_raw")
    return folder


def opened(folder: Path, **more: Any) -> tuple[IioActuator, IioSensor]:
    where = {"path": str(folder)}
    scale = {"um_per_mv": 0.0012, "zero_mv": 1.5, "bits": 17, "unsigned": True}
    devices = (
        IioActuator.from_settings(where | more), IioSensor.from_settings(where | scale)
    )  # fmt: skip
    for device in devices:
        device.open()
    return devices


def outcome(call: Any, *arguments: Any) -> Any:
    """Return the call's result, or the error that it raises."""
    try:
        return call(*arguments)
    except DriverError as error:
        return error


@given(st.floats(0.0, 150.0))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_write_puts_the_same_bytes_into_the_file(tmp_path: Path, volts: float) -> None:
    folder = tmp_path / "d"
    actuator, _ = opened(folder if folder.exists() else stage(folder))
    file = folder / "out_voltage0_raw"
    file.write_text("")
    actuator.write(volts)
    by_python = file.read_bytes()
    file.write_text("")
    assert direct_calls.write(direct_of(actuator), volts) is None
    assert file.read_bytes() == by_python
    assert int(by_python) == pytest.approx(volts * 65535 / 150.0, abs=0.5 + 1e-6)
    assert actuator.output() == volts


TEXTS = st.one_of(
    st.integers(-(2**40), 2**40).map(lambda n: f"{n}\n".encode()),
    st.text("0123456789 +-\n\0x.", max_size=25).map(str.encode),
    st.binary(max_size=70),
    st.sampled_from([b"12345678901234567890\n", b"-\n", b"", b"7", b" 7 \n8", b"+0\n", b"1 2\n"]),
)


@given(TEXTS)
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_text_is_the_reading_or_the_fault_that_python_makes_of_it(
    tmp_path: Path, text: bytes
) -> None:
    folder = tmp_path / "d"
    file = folder / "out_voltage0_raw"
    if not folder.exists():
        stage(folder)
    file.write_text("0\n")
    _, sensor = opened(folder)
    file.write_bytes(text)
    by_python = outcome(sensor.read)
    direct = direct_calls.read(direct_of(sensor))
    assert type(direct) is type(by_python)
    if isinstance(by_python, float):
        assert direct == by_python or (math.isnan(by_python) and math.isnan(direct))
    else:
        assert str(direct) == str(by_python)
    sensor.close()


@pytest.mark.parametrize("counts", [0, 2**17 - 1])
def test_a_converter_at_its_end_is_nan(tmp_path: Path, counts: int) -> None:
    _, sensor = opened(stage(tmp_path / "d"))
    (tmp_path / "d" / "out_voltage0_raw").write_text(f"{counts}\n")
    value = direct_calls.read(direct_of(sensor))
    assert isinstance(value, float)
    assert math.isnan(value)
    assert math.isnan(sensor.read())


@pytest.mark.parametrize("volts", [-0.001, 150.001, 1e9, -math.inf, math.inf, math.nan])
def test_a_voltage_out_of_range_never_reaches_the_file(tmp_path: Path, volts: float) -> None:
    actuator, _ = opened(stage(tmp_path / "d"))
    direct = direct_of(actuator)
    direct_calls.write(direct, 30.0)
    assert isinstance(direct_calls.write(direct, volts), OutOfRange)
    assert (tmp_path / "d" / "out_voltage0_raw").read_text() == "13107\n"
    assert actuator.output() == 30.0


def test_a_closed_channel_is_gone_and_serves_again_when_it_is_open(tmp_path: Path) -> None:
    folder = stage(tmp_path / "d")
    actuator, sensor = opened(folder)
    write, read = direct_of(actuator), direct_of(sensor)
    for device in (actuator, sensor):
        device.close()
    assert isinstance(direct_calls.write(write, 30.0), DeviceGone)
    assert isinstance(direct_calls.read(read), DeviceGone)
    assert (folder / "out_voltage0_raw").read_text() == "0\n"
    for device in (actuator, sensor):
        device.reconnect()
    assert direct_calls.write(write, 30.0) is None
    assert direct_calls.read(read) == sensor.read()


@pytest.mark.processes
def test_the_faults_of_a_kernel_file_are_those_of_the_python_calls(tmp_path: Path) -> None:
    kept = KernelFile()
    try:
        folder = stage(tmp_path / "d")
        (folder / "out_voltage0_scale").write_text("1\n")
        (folder / "out_voltage0_raw").unlink()
        (folder / "out_voltage0_raw").symlink_to(kept.path)
        actuator, sensor = opened(folder, gain=10.0, max_v=20.0)  # the kernel takes 1000 counts
        write, read = direct_of(actuator), direct_of(sensor)
        assert direct_calls.write(write, 9.0) is None
        assert kept.path.read_text() == "900\n"
        assert direct_calls.read(read) == sensor.read()
        for error in (direct_calls.write(write, 11.0), outcome(actuator.write, 11.0)):
            assert type(error) is ProtocolError
            assert str(error).endswith("Invalid argument")
        assert actuator.output() == 9.0
    finally:
        kept.end()
    for error in (
        direct_calls.write(write, 9.0), outcome(actuator.write, 9.0),
        direct_calls.read(read), outcome(sensor.read),
    ):  # fmt: skip
        assert type(error) is DeviceGone
        assert str(error).endswith("No such process")


def test_a_kernel_driver_that_waited_in_vain_is_a_time_out() -> None:
    assert type(fault_of(Path("x"), 110)) is DeviceTimeout  # ETIMEDOUT
    assert type(fault_of(Path("x"), 19)) is DeviceGone  # ENODEV
    assert type(fault_of(Path("x"), 22)) is ProtocolError  # EINVAL


@pytest.mark.parametrize("mode", ["static", "preview"])
def test_both_loops_give_the_same_records(tmp_path: Path, mode: str) -> None:
    records, outputs = [], []
    for compiled in (False, True):
        folder = stage(tmp_path / str(compiled))
        rig = Rig(next(names), mode, [300_000, 0, 1_400_000], devices=opened(folder))
        batches = [setpoint(4.0), setpoint(-3.0), setpoint(9.0), setpoint(2.0)]
        records.append(rig.play(batches, 150, compiled))
        records[-1]["cause"] = 0  # the cause of this machine's delay is not part of the step
        outputs.append((folder / "out_voltage0_raw").read_text().split("\n")[0])
    assert records[0].tobytes() == records[1].tobytes()
    assert outputs[0] == outputs[1]
    assert int(outputs[0]) == round(records[1]["volts"][-1] * 65535 / 150.0)
    assert np.nanmax(records[1]["measured"]) > 3.0


@LOOPS
def test_a_device_that_goes_is_a_fault_in_the_loop_and_comes_back(
    tmp_path: Path, compiled: bool
) -> None:
    folder = stage(tmp_path / "d")
    rig = Rig(next(names), devices=opened(folder))
    rig.play([setpoint(9.0)], 60, compiled)
    held = (folder / "out_voltage0_raw").read_text()
    take_away(folder)
    records = rig.play([setpoint(9.0)], 60, compiled)[60:]
    assert records["flags"][0] & (Flag.WRITE_FAILED | Flag.SENSOR_INVALID)
    reported = [str(event["text"]) for event in rig.rings["event"].read(0)[0]]
    assert any("DeviceGone" in text for text in reported), reported
    put_back(folder)
    end_s = time.monotonic() + 20.0
    while not rig.monitor.numbers[PLACE["sensor_ok"]]:
        assert time.monotonic() < end_s, "it did not come back"
        rig.play([setpoint(9.0)], 20, compiled)
        time.sleep(0.01)  # the reconnecting thread runs in real time
    assert held.endswith("\n")
    records = rig.play([setpoint(9.0)], 900, compiled)
    assert State(records["state"][-1]) is not State.FAULT
    assert np.isfinite(records["measured"][-1])
    steps = np.abs(np.diff(records["volts"]))
    assert np.nanmax(steps) <= 4.0 * (1 + 1e-9)  # 4000 V/s at 1 kHz


def test_a_call_takes_no_new_memory(tmp_path: Path) -> None:
    actuator, sensor = opened(stage(tmp_path / "d"))
    write, read = direct_of(actuator), direct_of(sensor)
    for _ in range(200):
        direct_calls.write(write, 30.0)
        direct_calls.read(read)
    before = resource.getrusage(resource.RUSAGE_THREAD).ru_minflt
    for _ in range(2000):
        direct_calls.write(write, 60.0)
        direct_calls.read(read)
    assert resource.getrusage(resource.RUSAGE_THREAD).ru_minflt - before <= 20  # Python's own
