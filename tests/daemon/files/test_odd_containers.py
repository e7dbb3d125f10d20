"""Tables and arrays as programs keep them in containers: read by what the file says, or refused in
words that say how to go on."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat
from tests.rigs.foreign_files import asked, read

from dehyst.daemon.files import loading
from dehyst.daemon.files.foreign.containers.libraries import READERS
from dehyst.models.recording import Recording

N = 200
T = np.round(0.005 * np.arange(N), 3)
U = np.round(50 + 40 * np.sin(2 * np.pi * 2.0 * T), 2)
Y = np.round(3 + 0.06 * U + 0.3 * np.cos(2 * np.pi * 2.0 * T), 3)

pytestmark = pytest.mark.processes  # h5py asks `uname` for the processor


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Read with the libraries in this process."""
    monkeypatch.setattr(loading, "read_apart", lambda path: READERS[path.suffix](path))


def is_it(found: Recording) -> None:
    assert found.displacement is not None
    np.testing.assert_allclose(found.t_s - found.t_s[0], T, atol=1e-9)
    np.testing.assert_allclose(found.drive, U, rtol=1e-9)
    np.testing.assert_allclose(found.displacement, Y, rtol=1e-9)


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize("axis", [0, 1])
def test_a_dimension_scale_is_no_list_of_names(tmp_path: Path, axis: int) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["time"] = T
        file["time"].make_scale("time")
        file["time"].attrs["units"] = "s"
        both = np.stack([U, Y], axis=1 - axis)
        file["signals"] = both
        file["signals"].dims[axis].attach_scale(file["time"])
        file["signals"].attrs["columns"] = ["drive", "displacement"]
        file["signals"].attrs["units"] = ["V", "um"]
    is_it(read(tmp_path / "a.h5"))


def pandas_table(path: Path) -> Path:
    """Write what pandas' to_hdf(format="table") does: a table, and PyTables' index of it."""
    h5py = pytest.importorskip("h5py")
    kind = [("index", "i8"), ("values_block_0", "f8", (3,))]
    table = np.zeros(N, kind)
    table["index"], table["values_block_0"] = np.arange(N), np.stack([T, U, Y], axis=1)
    with h5py.File(path, "w") as file:
        file["run/table"] = table
        names = b"(lp0\nVtime_s\np1\naVdrive_V\np2\naVposition_um\np3\na."
        file["run/table"].attrs["values_block_0_kind"] = names
        file["run/_i_table/index/sortedLR"] = np.arange(5000)
        file["run/_i_table/index/indicesLR"] = np.arange(5000, dtype="u4")
    return path


@pytest.mark.usefixtures("here")
def test_the_index_of_a_table_of_pandas_is_no_recording(tmp_path: Path) -> None:
    found = read(pandas_table(tmp_path / "a.h5"))
    is_it(found)
    assert "left out" not in found.read
    assert read(tmp_path / "a.h5", rate_hz=200.0).t_s.size == N


@pytest.mark.usefixtures("here")
def test_a_lone_longer_array_does_not_displace_the_recording(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", ch1=U, ch2=Y, spare=np.arange(5000.0))
    text = asked(tmp_path / "a.npz", rate_hz=200.0)
    assert "'ch1', 'ch2'" in text
    assert "of another length and left out: spare" in text


@pytest.mark.usefixtures("here")
def test_no_name_of_pandas_is_no_unit(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["run/axis1"] = 1709640000000000 + np.round(1e6 * T).astype("i8")
        file["run/axis1"].attrs.update({"name": b"N.", "kind": b"datetime64[us]"})
        file["run/drive_V"], file["run/position_um"] = U, Y
    is_it(read(tmp_path / "a.h5"))


def test_a_displacement_of_formulas_without_values_stops_the_reading(tmp_path: Path) -> None:
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    book.active.append(["Time (s)", "Drive (V)", "Sensor (V)", "Displacement (um)"])
    for i in range(N):
        book.active.append([T[i], U[i], Y[i] / 2, f"=C{i + 2}*2"])
    book.save(tmp_path / "a.xlsx")
    lines = [f"{t},{u},{y / 2},#VALUE!" for t, u, y in zip(T, U, Y, strict=True)]
    head = "Time (s),Drive (V),Sensor (V),Displacement (um)\n"
    (tmp_path / "a.csv").write_text(head + "\n".join(lines) + "\n")
    for name in ("a.xlsx", "a.csv"):
        text = asked(tmp_path / name)
        assert "'Displacement (um)' holds no number: if its fields are formulas" in text
        found = read(tmp_path / name, 'y="Sensor (V)"')
        np.testing.assert_allclose(found.displacement, Y / 2)


def test_a_second_gauge_without_numbers_stops_nothing(tmp_path: Path) -> None:
    lines = [f"{t},{u},{y}," for t, u, y in zip(T, U, Y, strict=True)]
    head = "Time (s),Drive (V),Position 1 (um),Position 2 (um)\n"
    (tmp_path / "a.csv").write_text(head + "\n".join(lines) + "\n")
    is_it(read(tmp_path / "a.csv"))


@pytest.mark.usefixtures("here")
def test_what_is_generated_drives_and_what_is_acquired_is_measured(tmp_path: Path) -> None:
    nptdms = pytest.importorskip("nptdms")
    wave = {"unit_string": "Volts", "wf_increment": 0.005}
    with nptdms.TdmsWriter(tmp_path / "a.tdms") as file:
        for group, values in (("Acquired", Y), ("Generated", U)):
            file.write_segment([nptdms.ChannelObject(group, "Voltage_0", values, wave)])
    is_it(read(tmp_path / "a.tdms"))


def blocks(times: Any) -> dict[str, Any]:
    shape = times.shape
    return {"time_s": times, "drive_V": U.reshape(shape), "position_um": Y.reshape(shape)}


@pytest.mark.usefixtures("here")
def test_blocks_of_samples_follow_each_other_as_their_times_do(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", **blocks(T.reshape(10, 20)))
    is_it(read(tmp_path / "a.npz"))
    savemat(tmp_path / "a.mat", {k: v.T for k, v in blocks(T.reshape(10, 20)).items()})
    is_it(read(tmp_path / "a.mat"))


@pytest.mark.usefixtures("here")
def test_blocks_in_no_order_of_time_are_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", **blocks(T.reshape(10, 20)[::-1]))
    untimed = blocks(T.reshape(10, 20))
    del untimed["time_s"]
    np.savez(tmp_path / "b.npz", **untimed)
    for name in ("a.npz", "b.npz"):
        assert "in an order that no times show, and left out" in asked(tmp_path / name)


@pytest.mark.usefixtures("here")
def test_runs_side_by_side_are_asked_for(tmp_path: Path) -> None:
    times = np.tile(T[:100, None], 2)
    u, y = np.stack([U[:100], U[50:150]], axis=1), np.stack([Y[:100], Y[50:150]], axis=1)
    np.savez(tmp_path / "a.npz", time_s=times, drive_V=u, position_um=y)
    assert "which is the drive?" in asked(tmp_path / "a.npz")


@pytest.mark.parametrize("kind", ["xlsx", "csv"])
def test_a_small_table_at_the_right_hides_no_headings(tmp_path: Path, kind: str) -> None:
    head = ["Time (s)", "Drive (V)", "Gauge (um)", None, "Results", None]
    rows: list[list[Any]] = [[T[i], U[i], Y[i], None, None, None] for i in range(N)]
    rows[0][4:], rows[1][4:] = ["max", 100.0], ["hysteresis (%)", 14.2]
    if kind == "xlsx":
        openpyxl = pytest.importorskip("openpyxl")
        book = openpyxl.Workbook()
        for row in [head, *rows]:
            book.active.append(row)
        book.save(tmp_path / "a.xlsx")
    else:
        lines = [",".join("" if c is None else str(c) for c in row) for row in [head, *rows]]
        (tmp_path / "a.csv").write_text("\n".join(lines) + "\n")
    found = read(tmp_path / f"a.{kind}")
    is_it(found)
    assert "with few numbers, at the right, and left out: column 5" in found.read


def test_a_damaged_file_is_said_to_be_cut_or_damaged(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.stack([T, U, Y]))
    (tmp_path / "a.json").write_text(json.dumps({"t": T.tolist(), "drive_V": U.tolist()}))
    savemat(tmp_path / "a.mat", {"t": T, "drive_V": U})
    for name in ("a.npy", "a.json", "a.mat"):
        data = (tmp_path / name).read_bytes()
        (tmp_path / name).write_bytes(data[: int(0.8 * len(data))])
        assert asked(tmp_path / name).endswith("can be read: it is cut short or damaged")


def test_a_workbook_behind_a_password_is_not_called_damaged(tmp_path: Path) -> None:
    (tmp_path / "a.xlsx").write_bytes(b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(600))
    assert "is protected by a password, or an Excel 97 file" in asked(tmp_path / "a.xlsx")


def test_rows_below_names_and_nested_fields_of_json(tmp_path: Path) -> None:
    table = np.stack([T, U, Y], axis=1).tolist()
    (tmp_path / "a.json").write_text(json.dumps([["t (s)", "drive (V)", "pos (um)"], *table]))
    is_it(read(tmp_path / "a.json"))
    lines = [json.dumps({"t_s": t, "fields": {"drive_V": u, "pos_um": y}}) for t, u, y in table]
    (tmp_path / "a.jsonl").write_text("\n".join(lines))
    is_it(read(tmp_path / "a.jsonl"))


def test_texts_alone_name_no_empty_list(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text(json.dumps(["a", "b"]))
    text = asked(tmp_path / "a.json")
    assert "holds no column of numbers: write times" in text
    assert "left out" not in text


@pytest.mark.usefixtures("here")
def test_units_of_a_table_of_matlab_are_those_of_its_columns(tmp_path: Path) -> None:
    beside = {
        "VariableNames": np.array(["t", "drive", "pos"], dtype=object),
        "VariableUnits": np.array(["ms", "kV", "nm"], dtype=object),
    }
    columns = {"t": 1e3 * T, "drive": U / 1e3, "pos": 1e3 * Y}
    savemat(tmp_path / "a.mat", {"T": {**columns, "Properties": beside}})
    found = read(tmp_path / "a.mat")
    np.testing.assert_allclose(found.drive, U)
    assert (found.drive_unit, found.displacement_unit) == ("v", "nm")


@pytest.mark.usefixtures("here")
def test_counts_of_an_oscilloscope_are_not_volts(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for name, values in (("drive", U), ("gauge", Y)):
            file[f"{name}/{name} Data"] = np.round(values / 0.01).astype("i2")
            file[name].attrs.update({"XInc": 0.005, "YInc": 0.01, "YOrg": 3.0})
    assert "states 'x 0.01 + 3'" in asked(tmp_path / "a.h5")


@pytest.mark.parametrize("alone", [True, False])
def test_a_type_that_the_library_does_not_read_is_no_damage(tmp_path: Path, alone: bool) -> None:
    """PyTables writes times in HDF5's own type, which has no equal in numpy."""
    h5py = pytest.importorskip("h5py")
    h5t, space = h5py.h5t, h5py.h5s.create_simple((N,))
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["drive_V"], file["position_um"] = U, Y
        kind = h5t.UNIX_D64LE
        if not alone:
            kind = h5t.create(h5t.COMPOUND, 16)
            kind.insert(b"time_s", 0, h5t.UNIX_D64LE)
            kind.insert(b"drive_V", 8, h5t.IEEE_F64LE)
        h5py.h5d.create(file.id, b"log", kind, space)
    says = asked(tmp_path / "a.h5")
    assert "damaged" not in says
    assert all(part in says for part in ("log has a type", "times", "save", "as numbers"))
