"""What containers state beside the arrays: factors, units, periods, calibration tables, and the
names of channels that stand in rows."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import netcdf_file, savemat
from tests.rigs.foreign_files import asked, read

from dehyst.daemon.files.foreign.containers.arrays import FEWEST_ROWS
from dehyst.models.identify.tuning import TUNING
from dehyst.models.recording import Recording

pytestmark = pytest.mark.processes
N = 400
T = np.round(0.005 * np.arange(N), 3)
U = np.round(50 + 40 * np.sin(2 * np.pi * 1.5 * T), 3)
Y = np.round(3 + 0.06 * U + 0.3 * np.cos(2 * np.pi * 1.5 * T), 4)
TIMED = {"time_s": T, "drive_v": U, "pos_um": Y}


def is_it(found: Recording) -> None:
    assert found.displacement is not None
    assert (found.drive_unit, found.displacement_unit) == ("v", "um")
    np.testing.assert_allclose(found.t_s - found.t_s[0], T, atol=1e-9)
    np.testing.assert_allclose(found.drive, U, rtol=1e-6)
    np.testing.assert_allclose(found.displacement, Y, rtol=1e-6)


def with_attributes(path: Path, of_position: dict[str, Any], values: Any = Y) -> Path:
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        units = zip((*TIMED,), (T, U, values), ("s", "V", "um"), strict=True)
        for name, data, unit in units:
            file[name.split("_")[0]] = data
            file[name.split("_")[0]].attrs["units"] = unit
        for key, value in of_position.items():
            file["pos"].attrs[key] = value
    return path


@pytest.mark.parametrize("factor", ["0.001", b"0.001", 0.001])
def test_a_factor_of_the_conventions_counts_as_a_text_too(tmp_path: Path, factor: Any) -> None:
    is_it(read(with_attributes(tmp_path / "a.h5", {"scale_factor": factor}, 1e3 * Y)))


@pytest.mark.parametrize("text", ["0.001 um/count", "x 0.001"])
@pytest.mark.parametrize("name", ["scale_factor", "gain"])
def test_a_factor_with_words_is_asked_about(tmp_path: Path, name: str, text: str) -> None:
    assert "um x 0.001" in asked(with_attributes(tmp_path / "a.h5", {name: text}, 1e3 * Y))


@pytest.mark.parametrize("unsigned", ["true", None])
def test_unsigned_numbers_of_netcdf(tmp_path: Path, unsigned: str | None) -> None:
    """Its version 3 has no unsigned numbers: they are written as signed ones, and marked."""
    path = tmp_path / "a.nc"
    counts = np.round(U / 0.002).astype(np.uint16)
    with netcdf_file(path, "w") as file:
        file.createDimension("n", N)
        for name, values, kind in (
            ("time", T, "d"),
            ("drive", counts.view("i2"), "h"),
            ("pos", Y, "d"),
        ):
            file.createVariable(name, kind, ("n",))[:] = values
            file.variables[name].units = {"time": "s", "drive": "V", "pos": "um"}[name]
        file.variables["drive"].scale_factor = 0.002
        if unsigned:
            file.variables["drive"]._Unsigned = unsigned
    if unsigned:
        found = read(path)
        np.testing.assert_allclose(found.drive, U, atol=1.1e-3)
    else:
        assert np.min(read(path).drive) < 0.0


@pytest.mark.parametrize(
    "name",
    [
        "pos_scale",
        "pos_gain",
        "pos_um_per_count",
        "drive_factor",
        "gain",
        "amplifier_gain",
        "scale",
    ],
)
def test_a_factor_next_to_arrays_is_asked_about(tmp_path: Path, name: str) -> None:
    savemat(tmp_path / "a.mat", {**TIMED, name: 20.0})
    assert ("x 20" if "_" in name[:6] else "20") in asked(tmp_path / "a.mat")
    (tmp_path / "a.json").write_text(
        json.dumps({k: v.tolist() for k, v in TIMED.items()} | {name: 20.0})
    )
    assert "20" in asked(tmp_path / "a.json")
    savemat(tmp_path / "b.mat", {**TIMED, name: 1.0})
    is_it(read(tmp_path / "b.mat"))


def test_a_number_that_is_no_factor_of_a_signal_is_not_asked_about(tmp_path: Path) -> None:
    savemat(tmp_path / "a.mat", {**TIMED, "pid_gain": 20.0, "cycles": 3.0})
    is_it(read(tmp_path / "a.mat"))


def test_a_recording_has_as_many_rows_as_identification_needs() -> None:
    assert TUNING.fewest_rows == FEWEST_ROWS


def test_a_short_calibration_is_not_the_recording(tmp_path: Path) -> None:
    table = {"voltage": np.linspace(0, 100, 11), "displacement_um": np.linspace(0, 7, 11)}
    savemat(tmp_path / "a.mat", {"cal": table, "data": {"ch1": U, "ch2": Y}, "fs": 200.0})
    said = asked(tmp_path / "a.mat")
    assert "have only 11 rows, other columns 400" in said
    assert 'u="data.ch1",y="data.ch2"' in said
    savemat(tmp_path / "b.mat", {"cal": table, "data": TIMED})
    assert '--columns t="data.time_s",u="data.drive_v",y="data.pos_um"' in asked(tmp_path / "b.mat")


def test_units_in_a_structure_of_their_own(tmp_path: Path) -> None:
    units = {"time": "ms", "voltage": "V", "displacement": "nm"}
    data = {"time": 1e3 * T, "voltage": U, "displacement": 1e3 * Y}
    savemat(tmp_path / "a.mat", {"data": data, "units": units})
    found = read(tmp_path / "a.mat")
    assert (found.drive_unit, found.displacement_unit) == ("v", "nm")
    np.testing.assert_allclose(found.t_s, T, atol=1e-9)


@pytest.mark.parametrize(
    ("data", "unit"), [("OutputData", "OutputUnit"), ("y", "yUnit"), ("y_values", "yUnits")]
)
def test_the_unit_of_a_signal_next_to_its_numbers(tmp_path: Path, data: str, unit: str) -> None:
    """System Identification's structure, and others of its kind."""
    drive, of_drive = (name.replace("Out", "In").replace("y", "u") for name in (data, unit))
    iddata = {data: Y[:, None], drive: U[:, None], unit: "um", of_drive: "V", "Ts": 0.005}
    savemat(tmp_path / "a.mat", {"data": iddata})
    is_it(read(tmp_path / "a.mat"))


def test_the_units_of_an_oscilloscopes_structures_are_those_of_y(tmp_path: Path) -> None:
    each = {"XInc": 0.005, "XUnits": "Second"}
    channels = {
        "Channel_1": {"Data": U, "YUnits": "Volt", "Name": "drive", **each},
        "Channel_2": {"Data": Y, "YUnits": "um", "Name": "position", **each},
    }
    savemat(tmp_path / "a.mat", channels)
    is_it(read(tmp_path / "a.mat"))


def test_a_header_next_to_the_numbers_names_the_signal(tmp_path: Path) -> None:
    """Two channels in volts, of which only the names show which one drives."""
    signals = {"Time": ("s", T), "Gauge": ("V", Y), "Drive": ("V", U)}
    written: dict[str, Any] = {}
    for i, (name, (unit, values)) in enumerate(signals.items(), 1):
        written[f"Channel_{i}_Data"] = values
        written[f"Channel_{i}_Header"] = {"SignalName": name, "Unit": unit}
    savemat(tmp_path / "a.mat", written)
    found = read(tmp_path / "a.mat")
    assert "drive from 'Drive' (V) in v, displacement from 'Gauge' (V) in v" in found.read
    np.testing.assert_allclose(found.drive, U, rtol=1e-6)


@pytest.mark.parametrize("last", ["value", "data"])
def test_the_name_of_a_group_counts_where_the_last_is_that_of_all(
    tmp_path: Path, last: str
) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["time"] = T
        file[f"STAGE:VOLT-RB/{last}"], file[f"STAGE:POS-RB/{last}"] = U, Y
    is_it(read(tmp_path / "a.h5", drive_unit="v", unit="um"))


@pytest.mark.parametrize("period", ["Tinterval", "sample_interval"])
def test_the_interval_of_a_picoscope_is_the_period(tmp_path: Path, period: str) -> None:
    savemat(tmp_path / "a.mat", {"drive_v": U, "pos_um": Y, period: 0.005})
    is_it(read(tmp_path / "a.mat"))


@pytest.mark.parametrize("blocks", [False, True])
def test_names_of_channels_in_rows_are_refused_as_such(tmp_path: Path, blocks: bool) -> None:
    rows = [{"ts": t, "topic": f"lab/{k}", "payload": float(x)}
            for t, *pair in zip(T.tolist(), U, Y, strict=True)
            for k, x in zip(("voltage", "position_um"), pair, strict=True)]  # fmt: skip
    rows = sorted(rows, key=lambda row: row["topic"]) if blocks else rows
    (tmp_path / "a.jsonl").write_text("\n".join(map(json.dumps, rows)))
    said = asked(tmp_path / "a.jsonl")
    assert "topic names the channel of each row ('lab/" in said


def test_a_list_of_names_next_to_a_list_of_numbers_is_no_row_of_channels(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["names"] = ["Voltage", "Position", "Time"]
        file["offsets"] = [0.0, 0.5, 0.25]
        file["data"] = np.stack([U, Y, T], axis=1)
    assert "names the channel of each row" not in asked(tmp_path / "a.h5")


def test_a_source_drives_and_a_reading_measures(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    body = "\n".join(f"{t},{y},{u}" for t, u, y in zip(T, U, Y, strict=True))
    path.write_text(f"Relative Time [s],Reading [V],Source Value [V]\n{body}\n")
    found = read(path)
    np.testing.assert_allclose(found.drive, U)
    assert "drive from 'Source Value [V]', displacement from 'Reading [V]'" in found.read
