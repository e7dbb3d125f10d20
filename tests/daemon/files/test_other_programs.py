"""Files as other programs write them, made here by the very library, or as the program's own format
says: what is read, what is asked for."""

import subprocess
import sys
from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from dehyst.daemon.files.foreign.reading import Reading, parse_columns
from dehyst.daemon.files.recordings import read_recording, read_recordings, recording_of
from dehyst.models.errors import BadInput, BadRecording
from dehyst.models.recording import Recording

N, STEP_S = 400, 0.005
T = STEP_S * np.arange(N)
U = 50.0 + 40.0 * np.sin(2 * np.pi * 1.5 * T)
Y = 3.0 + 0.06 * U + 0.3 * np.sin(2 * np.pi * 1.5 * T - 0.4)
NAMES = ("Time (s)", "Voltage (V)", "Displacement (um)")


def lines(form: str = "{:.5f}", separator: str = ",", comma: bool = False, end: str = "") -> str:
    rows = [separator.join(form.format(x) for x in row) + end for row in zip(T, U, Y, strict=True)]
    text = "\n".join(rows) + "\n"
    return text.replace(".", ",") if comma else text


def is_it(found: Recording, units: tuple[str, str] = ("v", "um"), within: float = 1e-4) -> None:
    assert (found.drive_unit, found.displacement_unit) == units
    assert found.size == N
    np.testing.assert_allclose(found.t_s - found.t_s[0], T, atol=1e-5)
    np.testing.assert_allclose(found.drive, U, atol=within)
    assert found.displacement is not None
    np.testing.assert_allclose(found.displacement, Y * (1e3 if units[1] == "nm" else 1), atol=2e-3)


GERMAN = "Zeit [s];Spannung [V];Auslenkung [µm]\n" + lines(separator=";", comma=True)
LVM = (
    "LabVIEW Measurement\t\nWriter_Version\t2\nReader_Version\t2\nSeparator\tTab\n"
    "Decimal_Separator\t,\nMulti_Headings\tNo\nX_Columns\tOne\nTime_Pref\tRelative\n"
    "Operator\tlab\nDate\t2024/03/05\nTime\t12:00:00,1234\n***End_of_Header***\t\n\t\n"
    "Channels\t2\t\t\nSamples\t400\t400\t\nDate\t2024/03/05\t2024/03/05\t\n"
    "Y_Unit_Label\tVolts\tMicrometers\t\nX_Dimension\tTime\tTime\t\nX0\t0,0\t0,0\t\n"
    f"Delta_X\t{STEP_S}\t{STEP_S}\t\n***End_of_Header***\t\t\t\n"
    "X_Value\tDrive (V)\tSensor (um)\tComment\n".replace(str(STEP_S), "0,005")
) + lines(separator="\t", comma=True)
TEKTRONIX = (
    "Model,MSO4034\nFirmware Version,2.48\n\nWaveform Type,ANALOG,\nPoint Format,Y,\n"
    "Horizontal Units,s,\nHorizontal Scale,0.004,\n,\nSample Interval,0.005,\n"
    "Record Length,400,\nGating,0.0% to 100.0%,\nProbe Attenuation,1,1\nVertical Units,V,V,\n"
    "Vertical Offset,0,0\nLabel,,\nTIME,CH1,CH2\n"
) + lines("{:.6e}")
RIGOL = f"X,CH1,CH2,Start,Increment,\nSequence,VOLT,VOLT,0.0,{STEP_S:e},\n" + "".join(
    f"{i},{u:.5f},{y:.5f},\n" for i, (u, y) in enumerate(zip(U, Y, strict=True))
)
KEYSIGHT = "x-axis,1,2\nsecond,Volt,Volt\n" + lines("{:+.7E}")
BOTH = Reading({"u": "CH1", "y": "CH2"}, unit="um")

TEXTS: dict[str, tuple[bytes, Reading]] = {
    "us.csv": (f"{','.join(NAMES)}\n{lines()}".encode(), Reading()),
    "german.csv": (GERMAN.encode("cp1252"), Reading()),
    "german-utf8.csv": (b"\xef\xbb\xbf" + GERMAN.replace("\n", "\r\n").encode(), Reading()),
    "german-unicode.txt": (GERMAN.encode("utf-16"), Reading()),
    "no-mark.txt": (GERMAN.encode("utf-16-le"), Reading()),
    "tabs.tsv": (("T_s\tU_V\tY_nm\n" + "".join(
        f"{t:.5f}\t{u:.5f}\t{1e3 * y:.5f}\n" for t, u, y in zip(T, U, Y, strict=True)
    )).encode(), Reading()),
    "din.txt": (("t / s; U / V; s / µm\n" + lines(separator="; ")).encode(), Reading()),
    "quoted.csv": (
        ('"Time, s","Voltage, V","Displacement, um"\n' + lines()).encode(), Reading()),
    "units.csv": (f"time,drive,sensor\ns,V,um\n{lines()}".encode(), Reading()),
    "trailing.csv": (f"t_s,u_v,y_um,\n{lines(end=',')}".encode(), Reading()),
    "trailing2.csv": (f"t_s,u_v,y_um\n{lines(end=',,')}".encode(), Reading()),
    "cr.csv": (f"t_s,u_v,y_um\n{lines()}".replace("\n", "\r").encode(), Reading()),
    "notes.csv": (("t_s,u_v,y_um,note\n" + lines(end=",ok here")).encode(), Reading()),
    "savetxt.dat": (("# t_s u_v y_um\n" + lines("{:.18e}", " ")).encode(), Reading()),
    "percent.dat": (("% made in MATLAB\n% Time (s)  Voltage (V)  Position (um)\n"
                     + lines("{:>14.6f}", "  ")).encode(), Reading()),
    "headless.dat": (lines("{:>14.6f}", " ").encode(), Reading(
        {"t": 0, "u": 1, "y": 2}, unit="um")),
    "no-time.txt": ("\n".join(f"{u:.5f} {y:.5f}" for u, y in zip(U, Y, strict=True)).encode(),
                    Reading({"u": 0, "y": 1}, rate_hz=200.0, unit="µm")),
    "labview.lvm": (LVM.encode(), Reading()),
    "tektronix.csv": (TEKTRONIX.encode(), BOTH),
    "rigol.csv": (RIGOL.encode(), BOTH),
    "keysight.csv": (KEYSIGHT.encode(), Reading({"u": "1", "y": "2"}, unit="um")),
    "ms.csv": (("t_ms,u_mV,y_mm\n" + "".join(
        f"{1e3 * t:.5f},{1e3 * u:.5f},{1e-3 * y:.9f}\n" for t, u, y in zip(T, U, Y, strict=True)
    )).encode(), Reading()),
    "clock.csv": (("time,voltage (V),pos (um)\n" + "".join(
        f"{datetime(2024, 3, 5, 12) + timedelta(seconds=t):%Y-%m-%d %H:%M:%S.%f},{u:.5f},{y:.5f}\n"
        for t, u, y in zip(T, U, Y, strict=True)
    )).encode(), Reading()),
}  # fmt: skip


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


def h5(path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        for name, values, unit in (("time", T, "s"), ("drive", U, "V"), ("position", Y, "um")):
            file[f"run/{name}"] = values
            file[f"run/{name}"].attrs["units"] = unit
        file["gain"] = 15.0
        file.attrs["stage"] = "P-885"


def h5_table(path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    rows = np.zeros(N, [("t_s", "f8"), ("u_v", "f4"), ("y_um", "f8")])
    rows["t_s"], rows["u_v"], rows["y_um"] = T, U, Y
    with h5py.File(path, "w") as file:
        file["table"] = rows


def mat73(path: Path) -> None:
    """As MATLAB lays it out: a block of 512 bytes in front, rows as (1, N), char as uint16."""
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in (("t_s", T), ("u_v", U), ("y_um", Y)):
            file[f"data/{name}"] = values[None, :]
            file[f"data/{name}"].attrs["MATLAB_class"] = np.bytes_("double")
        file["note"] = np.array([[ord(c)] for c in "made by hand"], np.uint16)
        file["note"].attrs["MATLAB_class"] = np.bytes_("char")
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64, HDF5 schema 1.00 .".ljust(124))


def mat(path: Path) -> None:
    from scipy.io import savemat

    savemat(path, {"run": {"data": {"Time_s": T, "Drive_V": U, "Pos_um": Y}, "note": "x"}, "fs": 2})


def tdms(path: Path) -> None:
    nptdms = pytest.importorskip("nptdms")
    more = {"wf_increment": STEP_S, "wf_start_offset": 0.0}
    with nptdms.TdmsWriter(path) as file:
        file.write_segment(
            [
                nptdms.ChannelObject("run", "Voltage", U, {"unit_string": "V", **more}),
                nptdms.ChannelObject("run", "Position", Y, {"unit_string": "um", **more}),
            ]
        )


def xlsx(path: Path) -> None:
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    sheet = book.active
    sheet.append(["measured by", "somebody"])
    sheet.append([])
    sheet.append(list(NAMES))
    for row in zip(T, U, Y, strict=True):
        sheet.append([float(x) for x in row])
    book.create_sheet("empty")
    book.save(path)


def parquet(path: Path) -> None:
    pandas = pytest.importorskip("pandas")
    pytest.importorskip("pyarrow")
    pandas.DataFrame(dict(zip(NAMES, (T, U, Y), strict=True))).to_parquet(path)


def pandas_csv(path: Path) -> None:
    pandas = pytest.importorskip("pandas")
    pandas.DataFrame(dict(zip(NAMES, (T, U, Y), strict=True))).to_csv(path)


def npy(path: Path) -> None:
    np.save(path, np.stack([T, U, Y], axis=1))


def npy_fields(path: Path) -> None:
    rows = np.zeros(N, [("t_s", "f8"), ("u_v", "f8"), ("y_um", "f8")])
    rows["t_s"], rows["u_v"], rows["y_um"] = T, U, Y
    np.save(path, rows)


def npz(path: Path) -> None:
    np.savez(path, t=T, u=U, y=Y, note="x")


BY_NUMBER = Reading({"t": 0, "u": 1, "y": 2}, unit="um")
KINDS: dict[str, tuple[Callable[[Path], None], Reading]] = {
    "a.h5": (h5, Reading()),
    "table.h5": (h5_table, Reading()),
    "seven.mat": (mat73, Reading()),
    "nested.mat": (mat, Reading()),
    "a.tdms": (tdms, Reading()),
    "a.xlsx": (xlsx, Reading()),
    "a.parquet": (parquet, Reading()),
    "pandas.csv": (pandas_csv, Reading()),
    "a.npy": (npy, BY_NUMBER),
    "fields.npy": (npy_fields, Reading()),
    "a.npz": (npz, Reading(unit="um")),
}


@pytest.mark.processes
@pytest.mark.parametrize("name", KINDS)
def test_files_made_by_the_library(tmp_path: Path, name: str) -> None:
    make, reading = KINDS[name]
    make(tmp_path / name)
    is_it(read_recording(tmp_path / name, need_displacement=True, reading=reading))


ASKED = {
    "which is the drive": (("CH1 (V),CH2 (V)\n1,2\n1,3\n" * 3, "u="), Reading(rate_hz=1.0)),
    "the unit of the displacement": (("t_s,u_v,position\n0,1,2\n1,2,3\n", "--unit um"), Reading()),
    "seconds or not": (("time,u_v,y_um\n0,1,2\n5,2,3\n", "--time-unit s, ms or us"), Reading()),
    "no time": (("voltage (V),pos (um)\n1,2\n2,3\n", "--rate HZ"), Reading()),
    "two of them": (("t_s,u_v,pos a (um),pos b (um)\n0,1,2,3\n1,2,3,4\n", "y="), Reading()),
    "no headings": (("0;1;2\n1;2;3\n", "--columns t=0,u=1,y=2"), Reading()),
    "no such column": (("t_s,u_v,y_um\n0,1,2\n1,2,3\n", "no such column"), Reading({"y": "z"})),
    "two commas": (("t_s,u_v\n0,0,1,5\n0,1,2,5\n", "decimal marks and separators"), Reading()),
    "no numbers": (("a,b\nc,d\n", "no rows of numbers"), Reading()),
    "a letter": (("Time (s),U (V),Y (um)\n0,1,2\n1,2,x7\n2,2,2\n", "line 3: Y (um) is 'x7'"),
                 Reading()),
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
    """In a process where that module cannot be imported."""
    KINDS[name][0](tmp_path / name)
    program = (
        "import sys; sys.modules[sys.argv[1]] = None; import runpy\n"
        "sys.argv = ['apart', *sys.argv[2:]]\n"
        "runpy.run_module('dehyst.daemon.files.foreign.apart', run_name='__main__')"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, module, str(tmp_path / name), str(tmp_path / "o.npz")],
        capture_output=True, text=True, check=False, timeout=60,
    )  # fmt: skip
    assert done.returncode == 3, done.stderr
    assert f"pip install 'dehyst[{extra}]'" in done.stdout
