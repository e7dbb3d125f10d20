"""The NI-DAQmx drivers on a stand-in of the vendor's package.

The stand-in has the names and signatures of nidaqmx 1.0 that the drivers call, and records what it
is asked. It proves nothing about the hardware.
"""

import inspect
import itertools
import math
import sys
from types import ModuleType, SimpleNamespace
from typing import Any, ClassVar

import pytest

from dehyst.drivers.contract import ActuatorContract, SensorContract
from dehyst.drivers.interface import (
    DeviceGone,
    DeviceNotFound,
    DeviceTimeout,
    DriverConfigError,
    ForeignUnit,
    UnitIdentity,
)
from dehyst.drivers.nidaqmx import NidaqmxActuator, NidaqmxSensor

VOLTAGE = {"channel": "a", "input": "voltage", "um_per_v": 2.0}


class Error(Exception):
    """Stands in for nidaqmx.errors.Error."""


class DaqNotFoundError(Error):
    """Stands in for nidaqmx.errors.DaqNotFoundError: the package without the NI driver."""


class DaqError(Error):
    """Stands in for nidaqmx.errors.DaqError."""

    def __init__(self, message: str, error_code: int) -> None:
        super().__init__(message)
        self.error_code = error_code


class Vendor:
    """One simulated device: its output voltage, and what its bridge shows."""

    installed = True
    plugged = True
    status = 0
    output_v = 0.0
    ratio = 0.001
    product_type = "PXIe-4330"
    dev_serial_num = 0x1A2B3C
    channels: ClassVar[list[tuple[str, dict[str, Any]]]] = []


class Task:
    """Stands in for nidaqmx.Task."""

    def __init__(self) -> None:
        if not Vendor.installed:
            raise DaqNotFoundError("Could not find an installation of NI-DAQmx.")
        self.closed = False
        self.ao_channels = SimpleNamespace(add_ao_voltage_chan=self._ao)
        self.ai_channels = SimpleNamespace(
            add_ai_bridge_chan=self._ai, add_ai_voltage_chan=self._ai
        )
        self.devices = [Vendor]

    def _ao(
        self, physical_channel: str, name: str = "", min_val: float = -10, max_val: float = 10
    ) -> None:
        self.limits = (min_val, max_val)
        Vendor.channels.append((physical_channel, {"min_val": min_val, "max_val": max_val}))

    def _ai(self, physical_channel: str, **options: Any) -> None:
        Vendor.channels.append((physical_channel, options))

    def _check(self) -> None:
        if not Vendor.plugged:
            raise DaqError("Device is not available.\nStatus Code: -200324", -200324)
        if Vendor.status:
            raise DaqError(f"No words.\nStatus Code: {Vendor.status}", Vendor.status)
        assert not self.closed

    def start(self) -> None:
        self._check()

    def write(self, data: float, auto_start: bool = True, timeout: float = 10.0) -> None:
        self._check()
        assert self.limits[0] - 1e-9 <= data <= self.limits[1] + 1e-9
        Vendor.output_v = data

    def read(
        self, number_of_samples_per_channel: int | None = None, timeout: float = 10.0
    ) -> float | list[float]:
        self._check()
        count = number_of_samples_per_channel
        return Vendor.ratio if count is None else [Vendor.ratio] * count

    def close(self) -> None:
        self.closed = True


@pytest.fixture(autouse=True)
def vendor(monkeypatch: pytest.MonkeyPatch) -> None:
    package: Any = ModuleType("nidaqmx")
    package.Task = Task
    package.errors = SimpleNamespace(Error=Error, DaqError=DaqError)
    package.constants = SimpleNamespace(
        BridgeUnits=SimpleNamespace(VOLTS_PER_VOLT="V/V"),
        BridgeConfiguration=SimpleNamespace(FULL_BRIDGE="full"),
        ExcitationSource=SimpleNamespace(INTERNAL="internal"),
        TerminalConfiguration=SimpleNamespace(DEFAULT="default", PSEUDO_DIFF="pseudo"),
    )
    monkeypatch.setitem(sys.modules, "nidaqmx", package)
    monkeypatch.setattr("dehyst.drivers.nidaqmx.direct_calls.find_library", lambda name: None)
    Vendor.installed, Vendor.plugged, Vendor.status = True, True, 0
    Vendor.output_v, Vendor.ratio, Vendor.dev_serial_num = 0.0, 0.001, 0x1A2B3C
    Vendor.channels.clear()


class TestNidaqmxActuator(ActuatorContract):
    def make(self) -> NidaqmxActuator:
        return NidaqmxActuator.from_settings({"channel": "Dev1/ao0", "gain": 15.0})

    def true_output(self, device: NidaqmxActuator) -> float:
        return Vendor.output_v * 15.0

    def unplug(self, device: NidaqmxActuator) -> None:
        Vendor.plugged = False

    def replug(self, device: NidaqmxActuator) -> None:
        Vendor.plugged = True


class TestNidaqmxSensor(SensorContract):
    tolerance = 1e-9

    def make(self) -> NidaqmxSensor:
        return NidaqmxSensor.from_settings(
            {"channel": "Mod1/ai0", "um_per_v_per_v": 8000.0, "zero_v_per_v": 0.0002}
        )

    def true_value(self, device: NidaqmxSensor) -> float:
        return (0.001 - 0.0002) * 8000.0

    def unplug(self, device: NidaqmxSensor) -> None:
        Vendor.plugged = False

    def replug(self, device: NidaqmxSensor) -> None:
        Vendor.plugged = True


class TestNidaqmxVoltage(TestNidaqmxSensor):
    """A monitor of 0 to 10 V that falls with the displacement, as a mean of five samples."""

    def make(self) -> NidaqmxSensor:
        Vendor.ratio = 7.5
        return NidaqmxSensor.from_settings(
            {"channel": "Dev1/ai0", "input": "voltage", "um_per_v": -2.0, "zero_v": 9.0,
             "average": 5}
        )  # fmt: skip

    def true_value(self, device: NidaqmxSensor) -> float:
        return 3.0


class TestNidaqmxInverting(TestNidaqmxActuator):
    """An amplifier of gain -20 whose output is 0 V at 5 V."""

    def make(self) -> NidaqmxActuator:
        settings = {"channel": "Dev1/ao0", "gain": -20.0, "zero_v": 5.0, "max_v": 100.0}
        return NidaqmxActuator.from_settings({**settings, "device_min_v": 0.0, "initial_v": 100.0})

    def true_output(self, device: NidaqmxActuator) -> float:
        return (Vendor.output_v - 5.0) * -20.0


def test_channels_are_made_as_the_vendor_wants_them() -> None:
    actuator = NidaqmxActuator.from_settings({"channel": "Dev1/ao0", "gain": 10.0, "max_v": 100})
    actuator.open()
    assert Vendor.channels[-1] == ("Dev1/ao0", {"min_val": 0.0, "max_val": 10.0})
    actuator.write(75.0)
    assert Vendor.output_v == 7.5
    sensor = NidaqmxSensor.from_settings({"channel": "Mod1/ai0", "um_per_v_per_v": 8000.0})
    sensor.open()
    name, options = Vendor.channels[-1]
    assert name == "Mod1/ai0"
    assert (options["units"], options["bridge_config"]) == ("V/V", "full")
    assert options["voltage_excit_val"] == 2.5
    Vendor.ratio = 0.5
    assert math.isnan(sensor.read())


def test_a_voltage_input_is_made_as_it_is_wired() -> None:
    sensor = NidaqmxSensor.from_settings(
        {"channel": "Dev1/ai3", "input": "voltage", "um_per_v": 10.0, "terminals": "pseudo-diff",
         "min_v": -5.0, "max_v": 5.0}
    )  # fmt: skip
    sensor.open()
    assert Vendor.channels[-1] == (
        "Dev1/ai3", {"terminal_config": "pseudo", "min_val": -5.0, "max_val": 5.0}
    )  # fmt: skip
    assert (sensor.spec.minimum, sensor.spec.maximum) == (-50.0, 50.0)
    for volts, um in ((-5.0, -50.0), (5.0, 50.0), (5.0001, math.nan), (-5.1, math.nan)):
        Vendor.ratio = volts
        assert sensor.read() == pytest.approx(um, nan_ok=True)


def test_the_device_is_known_by_its_serial_number() -> None:
    sensor = NidaqmxSensor.from_settings({"channel": "Mod1/ai0", "um_per_v_per_v": 8000.0})
    sensor.open()
    assert sensor.unit == UnitIdentity("1A2B3C", "PXIe-4330", "Mod1/ai0")
    assert sensor.spec.identity == "NI-DAQmx PXIe-4330 serial 1A2B3C bridge Mod1/ai0"
    sensor.close()
    Vendor.dev_serial_num = 0x99
    actuator = NidaqmxActuator.from_settings({"channel": "Dev1/ao0"})
    actuator.expect(UnitIdentity("1A2B3C"))
    for device in (sensor, actuator):
        with pytest.raises(ForeignUnit, match=r"99.*1A2B3C"):
            device.open()
    Vendor.dev_serial_num = 0  # a device that NI simulates
    other = NidaqmxActuator.from_settings({"channel": "Dev1/ao0"})
    other.open()
    assert other.unit is None


def test_a_rate_that_readings_do_not_sustain_is_refused() -> None:
    ticks = itertools.count()
    settings = {"channel": "Mod1/ai0", "um_per_v_per_v": 8000.0, "max_rate_hz": 2000.0}
    sensor = NidaqmxSensor(NidaqmxSensor.settings_type(**settings), lambda: next(ticks) * 1e-3)
    with pytest.raises(DriverConfigError, match=r"max_rate_hz = 2000, .*1 ms.*at most 1000 Hz"):
        sensor.open()


def test_the_stand_ins_have_the_names_of_the_real_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "nidaqmx")
    real = pytest.importorskip("nidaqmx", reason="nidaqmx is not installed")
    from nidaqmx.system import Device
    from nidaqmx.task import InStream
    from nidaqmx.task._timing import Timing
    from nidaqmx.task.collections import AIChannelCollection, AOChannelCollection

    for kind, names in (
        (real.Task, ("ai_channels", "ao_channels", "close", "devices", "in_stream", "read",
                     "start", "timing", "write")),
        (AIChannelCollection, ("add_ai_bridge_chan", "add_ai_voltage_chan")),
        (AOChannelCollection, ("add_ao_voltage_chan",)),
        (InStream, ("offset", "over_write", "relative_to")),
        (Device, ("ao_samp_clk_supported", "dev_serial_num", "product_type")),
        (real.constants.AcquisitionType, ("CONTINUOUS", "HW_TIMED_SINGLE_POINT")),
        (real.constants.OverwriteMode, ("OVERWRITE_UNREAD_SAMPLES",)),
        (real.constants.ReadRelativeTo, ("MOST_RECENT_SAMPLE",)),
        (real.constants.TerminalConfiguration, ("DEFAULT", "RSE", "NRSE", "DIFF", "PSEUDO_DIFF")),
    ):  # fmt: skip
        assert [name for name in names if not hasattr(kind, name)] == [], kind
    takes = inspect.signature(Timing.cfg_samp_clk_timing).parameters
    assert {"rate", "source", "sample_mode", "samps_per_chan"} <= takes.keys()
    takes = inspect.signature(AIChannelCollection.add_ai_voltage_chan).parameters
    assert {"terminal_config", "min_val", "max_val"} <= takes.keys()


def test_without_the_package_the_error_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "nidaqmx", None)  # what import sees if it is missing
    actuator = NidaqmxActuator.from_settings({"channel": "Dev1/ao0"})
    with pytest.raises(DeviceNotFound, match=r"pip install dehyst\[nidaqmx\]"):
        actuator.open()


def test_without_the_vendors_driver_the_error_says_so() -> None:
    Vendor.installed = False
    actuator = NidaqmxActuator.from_settings({"channel": "Dev1/ao0"})
    with pytest.raises(DeviceNotFound, match="find an installation of NI-DAQmx"):
        actuator.open()


@pytest.mark.parametrize(
    ("status", "kind"),
    [(-200284, DeviceTimeout), (-200292, DeviceTimeout), (-200474, DeviceTimeout),
     (-200560, DeviceTimeout), (-200324, DeviceGone), (-200088, DeviceGone), (-1, DeviceGone)],
)  # fmt: skip
def test_what_is_late_is_a_time_out_and_everything_else_is_gone(status: int, kind: type) -> None:
    actuator = NidaqmxActuator.from_settings({"channel": "Dev1/ao0"})
    actuator.open()
    actuator.write(15.0)
    Vendor.status = status
    with pytest.raises(kind, match=f"Dev1/ao0: No words. Status Code: {status}"):
        actuator.write(30.0)
    Vendor.status = 0
    assert actuator.output() == 15.0
    with pytest.raises(DeviceGone, match="not open"):
        actuator.write(30.0)
    actuator.reconnect()
    actuator.write(30.0)
    assert Vendor.output_v == 2.0


def test_a_vanished_device_is_gone_and_close_is_quiet() -> None:
    sensor = NidaqmxSensor.from_settings({"channel": "Mod1/ai0", "um_per_v_per_v": 1.0})
    sensor.open()
    Vendor.plugged = False
    with pytest.raises(DeviceGone, match="-200324"):
        sensor.read()
    sensor.close()


@pytest.mark.parametrize(
    ("kind", "settings", "says"),
    [
        (NidaqmxActuator, {}, "missing"),
        (NidaqmxActuator, {"channel": "a", "gain": 7.5}, "EXT"),
        (NidaqmxActuator, {"channel": "a", "gain": -1}, "gain"),
        (NidaqmxActuator, {"channel": 5}, "channel"),
        (NidaqmxActuator, {"channel": "a", "initial_v": 200.0}, "initial_v"),
        (NidaqmxActuator, {"channel": "a", "gain": 0}, "gain"),
        (NidaqmxActuator, {"channel": "a", "zero_v": 1.0}, "max_v.*it would be 11 V"),
        (NidaqmxActuator, {"channel": "a", "device_max_v": 5.0}, "max_v.*-10 to 5 V of EXT"),
        (NidaqmxActuator, {"channel": "a", "clock_source": "/Dev1/x"}, "clock_source"),
        (NidaqmxActuator, {"channel": "a", "clock_hz": 500.0, "max_rate_hz": 900}, "max_rate_hz"),
        (NidaqmxSensor, {"channel": "a"}, 'um_per_v_per_v.*input = "bridge"'),
        (NidaqmxSensor, {"channel": "a", "input": "voltage"}, 'um_per_v .*input = "voltage"'),
        (NidaqmxSensor, {"channel": "a", "input": "voltage", "um_per_v": 0}, "um_per_v "),
        (NidaqmxSensor, {**VOLTAGE, "min_v": 10.0}, "min_v.*below max_v"),
        (NidaqmxSensor, {**VOLTAGE, "average": 0}, "average"),
        (NidaqmxSensor, {**VOLTAGE, "clock_source": "x"}, "clock_source"),
        (NidaqmxSensor, {**VOLTAGE, "average": 21, "sample_hz": 100.0}, "average.*below.*20"),
        (NidaqmxSensor, {"channel": "a", "um_per_v_per_v": 0}, "um_per_v_per_v"),
        (NidaqmxSensor, {"channel": "a", "um_per_v_per_v": math.nan}, "um_per_v_per_v"),
    ],
)
def test_wrong_settings_are_named(kind: Any, settings: dict, says: str) -> None:
    with pytest.raises(DriverConfigError, match=says):
        kind.from_settings(settings)
