"""NI's C library and Python package as stand-ins that share one device (standin.c).

The package's functions go through the library, so that both loops drive the same device. Names
and signatures are those of nidaqmx 1.0 and NIDAQmx.h. It is no proof for the hardware.
"""

import ctypes
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

SOURCE = Path(__file__).with_name("standin.c")


class Device(ctypes.Structure):
    """struct device of standin.c."""

    _fields_ = (
        ("task", ctypes.c_int64),
        ("calls", ctypes.c_int64),
        ("fail_in", ctypes.c_int32),
        ("status", ctypes.c_int32),
        ("warning", ctypes.c_int32),
        ("output_v", ctypes.c_double),
        ("timeout_s", ctypes.c_double),
        ("broken_ratio", ctypes.c_double),
    )


class DaqError(Exception):
    """As nidaqmx.errors.DaqError."""

    def __init__(self, message: str, error_code: int) -> None:
        super().__init__(message)
        self.error_code = error_code


def compile_library(folder: Path) -> str:
    """The stand-in's path; skips where there is no C compiler."""
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler here to make the stand-in for NI's library with")
    path = folder / "libnidaqmx-standin.so"
    command = [compiler, "-shared", "-fPIC", "-O1", "-Wall", "-Werror", "-o", path, SOURCE]
    subprocess.run(command, check=True)
    return str(path)


class Standin:
    """A fresh device behind the library at `path`, and the package in front of it.

    `plugged = False` takes it away: every call fails, no task can be made.
    """

    def __init__(self, path: str, monkeypatch: pytest.MonkeyPatch) -> None:
        self.library = ctypes.CDLL(path)
        self.device = Device.in_dll(self.library, "device")
        self.device.calls, self.device.fail_in, self.device.warning = 0, -1, 0
        self.device.output_v = self.device.broken_ratio = 0.0
        self.plugged = True
        self._next_task = 1
        package: Any = ModuleType("nidaqmx")
        package.Task = lambda: Task(self)
        package.errors = SimpleNamespace(Error=DaqError, DaqError=DaqError)
        package.constants = SimpleNamespace(
            BridgeUnits=SimpleNamespace(VOLTS_PER_VOLT="V/V"),
            BridgeConfiguration=SimpleNamespace(FULL_BRIDGE="full"),
            ExcitationSource=SimpleNamespace(INTERNAL="internal"),
        )
        monkeypatch.setitem(sys.modules, "nidaqmx", package)
        monkeypatch.setattr("dehyst.drivers.nidaqmx.direct_calls.find_library", lambda name: path)

    def fail(self, status: int, in_calls: int = 0) -> None:
        """Calls return `status` from the one after `in_calls` on."""
        self.device.status, self.device.fail_in = status, in_calls

    def work(self) -> None:
        """No more failing calls."""
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


class Task:
    """As nidaqmx.Task; all tasks of a stand-in are good for its one device."""

    def __init__(self, standin: Standin) -> None:
        if not standin.plugged:
            raise DaqError("Device identifier is invalid.", -200220)
        if standin.device.task == 0:
            standin.device.task = 0x5EED
        self._standin = standin
        self._handle: ctypes.c_void_p | None = ctypes.c_void_p(standin.device.task)
        self.ao_channels = SimpleNamespace(add_ao_voltage_chan=lambda *a, **k: None)
        self.ai_channels = SimpleNamespace(add_ai_bridge_chan=lambda *a, **k: None)

    def start(self) -> None:
        """Nothing to do."""

    def write(self, data: float, auto_start: bool = True, timeout: float = 10.0) -> None:
        """One value."""
        function = self._standin.library.DAQmxWriteAnalogScalarF64
        arguments = (1, ctypes.c_double(timeout), ctypes.c_double(data), None)
        self._standin.check(function(self._handle, *arguments))

    def read(self, number_of_samples_per_channel: int = 1, timeout: float = 10.0) -> float:
        """One value."""
        value = ctypes.c_double()
        function = self._standin.library.DAQmxReadAnalogScalarF64
        status = function(self._handle, ctypes.c_double(timeout), ctypes.byref(value), None)
        self._standin.check(status)
        return value.value

    def close(self) -> None:
        """The handle is good no more."""
        self._handle = None
