"""Files of other programs, made here by the library itself or as the program's format specifies:
what is read, and what the user is asked for."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.rigs.other_programs import KINDS, NAMES, TEXTS, N, T, U, Y, h5_foreign, lines

from dehyst.daemon.files.foreign.reading import ReadOptions, parse_columns
from dehyst.daemon.files.recordings import (
    read_columns,
    read_recording,
    read_recordings,
    recording_of,
    write_recording,
)
from dehyst.daemon.main import main
from dehyst.models.errors import BadInput, BadRecording
from dehyst.models.recording import Recording


def is_it(found: Recording, units: tuple[str, str] = ("v", "um"), within: float = 1e-4) -> None:
    assert (found.drive_unit, found.displacement_unit) == units
    assert found.size == N
    np.testing.assert_allclose(found.t_s - found.t_s[0], T, atol=1e-5)
    np.testing.assert_allclose(found.drive, U, atol=within)
    assert found.displacement is not None
    np.testing.assert_allclose(found.displacement, Y * (1e3 if units[1] == "nm" else 1), atol=2e-3)


@pytest.mark.parametrize("name", TEXTS)
def test_text_of_every_habit(tmp_path: Path, name: str) -> None:
    data, reading = TEXTS[name]
    path = tmp_path / name
    path.write_bytes(data)
    found = read_recording(path, need_displacement=True, reading=reading)
    is_it(found, ("v", "nm" if name == "tabs.tsv" else "um"))
    own = name in ("cr.csv", "trailing.csv", "trailing2.csv")
    assert (found.read == "") == own, found.read
    assert "\n" not in found.read


@pytest.mark.processes
@pytest.mark.parametrize("name", KINDS)
def test_files_made_by_the_library(tmp_path: Path, name: str) -> None:
    make, reading = KINDS[name]
    make(tmp_path / name)
    is_it(read_recording(tmp_path / name, need_displacement=True, reading=reading))


@pytest.mark.processes
def test_text_that_is_no_utf_8_is_kept_as_what_can_be_written(tmp_path: Path) -> None:
    h5_foreign(tmp_path / "a.h5")
    reading = ReadOptions({"y": "Länge"})
    found = read_recording(tmp_path / "a.h5", need_displacement=True, reading=reading)
    assert found.metadata == {"by": "Müller", "half": "\ufffdx", "lab": "Ö"}
    assert "'Länge' (µm)" in found.read
    columns = {"y_um": found.displacement, "u_v": found.drive, **found.channels}
    write_recording(tmp_path / "a.csv", found.t_s, columns, found.metadata)
    again, notes = read_columns(tmp_path / "a.csv")
    assert (list(again), notes) == (["t_s", *columns], found.metadata)


BREAKS = """
import atexit, runpy, sys, h5py
def fail(*_, **__): raise OSError('no such node:\\n  \x1b[2Jat 3\\u20ac\\udcff')
h5py.File = fail
atexit.register(print, 'closing with a warning', file=sys.stderr)
print('a word of the library', file=sys.stderr)
sys.argv[:1] = []
runpy.run_module('dehyst.daemon.files.foreign.containers.apart', run_name='__main__')
"""


STAYS = """
import runpy, sys, h5py
from dehyst.drivers import system
bound = system.bound_processor_time
def bound_tenfold(seconds): bound(seconds // 10)
def stay(*_, **__):
    while True: pass
h5py.File, system.bound_processor_time = stay, bound_tenfold
sys.argv[:1] = []
runpy.run_module('dehyst.daemon.files.foreign.containers.apart', run_name='__main__')
"""


def use_reader(monkeypatch: pytest.MonkeyPatch, program: str) -> None:
    """Replace the program that readers run."""
    pytest.importorskip("h5py")
    run = subprocess.run

    def start(command: list[str], **options: Any) -> subprocess.CompletedProcess[str]:
        return run([sys.executable, "-c", program, *command[3:]], **options)

    monkeypatch.setattr(subprocess, "run", start)


@pytest.mark.processes
def test_a_small_file_does_not_keep_a_library_busy_for_long(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "a.h5").write_bytes(b"\x89HDF")
    use_reader(monkeypatch, STAYS)
    with pytest.raises(BadRecording, match="not read within 10 s of processor time"):
        read_recording(tmp_path / "a.h5")


def test_a_name_of_several_lines_is_said_in_one(tmp_path: Path) -> None:
    """Column names with line breaks and control characters are shown as printable text, in a file
    of dehyst's own form and in one of another program."""
    path = tmp_path / "a.npz"
    own = {"t_s": T, "u_v": U, "y_um": Y, "big\nger": 1e200 * Y}
    np.savez(path, **own)
    with pytest.raises(BadRecording, match=r"big\\nger holds numbers") as refused:
        read_recording(path)
    assert str(refused.value).isprintable()
    for t_s in ("t_s", "Time (s)"):
        np.savez(path, **{t_s: T, "u_v": U, "y\n\x1b[2J": Y, "big\nger": 1e200 * Y})
        with pytest.raises(BadRecording, match=r"big\\nger holds numbers") as refused:
            read_recording(path)
        assert str(refused.value).isprintable()
        np.savez(path, **{t_s: T, "u_v": U, "y\n\x1b[2J (um)": Y})
        found = read_recording(path)
        words = (found.read, *found.channels)
        assert all(word.isprintable() for word in words), words


@pytest.mark.processes
def test_nothing_is_said_of_what_a_library_writes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a.h5").write_bytes(b"\x89HDF")
    use_reader(monkeypatch, BREAKS)
    assert main(["convert", str(tmp_path / "a.h5"), str(tmp_path / "a.csv")]) == 2
    said = capfd.readouterr()
    assert said.out == ""
    assert said.err.endswith("can be read: it is cut short or damaged\n")
    assert said.err.count("\n") == 1


ASKED = {
    "which is the drive": (("CH1 (V),CH2 (V)\n1,2\n1,3\n" * 3, "u="), ReadOptions(rate_hz=1.0)),
    "the unit of the displacement": (("t_s,u_v,position\n0,1,2\n1,2,3\n", "--unit um"),
                                     ReadOptions()),
    "seconds or not": (("time,u_v,y_um\n0,1,2\n5,2,3\n", "--time-unit s, ms or us"), ReadOptions()),
    "no time": (("voltage (V),pos (um)\n1,2\n2,3\n", "--rate HZ"), ReadOptions()),
    "two of them": (("t_s,u_v,pos a (um),pos b (um)\n0,1,2,3\n1,2,3,4\n", "y="), ReadOptions()),
    "no headings": (("0;1;2\n1;2;3\n", "--columns t=0,u=1,y=2"), ReadOptions()),
    "no such column": (("t_s,u_v,y_um\n0,1,2\n1,2,3\n", "no such column"), ReadOptions({"y": "z"})),
    "two commas": (("t_s,u_v\n0,0,1,5\n0,1,2,5\n", "decimal marks and separators"), ReadOptions()),
    "no numbers": (("a,b\nc,d\n", "no rows of numbers"), ReadOptions()),
    "a letter": (("Time (s),U (V),Y (um)\n0,1,2\n1,2,x7\n2,2,2\n", "line 3: Y (um) is 'x7'"),
                 ReadOptions()),
}  # fmt: skip


@pytest.mark.parametrize("what", ASKED)
def test_what_is_not_known_is_asked_for_by_its_option(tmp_path: Path, what: str) -> None:
    (text, says), reading = ASKED[what]
    path = tmp_path / "a.csv"
    path.write_text(text)
    with pytest.raises(BadRecording) as error:
        read_recording(path, need_displacement=True, reading=reading)
    assert says in str(error.value)
    assert "\n" not in str(error.value)


def test_a_clock_that_went_back_gives_two_recordings(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(f"t_s,u_v,y_um\n{lines()}{lines()}")
    parts = read_recordings(path, need_displacement=True)
    for one in parts:
        is_it(one)
    assert [one.name for one in parts] == ["a.csv (part 1)", "a.csv (part 2)"]
    assert parts[0].sha256 != parts[1].sha256
    assert "the clock went back at line 402: cut there into 2 parts" in parts[0].read
    with pytest.raises(BadRecording, match=r"convert a\.csv"):
        read_recording(path)


def test_arrays_with_headings_of_their_own() -> None:
    is_it(recording_of(dict(zip(NAMES, (T, U, Y), strict=True)), "here"))


@pytest.mark.parametrize(
    ("text", "means"),
    [
        ("t=0,u=Voltage,y=Displacement (um)", {"t": 0, "u": "Voltage", "y": "Displacement (um)"}),
        ('t=0, y="a, b"', {"t": 0, "y": "a, b"}),
        ("u='1'", {"u": "1"}),
    ],
)
def test_columns_by_heading_or_number(text: str, means: dict[str, object]) -> None:
    assert parse_columns(text) == means


@pytest.mark.parametrize("text", ["t", "t=", "t=1,t=2", "=3", "0=t"])
def test_columns_that_say_nothing_are_refused(text: str) -> None:
    with pytest.raises(BadInput, match="--columns"):
        parse_columns(text)


@pytest.mark.processes
@pytest.mark.parametrize(
    ("name", "module", "extra"),
    [
        ("a.h5", "h5py", "hdf5"),
        ("a.xlsx", "openpyxl", "xlsx"),
        ("a.tdms", "nptdms", "tdms"),
        ("a.parquet", "pyarrow", "parquet"),
        ("seven.mat", "h5py", "hdf5"),
    ],
)
def test_who_lacks_the_library_is_asked_to_install_the_extra(
    tmp_path: Path, name: str, module: str, extra: str
) -> None:
    """If the library for a file is not installed, the error names the extra to install. The reader
    runs in a process that cannot import the module."""
    KINDS[name][0](tmp_path / name)
    program = (
        "import sys; sys.modules[sys.argv[1]] = None; import runpy\n"
        "sys.argv = ['apart', *sys.argv[2:]]\n"
        "runpy.run_module('dehyst.daemon.files.foreign.containers.apart', run_name='__main__')"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, module, str(tmp_path / name), str(tmp_path / "o.npz")],
        capture_output=True, text=True, check=False, timeout=60,
    )  # fmt: skip
    assert done.returncode == 3, done.stderr
    assert f"pip install 'dehyst[{extra}]'" in done.stdout
