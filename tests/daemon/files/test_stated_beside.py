"""Units, factors and periods that a container states beside the numbers: they are used where dehyst
knows them, and asked for where it does not. A drive is never taken as volts against them."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.rigs.foreign_files import asked, read

from dehyst.daemon.files import loading
from dehyst.daemon.files.foreign.containers.libraries import READERS
from dehyst.models.recording import Recording

N = 200
T = np.round(0.005 * np.arange(N), 3)
U = np.round(50 + 40 * np.sin(2 * np.pi * 2.0 * T), 2)
Y = np.round(3 + 0.06 * U + 0.3 * np.cos(2 * np.pi * 2.0 * T), 3)
MV, NM, MS = 1e3 * U, 1e3 * Y, 1e3 * T

pytestmark = pytest.mark.processes  # h5py asks `uname` for the processor


@pytest.fixture(autouse=True)
def _in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Read with the libraries here: a process for each file would take a minute in all."""
    monkeypatch.setattr(loading, "read_apart", lambda path: READERS[path.suffix](path))


def is_it(found: Recording, displacement: np.ndarray = Y, unit: str = "um") -> None:
    assert found.displacement is not None
    assert (found.drive_unit, found.displacement_unit) == ("v", unit)
    np.testing.assert_allclose(found.t_s - found.t_s[0], T, atol=1e-9)
    np.testing.assert_allclose(found.drive, U, rtol=1e-9)
    np.testing.assert_allclose(found.displacement, displacement, rtol=1e-9)


def mat(path: Path, **variables: Any) -> Path:
    from scipy.io import savemat

    savemat(path, variables)
    return path


def structures(fields: tuple[str, ...], *rows: tuple[Any, ...]) -> Any:
    """Return an array of structures of MATLAB."""
    return np.array(list(rows), dtype=[(name, object) for name in fields])


def lvm(path: Path, units: str, *columns: np.ndarray) -> Path:
    """Write LabVIEW's text with times for each channel, as NI's documentation shows it."""
    head = ["LabVIEW Measurement\t", "Separator\tTab", "Decimal_Separator\t.", "X_Columns\tMulti"]
    head += ["***End_of_Header***\t", "\t", "Channels\t2\t\t\t", f"Samples\t{N}\t\t{N}\t"]
    head += [f"Y_Unit_Label\t{units}\t", "X_Dimension\tTime\t\tTime\t", "X0\t0\t\t0\t"]
    head += ["Delta_X\t0.005\t\t0.005\t", "***End_of_Header***\t\t\t\t"]
    head += ["X_Value\tPiezo Voltage\tX_Value\tPosition\tComment"]
    body = ["\t".join(f"{x:.6f}" for x in row) for row in zip(*columns, strict=True)]
    path.write_text("\n".join([*head, *body]) + "\n")
    return path


def part(values: np.ndarray, **beside: str) -> dict[str, Any]:
    return {"data": values, **beside}


def label(path: Path) -> Path:
    rows = (MV, 1.0, "Drive [mV]"), (NM, 1.0, "Position [nm]")
    signals = structures(("values", "dimensions", "label"), *rows)
    return mat(path, ScopeData={"time": T, "signals": signals})


def list_named_y(path: Path) -> Path:
    """Write what dSPACE does: all that was measured is in a list with the name Y."""
    fields = ("Data", "Name", "Unit")
    y = structures(fields, (U, "Drive", "V"), (NM, "Position", "nm"))
    return mat(path, exp={"X": structures(fields, (T, "Time", "s")), "Y": y})


KNOWN: dict[str, Callable[[Path], Path]] = {
    "LabVIEW, a unit over each column": lambda folder: lvm(
        folder / "a.lvm", "mV\t\tnm", T, MV, T, NM
    ),
    "a unit in each structure": lambda folder: mat(
        folder / "a.mat",
        rec={
            "time": part(MS, unit="ms"),
            "drive": part(MV, unit="mV"),
            "position": part(NM, units="nm"),
        },
    ),
    "a label in each structure": lambda folder: label(folder / "a.mat"),
    "a list with the name Y": lambda folder: list_named_y(folder / "a.mat"),
}


@pytest.mark.parametrize("kind", KNOWN)
def test_units_beside_the_numbers_are_those_of_the_columns(tmp_path: Path, kind: str) -> None:
    is_it(read(KNOWN[kind](tmp_path)), NM, "nm")


def iddata(folder: Path) -> Path:
    of = {"InputUnit": "mV", "OutputUnit": "nm"}
    return mat(folder / "a.mat", z={"OutputData": NM, "InputData": MV, "Ts": 0.005, **of})


def array_of_units(folder: Path) -> Path:
    np.savez(folder / "a.npz", t=T, u=MV, y=NM, units=np.array(["s", "mV", "nm"]))
    return folder / "a.npz"


def merged_heading(folder: Path) -> Path:
    book = pytest.importorskip("openpyxl").Workbook()
    sheet = book.active
    for row in [["Time (s)", "Voltage (mV)", None], [None, "Drive", "Sensor"]]:
        sheet.append(row)
    sheet.merge_cells("A1:A2")
    sheet.merge_cells("B1:C1")
    for values in zip(T, MV, NM, strict=True):
        sheet.append([float(value) for value in values])
    book.save(folder / "a.xlsx")
    return folder / "a.xlsx"


def one_channel_without(folder: Path) -> Path:
    """LabVIEW's header names a unit, but for which column it does not say."""
    return lvm(folder / "a.lvm", "mV\tmV\t\tnm\tnm", T, MV, T, NM)


ELSEWHERE: dict[str, tuple[Callable[[Path], Path], dict[str, Any], str]] = {
    "iddata": (iddata, {"rate_hz": 200.0}, "z.InputUnit mV"),
    "an array of units": (array_of_units, {}, "units s, mV, nm"),
    "a heading over two columns": (merged_heading, {"columns": "t=0"}, "Voltage (mV)"),
    "fields that fit no column": (one_channel_without, {}, "Y_Unit_Label mV mV nm nm"),
}


@pytest.mark.parametrize("kind", ELSEWHERE)
def test_millivolts_elsewhere_are_asked_for_and_not_taken_as_volts(
    tmp_path: Path, kind: str
) -> None:
    make, options, where = ELSEWHERE[kind]
    path = make(tmp_path)
    said = asked(path, **options, unit="nm")
    assert where in said.replace("  ", " ")
    assert "add --drive-unit v, mv or kv" in said
    is_it(read(path, **options, unit="nm", drive_unit="mv"), NM, "nm")


def hdf5(path: Path, **of: tuple[Any, dict[str, Any]]) -> Path:
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        for name, (values, attributes) in of.items():
            file[name] = values
            file[name].attrs.update(attributes)
    return path


LOST = np.where(np.arange(N) % 40 == 7, np.nan, Y)
COUNTED = np.round(1e3 * (Y - 2.0)).astype("i2")
PACKED: dict[str, tuple[Any, dict[str, Any], np.ndarray]] = {
    "factor": (np.round(1e3 * Y).astype("i2"), {"scale_factor": 1e-3}, Y),
    "factor and offset": (COUNTED, {"scale_factor": 1e-3, "add_offset": 2.0}, Y),
    "offset": (Y - 2.0, {"add_offset": np.array([2.0])}, Y),
    "fill value": (np.nan_to_num(LOST, nan=-9999.0), {"_FillValue": -9999.0}, LOST),
    "missing value": (np.nan_to_num(LOST, nan=1e20), {"missing_value": 1e20}, LOST),
    "packed fill value": (
        np.where(np.isnan(LOST), -32768, COUNTED).astype("i2"),
        {"scale_factor": 1e-3, "add_offset": 2.0, "_FillValue": np.int16(-32768)},
        LOST,
    ),
    "factor of 1": (Y, {"gain": 1.0, "offset": 0.0}, Y),
}


@pytest.mark.parametrize("kind", PACKED)
def test_packed_hdf5_is_unpacked(tmp_path: Path, kind: str) -> None:
    values, attributes, true = PACKED[kind]
    path = hdf5(
        tmp_path / "a.h5",
        time=(T, {"units": "s"}),
        voltage=(U, {"units": "V"}),
        position=(values, {"units": "um", **attributes}),
    )
    is_it(read(path), true)


@pytest.mark.parametrize(
    "attributes",
    [{"scaling_factor": 0.01}, {"scale": 0.01, "offset": 0.0}, {"gain": 15.0}, {"offset": 5.0}],
)
def test_a_factor_of_another_convention_is_asked_for(
    tmp_path: Path, attributes: dict[str, float]
) -> None:
    path = hdf5(
        tmp_path / "a.h5",
        time=(T, {"units": "s"}),
        voltage=(U, {"units": "V", **attributes}),
        position=(Y, {"units": "um"}),
    )
    said = asked(path)
    assert f"{next(iter(attributes.values())):g}'" in said
    assert "add --drive-unit and the unit of these numbers, which are not multiplied" in said
    is_it(read(path, drive_unit="v"))


def tdms(path: Path, step: float, along: str) -> Path:
    nptdms = pytest.importorskip("nptdms")
    more = {"wf_increment": step, "wf_start_offset": 0.0, "wf_xunit_string": along}
    with nptdms.TdmsWriter(path) as file:
        file.write_segment(
            [
                nptdms.ChannelObject("G", name, values, {**more, "unit_string": unit})
                for name, values, unit in (("Drive", U, "V"), ("Position", Y, "um"))
            ]
        )
    return path


@pytest.mark.parametrize(("step", "along"), [(0.005, ""), (0.005, "s"), (5.0, "ms"), (5e3, "us")])
def test_a_period_of_tdms_in_its_own_unit(tmp_path: Path, step: float, along: str) -> None:
    is_it(read(tdms(tmp_path / "a.tdms", step, along)))


@pytest.mark.parametrize("along", ["um", "V", "turns"])
def test_a_period_of_tdms_that_is_no_time_is_asked_for(tmp_path: Path, along: str) -> None:
    path = tdms(tmp_path / "a.tdms", 0.005, along)
    assert "add --rate HZ" in asked(path)
    is_it(read(path, rate_hz=200.0))


@pytest.mark.parametrize("kind", ["mat", "h5"])
@pytest.mark.parametrize("first", [0, 1])
def test_runs_of_several_lengths_are_asked_for(tmp_path: Path, kind: str, first: int) -> None:
    """The longer run is not taken because it is longer."""
    again = (*np.tile((T, U, Y), 2)[:, : N + 50],)
    runs = [(T, U, Y), again][:: -1 if first else 1]
    if kind == "mat":
        runs_of = [dict(zip(("t", "u", "y"), run, strict=True)) for run in runs]
        path, mark = mat(tmp_path / "a.mat", run1=runs_of[0], run2=runs_of[1]), "."
    else:
        named = {
            f"run{k}/{name}": (values, {})
            for k, run in enumerate(runs, 1)
            for name, values in zip(("t", "u", "y"), run, strict=True)
        }
        path, mark = hdf5(tmp_path / "a.h5", **named), "/"
    said = asked(path, unit="um")
    assert f"several runs, of {N} rows" in said
    names = [f'{role}="run{1 + first}{mark}{role}"' for role in "tuy"]
    assert f"such as --columns {','.join(names)}" in said
    is_it(read(path, ",".join(names), unit="um"))
