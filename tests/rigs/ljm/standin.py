"""A stand-in for LabJack's LJM library (standin.c) under the vendor's own Python package.

Names and signatures are those of LabJackM.h. This does not prove that hardware works.
"""

import contextlib
import ctypes
import io
import shutil
import subprocess
from pathlib import Path

import pytest

SOURCE = Path(__file__).with_name("standin.c")
REGISTERS, NAME = 32, 32


class Unit(ctypes.Structure):
    """Mirrors struct unit of standin.c."""

    _fields_ = (
        ("handle", ctypes.c_int32),
        ("is_open", ctypes.c_int32),
        ("plugged", ctypes.c_int32),
        ("kind", ctypes.c_int32),
        ("serial", ctypes.c_int32),
        ("fail_in", ctypes.c_int32),
        ("status", ctypes.c_int32),
        ("opened", ctypes.c_int32),
        ("calls", ctypes.c_int64),
        ("broken_v", ctypes.c_double),
        ("timeout_ms", ctypes.c_double),
        ("count", ctypes.c_int32),
        ("names", (ctypes.c_char * NAME) * REGISTERS),
        ("values", ctypes.c_double * REGISTERS),
    )

    def register(self, name: str) -> float:
        """Return what was last written to a register; 0 if nothing was."""
        for i in range(self.count):
            if self.names[i].value == name.encode():
                return float(self.values[i])
        return 0.0


def compile_library(folder: Path) -> str:
    """Compile the stand-in and return its path; skip the test if there is no C compiler."""
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler here to make the stand-in for LabJack's library with")
    path = folder / "libLabJackM-standin.so"
    command = [compiler, "-shared", "-fPIC", "-O1", "-Wall", "-Werror", "-o", path, SOURCE]
    subprocess.run(command, check=True)
    return str(path)


def plug(path: str, monkeypatch: pytest.MonkeyPatch) -> Unit:
    """Put a fresh unit in the library at `path`, below the package."""
    with contextlib.redirect_stdout(io.StringIO()):  # it prints that the real library is missing
        package = pytest.importorskip("labjack.ljm", reason="labjack-ljm is not installed")
    library = ctypes.CDLL(path)
    monkeypatch.setattr(package.ljm, "_staticLib", library)
    monkeypatch.setattr("dehyst.drivers.labjack.channel.LIBRARY", path)
    unit = Unit.in_dll(library, "unit")
    handle = unit.handle
    ctypes.memset(ctypes.addressof(unit), 0, ctypes.sizeof(unit))
    unit.handle, unit.plugged, unit.kind, unit.serial = handle, 1, 7, 470012345
    unit.fail_in = -1
    return unit
