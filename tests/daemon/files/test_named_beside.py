"""Names, units and periods that a file states beside its arrays: lists of texts, labels of signals,
attributes, scalars. What is read equals what was written, in the units that were stated."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat
from tests.rigs.foreign_files import asked, read

from dehyst.daemon.files.recordings import recording_of
from dehyst.models.errors import BadRecording
from dehyst.models.recording import Recording

pytestmark = pytest.mark.processes

N = 300
T = 0.005 * np.arange(N)
U = np.round(50 + 40 * np.sin(2 * np.pi * 1.5 * T), 4)
Y = np.round(3000 + 60 * U + 300 * np.cos(2 * np.pi * 1.5 * T), 2)  # nm
MATRIX = np.stack([1e3 * T, 1e3 * U, Y], 1)
NAMES, UNITS = ["time", "drive", "position"], ["ms", "mV", "nm"]
HEADED = ["time (ms)", "drive (mV)", "position (nm)"]


def is_it(found: Recording, y: np.ndarray = Y, unit: str = "nm") -> None:
    assert found.displacement is not None
    assert (found.drive_unit, found.displacement_unit) == ("v", unit)
    np.testing.assert_allclose(found.t_s, T, atol=1e-9)
    np.testing.assert_allclose(found.drive, U, rtol=1e-9)
    np.testing.assert_allclose(found.displacement, y, rtol=1e-9)


def cells(*parts: Any) -> np.ndarray:
    """Return a cell array of MATLAB."""
    out = np.empty(len(parts), dtype=object)
    out[:] = parts
    return out


def npz(path: Path) -> None:
    np.savez(path, data=MATRIX, columns=np.array(HEADED))


def importdata(path: Path) -> None:
    savemat(path, {"S": {"data": MATRIX, "textdata": cells(*HEADED), "colheaders": cells(*HEADED)}})


def two_lists(path: Path) -> None:
    savemat(path, {"X": MATRIX.T, "names": cells(*NAMES), "units": cells(*UNITS)})


def letters(path: Path) -> None:
    savemat(path, {"X": MATRIX, "Xnames": np.array(HEADED)})


def attributes(path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        file["run/data"] = MATRIX
        file["run/data"].attrs["columns"] = NAMES
        file["run/data"].attrs["units"] = UNITS


def pandas_fixed(path: Path) -> None:
    """Lay out a table as pandas does: a list of names for each block, and one for all."""
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        file["df/axis0"] = np.array([name.encode() for name in (*HEADED, "a", "b", "c")])
        file["df/axis1"] = np.arange(N)
        file["df/block0_items"] = np.array([name.encode() for name in HEADED])
        file["df/block0_values"] = MATRIX
        file["df/block1_items"] = np.array([b"a", b"b", b"c"])
        file["df/block1_values"] = np.ones((N, 3), dtype="i8")


def split(path: Path) -> None:
    rows = MATRIX.tolist()
    path.write_text(json.dumps({"columns": HEADED, "index": list(range(N)), "data": rows}))


def labels(path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        for k, (name, unit) in enumerate(zip(NAMES, UNITS, strict=True)):
            file[f"ch{k}"] = MATRIX[:, k]
            file[f"ch{k}"].attrs.update({"long_name": name, "units": unit})


NAMED: dict[str, Callable[[Path], None]] = {
    "a.npz": npz,
    "importdata.mat": importdata,
    "lists.mat": two_lists,
    "letters.mat": letters,
    "attributes.h5": attributes,
    "pandas.h5": pandas_fixed,
    "labels.h5": labels,
    "split.json": split,
}


@pytest.mark.parametrize("name", NAMED)
def test_a_list_of_texts_names_the_columns_beside_it(tmp_path: Path, name: str) -> None:
    NAMED[name](tmp_path / name)
    is_it(read(tmp_path / name))


def test_of_two_lists_of_which_none_belongs_to_the_array_none_is_used() -> None:
    here, other = np.array(HEADED), np.array(HEADED[::-1])
    for lists in ({"first_names": here, "other_names": other}, {"plots": other}):
        with pytest.raises(BadRecording, match=r"'data\.0' rises evenly"):
            recording_of({"data": MATRIX, **lists}, "here", need_displacement=True)


def test_dimensions_name_no_columns_and_a_label_no_array_that_has_a_name(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["data"] = MATRIX[:, 1:]
        for k, name in enumerate(["position", "drive"]):
            file["data"].dims[k].label = name
        file["time_ms"] = MATRIX[:, 0]
        file["run/position_nm"] = Y
        file["run/position_nm"].attrs["long_name"] = "with the large drive"
    said = asked(tmp_path / "a.h5")
    assert "no heading names the drive" in said
    assert "'run/position_nm'" in said
    is_it(read(tmp_path / "a.h5", "u=data.0", drive_unit="mv"))


def test_the_name_of_a_signal_is_its_heading(tmp_path: Path) -> None:
    """A block diagram names signals by their path, which ends in a port."""
    y = [("Model Root/Piezo drive/Out1", U), ("Model Root/Stage position/Out1", Y)]
    signals = np.zeros(2, dtype=[("Name", object), ("Data", object)])
    for k, (name, values) in enumerate(y):
        signals[k] = name, values
    path = tmp_path / "a.mat"
    savemat(path, {"exp": {"X": {"Name": "Time", "Data": T}, "Y": signals}})
    said = asked(path)
    assert "the unit of 'exp.Y.1/Stage position' is not given" in said
    found = read(path, unit="nm")
    is_it(found)
    assert "drive from 'exp.Y.0/Piezo drive', taken as volts" in found.read


def mat73(path: Path, fill: Callable[[Any], None]) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w", userblock_size=512) as file:
        fill(file)
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64, HDF5 schema 1.00 .".ljust(124))


def stored(group: Any, name: str, values: Any, kind: str) -> Any:
    """Store an array as MATLAB does, and return its reference."""
    if kind == "char":
        values = np.array([[ord(letter)] for letter in values], np.uint16)
    group[name] = values
    group[name].attrs["MATLAB_class"] = np.bytes_(kind)
    return group[name].ref


def references(group: Any, name: str, refs: list[Any], kind: str = "") -> None:
    import h5py

    item = group.create_dataset(name, (len(refs), 1), dtype=h5py.ref_dtype)
    item[:, 0] = refs
    if kind:
        item.attrs["MATLAB_class"] = np.bytes_(kind)


def structures_73(file: Any) -> None:
    hidden = file.create_group("#refs#")
    stored(file, "exp/X/Data", 1e3 * T[None, :], "double")
    stored(file, "exp/X/Unit", "ms", "char")
    for field, values, kind in (
        ("Data", [1e3 * U[None, :], Y[None, :]], "double"),
        ("Name", ["Drive [mV]", "Position [nm]"], "char"),
    ):
        refs = [stored(hidden, f"{field}{k}", one, kind) for k, one in enumerate(values)]
        references(file, f"exp/Y/{field}", refs)


def cells_73(file: Any) -> None:
    hidden = file.create_group("#refs#")
    parts = [stored(hidden, f"v{k}", MATRIX[:, k][None, :], "double") for k in range(3)]
    references(file, "data", parts, "cell")
    texts = [stored(hidden, f"n{k}", name, "char") for k, name in enumerate(HEADED)]
    references(file, "names", texts, "cell")


@pytest.mark.parametrize("fill", [structures_73, cells_73])
def test_cells_and_arrays_of_structures_of_matlab_73(
    tmp_path: Path, fill: Callable[[Any], None]
) -> None:
    mat73(tmp_path / "a.mat", fill)
    is_it(read(tmp_path / "a.mat"))


def test_objects_of_matlab_are_named_and_no_numbers(tmp_path: Path) -> None:
    def fill(file: Any) -> None:
        for name in ("u", "y"):
            stored(file, name, np.array([[0xDD000000, 2, 1, 1, 1, 1]], np.uint32), "timeseries")
            file[name].attrs["MATLAB_object_decode"] = np.int32(3)

    mat73(tmp_path / "a.mat", fill)
    said = asked(tmp_path / "a.mat", rate_hz=200.0, unit="um")
    assert "objects that only MATLAB reads are left out: u (timeseries), y (timeseries)" in said
    assert "u = u.Data" in said


def test_arrays_in_cells_are_columns(tmp_path: Path) -> None:
    savemat(tmp_path / "a.mat", {"runs": cells(MATRIX, MATRIX[:, [0, 2, 1]])})
    columns = "t=runs.0.0,u=runs.0.1,y=runs.0.2"
    is_it(read(tmp_path / "a.mat", columns, time_unit="ms", drive_unit="mv", unit="nm"))


STATED: dict[str, tuple[str, Any]] = {
    "fs": ("fs", 200.0),
    "Ts": ("Ts", 0.005),
    "sampleRate": ("sampleRate", 200),
    "sampling_frequency_hz": ("sampling_frequency_hz", 200.0),
    "sample_rate_khz": ("sample_rate_khz", 0.2),
}


@pytest.mark.parametrize("kind", STATED)
def test_a_rate_beside_the_arrays_is_that_of_the_rows(tmp_path: Path, kind: str) -> None:
    name, value = STATED[kind]
    np.savez(tmp_path / "a.npz", drive_V=U, position_nm=Y, **{name: value})
    is_it(read(tmp_path / "a.npz"))
    savemat(tmp_path / "a.mat", {"rec": {"drive_V": U, "position_nm": Y, name: value}})
    is_it(read(tmp_path / "a.mat"))


def test_rates_in_attributes_and_properties(tmp_path: Path) -> None:
    h5py, nptdms = pytest.importorskip("h5py"), pytest.importorskip("nptdms")
    for where in ("file", "dataset"):
        with h5py.File(tmp_path / "a.h5", "w") as file:
            for name, values in (("drive_V", U), ("position_nm", Y)):
                file[name] = values
            (file if where == "file" else file["drive_V"]).attrs["sample_rate"] = 200.0
        is_it(read(tmp_path / "a.h5"))
    with nptdms.TdmsWriter(tmp_path / "a.tdms") as writer:
        root = nptdms.RootObject({"Sampling Rate": 200.0})
        drive = nptdms.ChannelObject("G", "drive_V", U, {})
        writer.write_segment([root, drive, nptdms.ChannelObject("G", "position_nm", Y, {})])
    is_it(read(tmp_path / "a.tdms"))


def test_two_rates_that_contradict_each_other_are_asked_for(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", drive_V=U, position_nm=Y, fs=200.0, sample_rate=100.0)
    assert "add --rate HZ" in asked(tmp_path / "a.npz")
    is_it(read(tmp_path / "a.npz", rate_hz=200.0))


@pytest.mark.parametrize(
    ("line", "known"),
    [
        ("# fs = 200 Hz", True),
        ("# Sampling rate: 0.2 kHz", True),
        ("# dt=5e-3", True),
        ("# Ts = 5 ms, stage 3", False),
        ("# Sampling rate: 1,000 Hz", False),
        ("# Ts = 25", False),
    ],
)
def test_a_rate_in_a_comment(tmp_path: Path, line: str, known: bool) -> None:
    body = [f"{u},{y}" for u, y in zip(U, Y, strict=True)]
    path = tmp_path / "a.csv"
    path.write_text("\n".join([line, "drive_V,position_nm", *body]) + "\n")
    if not known:
        assert "add --rate HZ" in asked(path)
    is_it(read(path) if known else read(path, rate_hz=200.0))


def test_units_in_the_metadata_of_a_table(tmp_path: Path) -> None:
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import feather, parquet

    fields = [
        pyarrow.field(name, pyarrow.float64(), metadata={"unit": unit})
        for name, unit in zip(NAMES, UNITS, strict=True)
    ]
    table = pyarrow.table(list(MATRIX.T), schema=pyarrow.schema(fields))
    parquet.write_table(table, tmp_path / "a.parquet")
    feather.write_feather(table, tmp_path / "a.feather")
    for name in ("a.parquet", "a.feather"):
        is_it(read(tmp_path / name))


ELSEWHERE = {"time": "ms", "drive": "mV", "position": "nm"}


@pytest.mark.parametrize("form", ["units.{}", "{}_unit", "{}_units"])
def test_units_by_the_names_of_the_columns(tmp_path: Path, form: str) -> None:
    h5py = pytest.importorskip("h5py")
    columns = dict(zip(NAMES, MATRIX.T, strict=True))
    units = {form.format(name): unit for name, unit in ELSEWHERE.items()}
    np.savez(tmp_path / "a.npz", **columns, **units)
    is_it(read(tmp_path / "a.npz"))
    nested = {"units": ELSEWHERE} if "." in form else units
    savemat(tmp_path / "a.mat", {"rec": {**columns, **nested}})
    is_it(read(tmp_path / "a.mat"))
    for group in ("", "run/"):
        with h5py.File(tmp_path / "a.h5", "w") as file:
            for name, values in columns.items():
                file[group + name] = values
            file[group or "/"].attrs.update(units)
        is_it(read(tmp_path / "a.h5"))


def test_millivolts_named_in_a_remark_are_used(tmp_path: Path) -> None:
    """In an attribute of an array, in a property of a channel, in the metadata of a table."""
    h5py, nptdms = pytest.importorskip("h5py"), pytest.importorskip("nptdms")
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    small = 10 * U
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for name, values in (("time", T), ("drive", small), ("position_nm", Y)):
            file[name] = values
        file["drive"].attrs["comment"] = "input of the amplifier in mV"
    more = {"description": "input of the amplifier, mV", "wf_increment": 0.005}
    with nptdms.TdmsWriter(tmp_path / "a.tdms") as writer:
        position = nptdms.ChannelObject("G", "position_nm", Y, {"wf_increment": 0.005})
        writer.write_segment([nptdms.ChannelObject("G", "drive", small, more), position])
    table = pyarrow.table({"time": T, "drive": small, "position_nm": Y})
    parquet.write_table(
        table.replace_schema_metadata({"note": "drive: mV"}), tmp_path / "a.parquet"
    )
    for name in ("a.h5", "a.tdms", "a.parquet"):
        assert "add --drive-unit v, mv or kv" in asked(tmp_path / name)
        np.testing.assert_allclose(read(tmp_path / name, drive_unit="mv").drive, small / 1e3)


def test_lists_in_the_cells_of_a_table_are_columns(tmp_path: Path) -> None:
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    columns = {name: [values.tolist()] for name, values in zip(HEADED, MATRIX.T, strict=True)}
    parquet.write_table(pyarrow.table(columns), tmp_path / "a.parquet")
    is_it(read(tmp_path / "a.parquet"))


def test_times_in_texts(tmp_path: Path) -> None:
    stamps = [f"2024-03-05T12:00:{t:06.3f}" for t in T]
    rows = [dict(zip(("time", *HEADED[1:]), row, strict=True)) for row in
            zip(stamps, *MATRIX.T[1:].tolist(), strict=True)]  # fmt: skip
    (tmp_path / "a.json").write_text(json.dumps(rows))
    found = read(tmp_path / "a.json")
    np.testing.assert_allclose(found.t_s - found.t_s[0], T, atol=1e-6)
    np.testing.assert_allclose(found.drive, U, rtol=1e-9)


def test_all_lines_of_a_preamble_are_kept(tmp_path: Path) -> None:
    """A unit in the second of two lines that begin alike is not lost."""
    head = ["# - t is given in s", "# - drive is given in mV", "# - position"]
    body = [f"{t:.3f} {1e3 * u} {y}" for t, u, y in zip(T, U, Y, strict=True)]
    path = tmp_path / "a.txt"
    path.write_text("\n".join([*head, "t drive position", *body]) + "\n")
    assert "add --drive-unit v, mv or kv" in asked(path, unit="nm")
    is_it(read(path, unit="nm", drive_unit="mv"))
