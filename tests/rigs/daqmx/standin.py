"""Stand-ins for NI's C library and Python package that share one device (standin.c).

The package's functions go through the library, so that both loops drive the same device. Names and
signatures are those of nidaqmx 1.0 and NIDAQmx.h. This does not prove that hardware works.
"""

import ctypes
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any, cast

import pytest

SOURCE = Path(__file__).with_name("standin.c")


PLAYS, CHANGES = 8, 256
GAIN, MONITOR_V_PER_UM, MONITOR_ZERO_V, MONITOR_NOISE_V = 15.0, 0.5, 0.25, 1e-3
"""Properties of the amplifier at the output and of the monitor at the input, as in standin.c."""
SERIAL = 0x1D2C3B4


class Device(ctypes.Structure):
    """Mirrors struct device of standin.c."""

    _fields_ = (
        ("task", ctypes.c_int64),
        ("calls", ctypes.c_int64),
        ("fail_in", ctypes.c_int32),
        ("status", ctypes.c_int32),
        ("warning", ctypes.c_int32),
        ("output_v", ctypes.c_double),
        ("timeout_s", ctypes.c_double),
        ("broken_ratio", ctypes.c_double),
        ("clock", ctypes.c_void_p),
        ("output_hz", ctypes.c_double),
        ("sample_hz", ctypes.c_double),
        ("offset", ctypes.c_int32),
        ("monitor", ctypes.c_int32),
        ("r", ctypes.c_double * PLAYS),
        ("b", ctypes.c_double * PLAYS),
        ("w", ctypes.c_double * PLAYS),
        ("edge_ns", ctypes.c_int64),
        ("pending", ctypes.c_int32),
        ("pending_v", ctypes.c_double),
        ("changes", ctypes.c_int64),
        ("change_ns", ctypes.c_int64 * CHANGES),
        ("um", ctypes.c_double * CHANGES),
        ("monitor_um", ctypes.c_double),
    )


class DaqError(Exception):
    """Behaves as nidaqmx.errors.DaqError."""

    def __init__(self, message: str, error_code: int) -> None:
        super().__init__(message)
        self.error_code = error_code


def compile_library(folder: Path) -> str:
    """Compile the stand-in and return its path; skip the test if there is no C compiler."""
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler here to make the stand-in for NI's library with")
    path = folder / "libnidaqmx.so"
    command = [compiler, "-shared", "-fPIC", "-O1", "-Wall", "-Werror", "-o", path, SOURCE, "-lm"]
    command.append("-Wl,-soname,libnidaqmx.so")  # the name by which a process finds it
    subprocess.run(command, check=True)
    return str(path)


class Standin:
    """A fresh device in the library at `path`, and the package on top of it, which replaces the
    vendor's during a test; monkeypatch: None if the caller installs it.

    `plugged = False` removes the device: every call fails, no task can be made.
    """

    def __init__(self, path: str, monkeypatch: pytest.MonkeyPatch | None = None) -> None:
        self.library = ctypes.CDLL(path)
        self.device = Device.in_dll(self.library, "device")
        task = self.device.task
        ctypes.memset(ctypes.addressof(self.device), 0, ctypes.sizeof(self.device))
        self.device.task, self.device.fail_in = task, -1
        self.plugged, self.has_output_clock, self.serial = True, True, SERIAL
        self.asked: list[tuple[str, dict[str, Any]]] = []
        self.package = package = cast(Any, ModuleType("nidaqmx"))
        package.Task = lambda: Task(self)
        package.errors = SimpleNamespace(Error=DaqError, DaqError=DaqError)
        package.constants = SimpleNamespace(
            BridgeUnits=SimpleNamespace(VOLTS_PER_VOLT="V/V"),
            BridgeConfiguration=SimpleNamespace(FULL_BRIDGE="full"),
            ExcitationSource=SimpleNamespace(INTERNAL="internal"),
            TerminalConfiguration=SimpleNamespace(
                DEFAULT="default", RSE="rse", NRSE="nrse", DIFF="diff", PSEUDO_DIFF="pseudo"
            ),
            AcquisitionType=SimpleNamespace(CONTINUOUS="all", HW_TIMED_SINGLE_POINT="point"),
            OverwriteMode=SimpleNamespace(OVERWRITE_UNREAD_SAMPLES="overwrite"),
            ReadRelativeTo=SimpleNamespace(MOST_RECENT_SAMPLE="newest"),
        )
        if monkeypatch is not None:
            monkeypatch.setitem(sys.modules, "nidaqmx", package)
            where = "dehyst.drivers.nidaqmx.direct_calls.find_library"
            monkeypatch.setattr(where, lambda name: path)

    def fail(self, status: int, in_calls: int = 0) -> None:
        """Make calls return `status`, starting after `in_calls` more calls."""
        self.device.status, self.device.fail_in = status, in_calls

    def work(self) -> None:
        """Stop the failures."""
        self.device.fail_in = -1

    @property
    def plugged(self) -> bool:
        """Whether a task can be made and used."""
        return self._plugged

    @plugged.setter
    def plugged(self, value: bool) -> None:
        self._plugged = value
        if value:
            self.work()
        else:
            self.fail(-200324)

    def check(self, status: int) -> None:
        """Raise as the package does."""
        if status < 0:
            raise DaqError(f"words of the package\nStatus Code: {status}", status)


class InStream:
    """Behaves as nidaqmx.task.InStream."""

    over_write = ""
    relative_to = ""

    def __init__(self, standin: Standin) -> None:
        self._standin = standin

    @property
    def offset(self) -> int:
        """The offset of a read from `relative_to`."""
        return int(self._standin.device.offset)

    @offset.setter
    def offset(self, value: int) -> None:
        assert (self.over_write, self.relative_to) == ("overwrite", "newest")
        self._standin.device.offset = value


class Task:
    """Behaves as nidaqmx.Task; every task of a stand-in uses its one device."""

    def __init__(self, standin: Standin) -> None:
        if not standin.plugged:
            raise DaqError("Device identifier is invalid.", -200220)
        if standin.device.task == 0:
            standin.device.task = 0x5EED
        self._standin = standin
        self._handle: ctypes.c_void_p | None = ctypes.c_void_p(standin.device.task)
        self._is_output = False
        self.ao_channels = SimpleNamespace(add_ao_voltage_chan=self._output)
        self.ai_channels = SimpleNamespace(
            add_ai_bridge_chan=self._bridge, add_ai_voltage_chan=self._voltage
        )
        self.timing = SimpleNamespace(cfg_samp_clk_timing=self._clock)
        self.in_stream = InStream(standin)
        self.devices = [
            SimpleNamespace(
                product_type="USB-6212", dev_serial_num=standin.serial,
                ao_samp_clk_supported=standin.has_output_clock,
            )
        ]  # fmt: skip

    def _output(self, physical_channel: str, **options: Any) -> None:
        self._is_output = True
        self._standin.device.output_hz = 0.0
        self._standin.asked.append((physical_channel, options))

    def _bridge(self, physical_channel: str, **options: Any) -> None:
        self._standin.device.monitor = 0
        self._input(physical_channel, options)

    def _voltage(self, physical_channel: str, **options: Any) -> None:
        self._standin.device.monitor = 1
        self._input(physical_channel, options)

    def _input(self, physical_channel: str, options: dict[str, Any]) -> None:
        self._standin.device.sample_hz, self._standin.device.offset = 0.0, 0
        self._standin.asked.append((physical_channel, options))

    def _clock(
        self, rate: float, source: str = "", active_edge: str = "", sample_mode: str = "finite",
        samps_per_chan: int = 1000,
    ) -> None:  # fmt: skip
        self._standin.asked.append(("clock", {"rate": rate, "source": source}))
        if self._is_output:
            assert sample_mode == "point"
            self._standin.device.output_hz = rate
        else:
            assert sample_mode == "all"
            self._standin.device.sample_hz = rate

    def start(self) -> None:
        """Do nothing."""

    def write(self, data: float, auto_start: bool = True, timeout: float = 10.0) -> None:
        """Write one value."""
        function = self._standin.library.DAQmxWriteAnalogScalarF64
        arguments = (1, ctypes.c_double(timeout), ctypes.c_double(data), None)
        self._standin.check(function(self._handle, *arguments))

    def read(
        self, number_of_samples_per_channel: int | None = None, timeout: float = 10.0
    ) -> float | list[float]:
        """Read one value, or a list if a number is given."""
        count, found = number_of_samples_per_channel, ctypes.c_int32()
        values = (ctypes.c_double * (count or 1))()
        if count is None:
            function = self._standin.library.DAQmxReadAnalogScalarF64
            status = function(self._handle, ctypes.c_double(timeout), values, None)
        else:
            function = self._standin.library.DAQmxReadAnalogF64
            arguments = (count, ctypes.c_double(timeout), 0, values, count)
            status = function(self._handle, *arguments, ctypes.byref(found), None)
        self._standin.check(status)
        return values[0] if count is None else list(values)

    def close(self) -> None:
        """Invalidate the handle."""
        self._handle = None
