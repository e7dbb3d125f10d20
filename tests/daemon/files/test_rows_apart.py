"""Drive and displacement that begin at different times, or have different periods, are never joined
row by row."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.rigs.foreign_files import asked, read

from dehyst.daemon.files import loading
from dehyst.daemon.files.foreign.containers.libraries import READERS
from dehyst.models.recording import Recording

N, LATE = 200, 40
STEP = 0.005
T = np.round(STEP * np.arange(N), 3)
U = np.round(50 + 40 * np.sin(2 * np.pi * 2.0 * T), 2)
Y = np.round(3 + 0.06 * U + 0.3 * np.cos(2 * np.pi * 2.0 * T), 3)

pytestmark = pytest.mark.processes  # h5py asks `uname` for the processor


@pytest.fixture(autouse=True)
def _in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loading, "read_apart", lambda path: READERS[path.suffix](path))


def is_aligned(found: Recording) -> None:
    """Check that each row holds what was measured at one time: the gauge began 40 rows late."""
    assert found.displacement is not None
    np.testing.assert_allclose(found.drive, U[LATE:], rtol=1e-9)
    np.testing.assert_allclose(found.displacement, Y[:-LATE], rtol=1e-9)
    np.testing.assert_allclose(found.t_s - found.t_s[0], T[:-LATE], atol=1e-9)
    assert "begins at 0 s" in found.read
    assert "at 0.2 s" in found.read


def tdms(path: Path, late: dict[str, Any], step: float = STEP) -> Path:
    nptdms = pytest.importorskip("nptdms")
    moment = np.datetime64("2024-03-05T12:00:00")
    wave = {"wf_increment": STEP, "wf_start_offset": 0.0, "wf_start_time": moment}
    gauge = {**wave, "wf_increment": step, **late}
    with nptdms.TdmsWriter(path.with_suffix(".tdms")) as file:
        file.write_segment(
            [
                nptdms.ChannelObject("g", "Drive", U, {"unit_string": "V", **wave}),
                nptdms.ChannelObject("g", "Gauge", Y, {"unit_string": "um", **gauge}),
                nptdms.ChannelObject("g", "Room", U, {"unit_string": "degC", **gauge}),
            ]
        )
    return path.with_suffix(".tdms")


def start_time(path: Path, late: float = LATE * STEP, step: float = STEP) -> Path:
    moment = np.datetime64("2024-03-05T12:00:00") + np.timedelta64(round(1e6 * late), "us")
    return tdms(path, {"wf_start_time": moment}, step)


def start_offset(path: Path, late: float = LATE * STEP, step: float = STEP) -> Path:
    return tdms(path, {"wf_start_offset": late}, step)


def attributes(path: Path, late: float = LATE * STEP, step: float = STEP) -> Path:
    h5py = pytest.importorskip("h5py")
    with h5py.File(path.with_suffix(".h5"), "w") as file:
        for name, values, unit, begin, dt in (
            ("drive", U, "V", 0.0, STEP),
            ("gauge", Y, "um", late, step),
        ):
            file[name] = values
            file[name].attrs.update({"unit": unit, "dt": dt, "t0": begin})
    return path.with_suffix(".h5")


def lvm(path: Path, late: float = LATE * STEP, step: float = STEP) -> Path:
    head = ["LabVIEW Measurement", "Separator\tTab", "X_Columns\tNo", "***End_of_Header***", ""]
    head += ["Channels\t2", f"Samples\t{N}\t{N}", "X_Dimension\tTime\tTime", f"X0\t0\t{late}"]
    head += [f"Delta_X\t{STEP}\t{step}", "***End_of_Header***"]
    head += ["X_Value\tDrive (V)\tGauge (um)\tComment"]
    body = [f"\t{u}\t{y}" for u, y in zip(U, Y, strict=True)]
    path.with_suffix(".lvm").write_text("\n".join([*head, *body]) + "\n")
    return path.with_suffix(".lvm")


def sheets(path: Path, late: float = LATE * STEP, step: float = STEP) -> Path:
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    one, other = book.active, book.create_sheet("Displacement")
    one.title = "Drive"
    one.append(["Time (s)", "Drive (V)"])
    other.append(["Time (s)", "Displacement (um)"])
    for i in range(N):
        one.append([STEP * i, U[i]])
        other.append([late + step * i, Y[i]])
    book.save(path.with_suffix(".xlsx"))
    return path.with_suffix(".xlsx")


KINDS: tuple[Callable[..., Path], ...] = (start_time, start_offset, attributes, lvm, sheets)


@pytest.mark.parametrize("write", KINDS)
def test_what_begins_later_by_whole_rows_is_put_at_its_own_time(
    tmp_path: Path, write: Callable[..., Path]
) -> None:
    path = write(tmp_path / "a")
    is_aligned(read(path))
    is_aligned(read(path, rate_hz=1.0 / STEP))


@pytest.mark.parametrize("write", KINDS)
def test_what_begins_between_two_rows_is_refused_with_both_starts(
    tmp_path: Path, write: Callable[..., Path]
) -> None:
    path = write(tmp_path / "a", late=0.2025)
    for options in ({}, {"rate_hz": 200.0}):
        text = asked(path, **options)
        assert "begins at 0 s" in text
        assert "at 0.2025 s, no whole number of rows apart" in text


@pytest.mark.parametrize("write", KINDS)
def test_different_periods_are_refused_with_both(
    tmp_path: Path, write: Callable[..., Path]
) -> None:
    path = write(tmp_path / "a", late=0.0, step=2 * STEP)
    for options in ({}, {"rate_hz": 200.0}):
        text = asked(path, **options)
        assert "a row every 0.005 s" in text
        assert "every 0.01 s: bring them" in text


def test_beginnings_without_a_period_need_the_rate(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(attributes(tmp_path / "a"), "a") as file:
        for name in ("drive", "gauge"):
            del file[name].attrs["dt"]
    assert "at 0.2 s, and no period is stated: add --rate HZ" in asked(tmp_path / "a.h5")
    is_aligned(read(tmp_path / "a.h5", rate_hz=200.0))


def test_what_has_no_time_in_common_is_refused(tmp_path: Path) -> None:
    assert "have no times in common" in asked(attributes(tmp_path / "a", late=10.0))


def test_the_same_times_on_two_sheets_are_joined(tmp_path: Path) -> None:
    found = read(sheets(tmp_path / "a", late=0.0))
    np.testing.assert_allclose(found.drive, U)
    assert "begins at" not in found.read


def test_uneven_times_of_their_own_are_refused(tmp_path: Path) -> None:
    openpyxl = pytest.importorskip("openpyxl")
    path = sheets(tmp_path / "a")
    book = openpyxl.load_workbook(path)
    book["Displacement"]["A9"] = 0.239
    book.save(path)
    named = 't="Drive/Time (s)",u="Drive/Drive (V)",y="Displacement/Displacement (um)"'
    for columns in ("", named):
        assert "uneven ones: bring them to one column of times first" in asked(path, columns)


def test_another_channel_goes_with_its_own_time(tmp_path: Path) -> None:
    found = read(start_time(tmp_path / "a"))
    np.testing.assert_allclose(found.channels["room_c"], U[:-LATE])


@pytest.mark.parametrize("step", [STEP, 1.0])
def test_a_period_that_labview_writes_where_none_is_set_is_doubted(
    tmp_path: Path, step: float
) -> None:
    nptdms = pytest.importorskip("nptdms")
    with nptdms.TdmsWriter(tmp_path / "a.tdms") as file:
        of = (("Drive", U, "V"), ("Gauge", Y, "um"))
        file.write_segment(
            [
                nptdms.ChannelObject("g", name, values, {"unit_string": unit, "wf_increment": step})
                for name, values, unit in of
            ]
        )
    doubt = "a waveform's period of 1 s is also what LabVIEW writes where none was set: add --rate"
    assert (doubt in read(tmp_path / "a.tdms").read) == (step == 1.0)
    assert doubt not in read(tmp_path / "a.tdms", rate_hz=200.0).read


def test_the_other_runs_of_a_file_are_left_out(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for run in ("run1", "run2"):
            for name, values in (("t_s", T), ("u_v", U), ("y_um", Y)):
                file[f"{run}/{name}"] = values
        file["room/temp_c"] = U
    found = read(tmp_path / "a.h5", "t=run1/t_s,u=run1/u_v,y=run1/y_um")
    assert list(found.channels) == ["temp_c"]
    assert "of other runs and left out: run2" in found.read
