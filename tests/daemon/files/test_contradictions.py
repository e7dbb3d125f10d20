"""What an option says against the file, and what a file says twice: both values are named, with the
one that is used; where nothing shows which is right, it is asked for."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat
from tests.rigs.foreign_files import asked, read

pytestmark = pytest.mark.processes
N = 300
T = np.round(0.005 * np.arange(N), 3)
U = np.round(50 + 40 * np.sin(2 * np.pi * 1.5 * T), 4)
Y = np.round(3 + 0.06 * U + 0.3 * np.cos(2 * np.pi * 1.5 * T), 5)


def table(path: Path, head: str, *columns: Any, above: str = "") -> Path:
    rows = [",".join(map(str, row)) for row in zip(*columns, strict=True)]
    path.write_text("\n".join([above + head, *rows]) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize("stated", ["ms", "min", "s"])
@pytest.mark.parametrize("given", ["ms", "s", "us"])
def test_a_time_unit_against_the_heading_is_used_and_said(
    tmp_path: Path, stated: str, given: str
) -> None:
    path = table(tmp_path / "a.csv", f"Time ({stated}),U (V),Y (um)", T, U, Y)
    found = read(path, time_unit=given)
    factor = {"s": 1.0, "ms": 1e-3, "us": 1e-6}[given]
    np.testing.assert_allclose(found.t_s, factor * T, rtol=1e-12)
    said = f"--time-unit {given} is used for 'Time ({stated})', whose heading says {stated}"
    assert (said in found.read) == (given != stated)


def with_a_line(path: Path, rate: float) -> Path:
    return table(path, "U (V),Y (um)", U, Y, above=f"# fs = {rate:g}\n")


def with_an_array(path: Path, rate: float) -> Path:
    np.savez(path.with_suffix(".npz"), fs=rate, drive_v=U, position_um=Y)
    return path.with_suffix(".npz")


def with_times(path: Path, rate: float) -> Path:
    return table(path, "Time (ms),U (V),Y (um)", 1e3 / rate * np.arange(N), U, Y)


@pytest.mark.parametrize("make", [with_a_line, with_an_array, with_times])
def test_a_rate_against_the_file_is_used_and_said(tmp_path: Path, make: Any) -> None:
    for stated, given in ((1000.0, 200.0), (200.0, 200.0), (201.0, 200.0)):
        found = read(make(tmp_path / "a.csv", stated), rate_hz=given)
        np.testing.assert_allclose(found.t_s, T, atol=1e-12)
        said = f"{stated:g} Hz, --rate {given:g} Hz, which is used"
        assert (said in found.read) == (stated == 1000.0)


def npz(path: Path, **arrays: Any) -> Path:
    np.savez(path.with_suffix(".npz"), **arrays)
    return path.with_suffix(".npz")


def mat(path: Path, **arrays: Any) -> Path:
    savemat(path.with_suffix(".mat"), {"rec": arrays})
    return path.with_suffix(".mat")


def h5(path: Path, **arrays: Any) -> Path:
    h5py = pytest.importorskip("h5py")
    with h5py.File(path.with_suffix(".h5"), "w") as file:
        for name, values in arrays.items():
            if np.ndim(values):
                file[name] = values
            else:
                file.attrs[name] = values
    return path.with_suffix(".h5")


@pytest.mark.parametrize("write", [npz, mat, h5])
@pytest.mark.parametrize(
    ("name", "value", "hertz"),
    [("fs", 1000.0, "1000"), ("Fs", 0.2, "0.2"), ("dt", 0.001, "1000"), ("sample_rate", 50, "50")],
)
def test_a_rate_next_to_times_of_another_is_said(
    tmp_path: Path, write: Any, name: str, value: float, hertz: str
) -> None:
    found = read(write(tmp_path / "a", **{name: value}, t_s=T, u_v=U, y_um=Y))
    np.testing.assert_allclose(found.t_s, T, atol=1e-12)
    assert f"the file states {hertz} Hz, its times 200 Hz: the times are used" in found.read
    agrees = {"dt": 0.005, "sample_rate": 200}.get(name, 200.0)
    found = read(write(tmp_path / "b", **{name: agrees}, t_s=T, u_v=U, y_um=Y))
    assert "Hz" not in found.read


@pytest.mark.parametrize("write", [npz, mat])
def test_times_without_a_unit_are_asked_for_against_a_rate(tmp_path: Path, write: Any) -> None:
    path = write(tmp_path / "a", fs=200e3, t=T, drive_v=U, position_um=Y)
    said = asked(path)
    assert "the file states 200000 Hz, the times without a unit, taken as seconds, 200 Hz" in said
    assert "add --time-unit s, ms or us" in said
    np.testing.assert_allclose(read(path, time_unit="ms").t_s, T / 1e3, rtol=1e-12)
    assert "200000 Hz, its times 200 Hz" in read(path, time_unit="s").read


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("rate", 400.0, "rate = 400, perhaps 400 Hz, its times 200 Hz"),
        ("dt", 0.05, "dt = 0.05, perhaps 20 Hz, its times 200 Hz"),
        ("rate", 0.2, ""),  # kHz
        ("dt", 5.0, ""),  # ms
        ("freq", 1.5, ""),  # of the drive
    ],
)
def test_a_number_that_may_be_a_rate_is_said_against_times(
    tmp_path: Path, name: str, value: float, said: str
) -> None:
    found = read(npz(tmp_path / "a", **{name: value}, t_s=T, u_v=U, y_um=Y))
    assert (said in found.read) if said else ("Hz" not in found.read)


def test_the_rate_of_another_group_contradicts_nothing(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for name, values in (("t_s", T), ("u_v", U), ("y_um", Y)):
            file[f"fast/{name}"] = values
        file["slow/temp_c"] = Y[:15]
        file["slow"].attrs["sample_rate"] = 10.0
    assert "Hz" not in read(tmp_path / "a.h5").read
    with h5py.File(tmp_path / "a.h5", "a") as file:
        file["fast"].attrs["sample_rate"] = 500.0
    assert "the file states 500 Hz, its times 200 Hz" in read(tmp_path / "a.h5").read


def test_rounded_times_pauses_and_decimation_contradict_nothing(tmp_path: Path) -> None:
    rounded = np.floor(100 * T + 1e-6) / 100
    paused = T + 3.0 * (np.arange(N) >= 150)
    found = read(npz(tmp_path / "a", fs=200.0, t_s=paused, u_v=U, y_um=Y))
    assert "Hz" not in found.read
    path = table(tmp_path / "a.csv", "Time (s),U (V),Y (um)", rounded, U, Y, above="# fs = 200\n")
    assert "Hz" not in read(path).read
    head = "# fs = 1000 Hz\n# decimation = 5\n"
    assert (
        "states"
        not in read(table(tmp_path / "b.csv", "Time (s),U (V),Y (um)", T, U, Y, above=head)).read
    )


@pytest.mark.parametrize("sheets", [1, 2])
def test_a_gain_above_the_numbers_of_a_spreadsheet_is_asked_for(
    tmp_path: Path, sheets: int
) -> None:
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    rows = list(zip(T.tolist(), U.tolist(), Y.tolist(), strict=True))
    head = [["Amplifier gain", 15], ["Time (s)", "U (V)", "Y (um)"]]
    for row in (*head, *rows, ("Mean", 50.0, 6.0)):
        book.active.append(list(row))
    if sheets > 1:
        other = book.create_sheet("Calibration")
        for row in (["Load (N)", "Reading"], [0.0, 1.5], [1.0, 2.5], [2.0, 3.5]):
            other.append(row)
    book.save(tmp_path / "a.xlsx")
    assert "states 'Amplifier gain 15', which is not applied" in asked(tmp_path / "a.xlsx")
    found = read(tmp_path / "a.xlsx", drive_unit="v", unit="um")
    np.testing.assert_array_equal(found.drive, U)
    assert (
        "of sums or means below the numbers left out, the first ('Mean') in row 303" in found.read
    )
