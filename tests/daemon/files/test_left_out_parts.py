"""A part of a container that cannot be a column is left out and named; the rest is read, and a
refusal names what was left out, too."""

from pathlib import Path

import numpy as np
import pytest

from dehyst.daemon.files.foreign.reading import ReadOptions
from dehyst.daemon.files.recordings import read_recording
from dehyst.models.errors import BadRecording

T = np.arange(400) * 0.005
U = np.round(50 + 40 * np.sin(3 * T), 4)
Y = np.round(0.1 * U + 1.0, 4)
SHORT = {name: np.ones(3) for name in ("kp", "ki", "kd", "lim")}
HEADINGS = ["Time (s)", "Voltage (V)", "Displacement (um)"]


def test_an_array_of_python_objects(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    for t_s in ("t_s", "Time (s)"):
        objects = np.array({"a": 1}, dtype=object)
        np.savez(path, **{t_s: T, "u_v": U, "y_um": Y}, meta=objects)
        found = read_recording(path, need_displacement=True)
        np.testing.assert_array_equal(found.drive, U)
        assert "with Python objects and left out: meta" in found.read


def test_a_damaged_array_is_not_left_out(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    np.savez(path, t_s=T, u_v=U, y_um=Y)
    path.write_bytes(path.read_bytes().replace(b"\x93NUMPY", b"\x93NUMPX", 1))
    with pytest.raises(BadRecording):
        read_recording(path)


@pytest.mark.parametrize("names", [("t", "u", "y"), ("t_s", "u_v", "y_um")])
def test_the_length_of_time_and_drive_is_kept(names: tuple[str, ...], tmp_path: Path) -> None:
    """Neither more columns of another length nor longer ones replace them, and a refusal names
    what was left out."""
    path, reading = tmp_path / "a.npz", ReadOptions(unit="um")
    spectrum = {f"spectrum{i}": np.ones(513) for i in range(4)}
    np.savez(path, **dict(zip(names, (T, U, Y), strict=True)), **SHORT, **spectrum)
    found = read_recording(path, need_displacement=True, reading=reading)
    np.testing.assert_array_equal(found.drive, U)
    assert "of another length and left out: kp" in found.read
    np.savez(path, **dict(zip(names[:2], (T, U), strict=True)), **SHORT)
    with pytest.raises(BadRecording, match="of another length and left out: kp, ki, kd, lim"):
        read_recording(path, need_displacement=True, reading=reading)


def test_a_displacement_of_another_length_is_named_with_both_lengths(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    np.savez(path, t=T, V=U, x=Y[:-1])
    n = T.size
    words = f"left out: x \\({n - 1} rows, 't' has {n}\\): if one is the drive or the displacement"
    with pytest.raises(BadRecording, match=words):
        read_recording(path, need_displacement=True)
    named = ReadOptions({"y": "x"}, unit="um")
    with pytest.raises(BadRecording, match=f"'x' of {n - 1} rows and 'V' of {n} rows"):
        read_recording(path, need_displacement=True, reading=named)


def test_without_a_role_the_longest_is_kept(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    np.savez(path, a=U, b=Y, **SHORT)
    reading = ReadOptions({"u": 0, "y": 1}, rate_hz=200.0, unit="um")
    np.testing.assert_array_equal(read_recording(path, reading=reading).drive, U)


@pytest.mark.processes
def test_a_sheet_that_is_no_table(tmp_path: Path) -> None:
    book = pytest.importorskip("openpyxl").Workbook()
    summary, data = book.active, book.create_sheet("Data")
    summary.title = "Summary"
    rows = [["Run", "Mean", "Max"], [1, 2.0, 5.0], [2, 2.0, 5.0], ["all", 2.0, 5.0]]
    for row in rows:
        summary.append(row)
    book.save(tmp_path / "only.xlsx")
    data.append(HEADINGS)
    for values in zip(T, U, Y, strict=True):
        data.append([float(v) for v in values])
    book.save(tmp_path / "a.xlsx")
    found = read_recording(tmp_path / "a.xlsx", need_displacement=True)
    np.testing.assert_allclose(found.drive, U)
    assert "from the sheet 'Data'; sheet left out: Summary: row 4: Run is 'all'" in found.read
    with pytest.raises(BadRecording, match="Summary: row 4: Run is 'all', not a number"):
        read_recording(tmp_path / "only.xlsx")
