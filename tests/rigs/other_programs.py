"""Files in the formats of other programs: text as each of them writes it, and binary formats
written by the library itself if it is installed."""

from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from tests.rigs.outside import plays

from dehyst.daemon.files.foreign.reading import ReadOptions

N, STEP_S = 400, 0.005
T = STEP_S * np.arange(N)
U = 50.0 + 40.0 * np.sin(2 * np.pi * 1.5 * T)
Y = 3.0 + plays(U, np.array([0.0, 5.0, 15.0, 30.0]), np.array([0.05, 0.008, 0.006, 0.003]))
NAMES = ("Time (s)", "Voltage (V)", "Displacement (um)")


def lines(form: str = "{:.5f}", separator: str = ",", comma: bool = False, end: str = "") -> str:
    rows = [separator.join(form.format(x) for x in row) + end for row in zip(T, U, Y, strict=True)]
    text = "\n".join(rows) + "\n"
    return text.replace(".", ",") if comma else text


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
BOTH = ReadOptions({"u": "CH1", "y": "CH2"}, unit="um")

TEXTS: dict[str, tuple[bytes, ReadOptions]] = {
    "us.csv": (f"{','.join(NAMES)}\n{lines()}".encode(), ReadOptions()),
    "german.csv": (GERMAN.encode("cp1252"), ReadOptions()),
    "german-utf8.csv": (b"\xef\xbb\xbf" + GERMAN.replace("\n", "\r\n").encode(), ReadOptions()),
    "german-unicode.txt": (GERMAN.encode("utf-16"), ReadOptions()),
    "no-mark.txt": (GERMAN.encode("utf-16-le"), ReadOptions()),
    "tabs.tsv": (("T_s\tU_V\tY_nm\n" + "".join(
        f"{t:.5f}\t{u:.5f}\t{1e3 * y:.5f}\n" for t, u, y in zip(T, U, Y, strict=True)
    )).encode(), ReadOptions()),
    "din.txt": (("t / s; U / V; s / µm\n" + lines(separator="; ")).encode(), ReadOptions()),
    "quoted.csv": (
        ('"Time, s","Voltage, V","Displacement, um"\n' + lines()).encode(), ReadOptions()),
    "units.csv": (f"time,drive,sensor\ns,V,um\n{lines()}".encode(), ReadOptions()),
    "trailing.csv": (f"t_s,u_v,y_um,\n{lines(end=',')}".encode(), ReadOptions()),
    "trailing2.csv": (f"t_s,u_v,y_um\n{lines(end=',,')}".encode(), ReadOptions()),
    "cr.csv": (f"t_s,u_v,y_um\n{lines()}".replace("\n", "\r").encode(), ReadOptions()),
    "notes.csv": (("t_s,u_v,y_um,note\n" + lines(end=",ok here")).encode(), ReadOptions()),
    "savetxt.dat": (("# t_s u_v y_um\n" + lines("{:.18e}", " ")).encode(), ReadOptions()),
    "percent.dat": (("% made in MATLAB\n% Time (s)  Voltage (V)  Position (um)\n"
                     + lines("{:>14.6f}", "  ")).encode(), ReadOptions()),
    "headless.dat": (lines("{:>14.6f}", " ").encode(), ReadOptions(
        {"t": 0, "u": 1, "y": 2}, unit="um")),
    "no-time.txt": ("\n".join(f"{u:.5f} {y:.5f}" for u, y in zip(U, Y, strict=True)).encode(),
                    ReadOptions({"u": 0, "y": 1}, rate_hz=200.0, unit="µm")),
    "labview.lvm": (LVM.encode(), ReadOptions()),
    "tektronix.csv": (TEKTRONIX.encode(), BOTH),
    "rigol.csv": (RIGOL.encode(), BOTH),
    "keysight.csv": (KEYSIGHT.encode(), ReadOptions({"u": "1", "y": "2"}, unit="um")),
    "ms.csv": (("t_ms,u_mV,y_mm\n" + "".join(
        f"{1e3 * t:.5f},{1e3 * u:.5f},{1e-3 * y:.9f}\n" for t, u, y in zip(T, U, Y, strict=True)
    )).encode(), ReadOptions()),
    "clock.csv": (("time,voltage (V),pos (um)\n" + "".join(
        f"{datetime(2024, 3, 5, 12) + timedelta(seconds=t):%Y-%m-%d %H:%M:%S.%f},{u:.5f},{y:.5f}\n"
        for t, u, y in zip(T, U, Y, strict=True)
    )).encode(), ReadOptions()),
}  # fmt: skip


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


def h5_foreign(path: Path) -> None:
    """Write names, units and texts in Latin-1 and in halves of UTF-16, and a slot with no value."""
    h5py = pytest.importorskip("h5py")
    latin = h5py.string_dtype("utf-8")
    with h5py.File(path, "w") as file:
        for name, values, unit in (
            (b"Zeit", T, b"s"),
            (b"u_v", U, b"V"),
            (b"L\xe4nge", Y, b"\xb5m"),
        ):
            file[name] = values
            file[name].attrs["units"] = np.bytes_(unit)
        file[b"\xd6l"] = U
        file["by"] = np.array("M\xfcller".encode("latin-1"), dtype=latin)
        file["half"] = np.array([[0xD800], [0x78]], np.uint16)
        file["half"].attrs["MATLAB_class"] = np.bytes_("char")
        file["nothing"] = h5py.Empty("f8")
        file.attrs.create("lab", b"\xd6", dtype=latin)


def mat73(path: Path) -> None:
    """Write as MATLAB lays it out: a leading block of 512 bytes, rows as (1, N), char as uint16."""
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


BY_NUMBER = ReadOptions({"t": 0, "u": 1, "y": 2}, unit="um")
KINDS: dict[str, tuple[Callable[[Path], None], ReadOptions]] = {
    "a.h5": (h5, ReadOptions()),
    "foreign.h5": (h5_foreign, ReadOptions()),
    "table.h5": (h5_table, ReadOptions()),
    "seven.mat": (mat73, ReadOptions()),
    "nested.mat": (mat, ReadOptions()),
    "a.tdms": (tdms, ReadOptions()),
    "a.xlsx": (xlsx, ReadOptions()),
    "a.parquet": (parquet, ReadOptions()),
    "pandas.csv": (pandas_csv, ReadOptions()),
    "a.npy": (npy, BY_NUMBER),
    "fields.npy": (npy_fields, ReadOptions()),
    "a.npz": (npz, ReadOptions(unit="um")),
}
