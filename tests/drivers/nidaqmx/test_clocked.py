"""Voltage input, mean of samples and hardware timing, in both loops, on a stand-in in C.

The stand-in's device has a clock of its own: outputs change and inputs are sampled at its edges.
The output drives a stage with hysteresis, whose displacement is the input's monitor voltage.
"""

import itertools
import math
from typing import Any

import numpy as np
import pytest
from tests.rigs import direct_calls
from tests.rigs.daqmx.standin import (
    MONITOR_NOISE_V,
    MONITOR_V_PER_UM,
    MONITOR_ZERO_V,
    Standin,
    compile_library,
)
from tests.rigs.direct_calls import direct_of
from tests.rigs.two_loops import Rig, model

from dehyst.daemon.rings.records import COMMAND, LoopCommand, State
from dehyst.drivers.contract import ActuatorContract, SensorContract
from dehyst.drivers.interface import DeviceGone, DeviceTimeout, DriverConfigError
from dehyst.drivers.nidaqmx import NidaqmxActuator, NidaqmxSensor
from dehyst.models.drive_design.scans import scan_raster

pytestmark = pytest.mark.processes  # because of the compiler
PERIOD_NS = 100_000
ACTUATOR = {"channel": "Dev1/ao0", "clock_hz": 10_000.0, "clock_source": "/Dev1/ai/SampleClock"}
SENSOR = {"channel": "Dev1/ai0", "input": "voltage", "um_per_v": 1.0 / MONITOR_V_PER_UM,
          "zero_v": MONITOR_ZERO_V, "min_v": -1.0, "average": 5,
          "sample_hz": 100_000.0}  # fmt: skip
NOISE_UM = MONITOR_NOISE_V * 3 / MONITOR_V_PER_UM
names = (f"clocked-{i}" for i in itertools.count())


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> str:
    return compile_library(tmp_path_factory.mktemp("standin"))


@pytest.fixture
def standin(library: str, monkeypatch: pytest.MonkeyPatch) -> Standin:
    return Standin(library, monkeypatch)


@pytest.fixture(autouse=True)
def shared_by_contracts(request: pytest.FixtureRequest, standin: Standin) -> None:
    if request.instance is not None:
        request.instance.standin = standin


class Plug:
    """Unplugs the device for both contracts."""

    standin: Standin

    def unplug(self, device: Any) -> None:
        self.standin.plugged = False

    def replug(self, device: Any) -> None:
        self.standin.plugged = True


class TestClockedActuator(Plug, ActuatorContract):
    def make(self) -> NidaqmxActuator:
        self.time_ns = np.zeros(1, np.int64)
        self.standin.device.clock = self.time_ns.ctypes.data
        return NidaqmxActuator.from_settings(ACTUATOR)

    def true_output(self, device: NidaqmxActuator) -> float:
        self.time_ns += PERIOD_NS  # the next edge; the stand-in updates when it is called
        probe = NidaqmxSensor.from_settings({"channel": "Dev1/ai9", "um_per_v_per_v": 1.0})
        plugged, self.standin.plugged = self.standin.plugged, True
        clock_hz = self.standin.device.output_hz
        probe.open()
        probe.close()
        self.standin.plugged, self.standin.device.output_hz = plugged, clock_hz
        return float(self.standin.device.output_v * 15.0)


class TestSampledSensor(Plug, SensorContract):
    tolerance = NOISE_UM

    def make(self) -> NidaqmxSensor:
        self.standin.device.monitor_um = 4.0
        self.standin.device.changes = 1
        self.standin.device.um[0] = 4.0
        return NidaqmxSensor.from_settings(SENSOR)

    def true_value(self, device: NidaqmxSensor) -> float:
        return 4.0


class TestMeanOnDemand(TestSampledSensor):
    def make(self) -> NidaqmxSensor:
        super().make()
        return NidaqmxSensor.from_settings({**SENSOR, "sample_hz": 1e6, "average": 70})


def opened(kind: Any, settings: dict[str, Any], **more: Any) -> Any:
    device = kind.from_settings({**settings, **more})
    device.open()
    return device


def test_the_clock_is_asked_for_as_the_settings_say(standin: Standin) -> None:
    opened(NidaqmxActuator, ACTUATOR)
    assert standin.asked == [
        ("Dev1/ao0", {"min_val": 0.0, "max_val": 10.0}),
        ("clock", {"rate": 10_000.0, "source": "/Dev1/ai/SampleClock"}),
    ]
    sensor = opened(NidaqmxSensor, SENSOR)
    assert standin.asked[-1] == ("clock", {"rate": 100_000.0, "source": ""})
    assert standin.device.offset == -5
    assert sensor.spec.identity.endswith("voltage Dev1/ai0, mean of 5, sampled at 100000 Hz")


def test_a_device_whose_outputs_have_no_clock_is_named(standin: Standin) -> None:
    standin.has_output_clock = False
    with pytest.raises(DriverConfigError, match="USB-6212 have no clock; leave clock_hz out"):
        opened(NidaqmxActuator, ACTUATOR)
    opened(NidaqmxActuator, {"channel": "Dev1/ao0"})


@pytest.mark.parametrize("clock", [{}, {"sample_hz": None}])
def test_the_mean_is_the_same_in_compiled_code_and_takes_the_noise_away(
    standin: Standin, clock: dict
) -> None:
    time_ns = np.full(1, 10**9, np.int64)
    standin.device.clock = time_ns.ctypes.data
    sensor = opened(NidaqmxSensor, SENSOR, average=7, **clock)
    direct = direct_of(sensor)
    standin.device.output_v = 0.0
    for _ in range(5):
        time_ns += 123_456
        standin.device.calls = 0
        by_python = sensor.read()
        standin.device.calls = 0
        assert direct_calls.read(direct) == by_python
        assert by_python == pytest.approx(0.0, abs=1e-12)  # the noise has a period of 7 samples


def test_an_inverting_amplifier_with_an_offset_is_the_same_in_both(standin: Standin) -> None:
    settings = {"channel": "Dev1/ao0", "gain": -20.0, "zero_v": 5.0}
    actuator = opened(NidaqmxActuator, settings)
    direct = direct_of(actuator)
    for volts, device_v in ((0.0, 5.0), (100.0, 0.0), (150.0, -2.5)):
        actuator.write(volts)
        assert standin.device.output_v == device_v
        standin.device.output_v = 9.0
        assert direct_calls.write(direct, volts) is None
        assert standin.device.output_v == device_v


@pytest.mark.parametrize("volts", [-1.001, 10.001, math.inf, math.nan])
def test_a_sample_out_of_range_is_nan(standin: Standin, volts: float) -> None:
    sensor = opened(NidaqmxSensor, SENSOR)
    standin.device.broken_ratio = volts
    assert math.isnan(sensor.read())
    value = direct_calls.read(direct_of(sensor))
    assert isinstance(value, float)
    assert math.isnan(value)


@pytest.mark.parametrize(("status", "kind"), [(-200284, DeviceTimeout), (-200279, DeviceGone)])
def test_a_failing_read_of_samples_is_the_same_fault_in_both(
    standin: Standin, status: int, kind: type
) -> None:
    sensor = opened(NidaqmxSensor, SENSOR)
    direct = direct_of(sensor)
    standin.fail(status)
    error = direct_calls.read(direct)
    assert type(error) is kind
    with pytest.raises(kind, match=str(status)):
        sensor.read()


def stage_in(standin: Standin) -> None:
    """Give the stand-in's stage the hysteresis of the rig's model."""
    hysteresis = model().hysteresis
    standin.device.r[:] = hysteresis.r
    standin.device.b[:] = hysteresis.b


def raster() -> np.ndarray:
    """Return six lines of 8 um at 10 kHz, and the return to the start, as one trajectory."""
    scan = scan_raster(8.0, 4.0, 6, 0.04, PERIOD_NS * 1e-9)
    batch = np.zeros(scan.x.size, COMMAND)
    batch["kind"], batch["trajectory"] = LoopCommand.POINT, 1
    batch["offset_ns"] = np.arange(scan.x.size) * PERIOD_NS
    batch["value"] = 6.0 + scan.x
    batch["last"][-1] = 1
    return batch


LATE_NS = [0, 30_000, 55_000, 10_000, 42_000]
"""How late the loop wakes, cyclically: before the next edge, at uneven intervals."""


def scanned(
    library: str, monkeypatch: pytest.MonkeyPatch, compiled: bool, clocked: bool
) -> tuple[np.ndarray, Standin]:
    """Return the records of a raster at 10 kHz, and the device that it ran on."""
    standin = Standin(library, monkeypatch)
    stage_in(standin)
    plain = {"channel": "Dev1/ao0", "max_rate_hz": 10_000.0}
    devices = (opened(NidaqmxActuator, ACTUATOR if clocked else plain),
               opened(NidaqmxSensor, SENSOR))  # fmt: skip
    rig = Rig(next(names), "static", LATE_NS, devices=devices, period_ns=PERIOD_NS)
    clock = rig.words if compiled else rig.clock.cell
    standin.device.clock = clock.ctypes.data
    points = raster()
    records = rig.play([points], points.size + 200, compiled)
    records["cause"] = 0  # the cause of this machine's delay is not part of the step
    return records, standin


def test_a_raster_at_10_khz_is_the_same_in_both_loops(
    library: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    python, compiled = (scanned(library, monkeypatch, c, True)[0] for c in (False, True))
    assert python.tobytes() == compiled.tobytes()


def test_a_raster_in_the_compiled_loop_is_on_its_lines_at_every_edge_of_the_clock(
    library: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    records, standin = scanned(library, monkeypatch, True, True)
    playing = records["state"] == State.RUNNING
    assert playing.sum() >= raster().size
    target, measured = records["target"], records["measured"]
    assert np.ptp(target[playing]) > 8.0
    # a voltage reaches the stage at the next edge; the five samples of 10 us before a reading are
    # on both sides of that edge, so the reading lies between this target and the previous one
    pairs = np.stack([target[:-1], target[1:]])
    low, high = pairs.min(axis=0) - NOISE_UM, pairs.max(axis=0) + NOISE_UM
    both = playing[1:] & playing[:-1]
    assert np.all((low <= measured[1:]) & (measured[1:] <= high) | ~both)
    # the loop wakes at uneven times, but the voltage changes at even ones
    number = int(standin.device.changes)
    last = [(number - 1 - i) % 256 for i in range(200)]
    at_ns = np.array([standin.device.change_ns[i] for i in last])
    assert np.ptp(records["actual_ns"] - records["scheduled_ns"]) > 50_000
    assert set((at_ns % PERIOD_NS).tolist()) == {0}


def test_without_the_clock_the_voltage_changes_when_the_loop_wakes(
    library: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, standin = scanned(library, monkeypatch, True, False)
    number = int(standin.device.changes)
    at_ns = np.array([standin.device.change_ns[(number - 1 - i) % 256] for i in range(200)])
    assert np.ptp(at_ns % PERIOD_NS) > 50_000
