"""Units and roles in files of other programs: what is read has the numbers that were written, and
what a file states but dehyst does not know is asked for."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from dehyst.daemon.files.foreign.reading import ReadOptions
from dehyst.daemon.files.foreign.units import read_heading
from dehyst.daemon.files.recordings import read_columns, read_recording
from dehyst.daemon.main import main
from dehyst.models.errors import BadRecording
from dehyst.models.recording import Floats, Recording

N = 300
ROW = np.arange(N, dtype=np.float64)
T: Floats = np.asarray(1e-3 * ROW)
U: Floats = np.asarray(np.round(50 + 40 * np.sin(2 * np.pi * ROW / 97) * (1 - ROW / 900), 3))
Y: Floats = np.asarray(np.round(0.1 * U + 0.4 * np.sin(2 * np.pi * ROW / 97 - 0.4), 3))
USUAL = ("Time (s)", "Voltage (V)", "Displacement (um)")


def write(path: Path, headings: Sequence[str], *columns: Floats) -> Path:
    rows = [",".join(repr(float(x)) for x in row) for row in zip(*columns, strict=True)]
    path.write_text("\n".join([",".join(headings), *rows]) + "\n")
    return path


def read(path: Path, reading: ReadOptions | None = None) -> Recording:
    return read_recording(path, need_displacement=True, reading=reading or ReadOptions())


def asked(path: Path, reading: ReadOptions | None = None) -> str:
    with pytest.raises(BadRecording) as error:
        read(path, reading)
    assert "\n" not in str(error.value)
    return str(error.value)


def is_it(found: Recording) -> None:
    assert (found.drive_unit, found.displacement_unit) == ("v", "um")
    assert found.displacement is not None
    np.testing.assert_allclose(found.t_s, T, atol=1e-9)
    np.testing.assert_allclose(found.drive, U, rtol=1e-12)
    np.testing.assert_allclose(found.displacement, Y, rtol=1e-12)


@pytest.mark.parametrize(
    ("heading", "stated"),
    [
        ("Voltage (x100 V)", "x100 V"),
        ("Voltage (dV)", "dV"),
        ("Voltage (0.1 V)", "0.1 V"),
        ("Voltage (MV)", "MV"),
        ("Voltage_MV", "MV"),
        ("Voltage / dV", "dV"),
        ("Voltage (x100) V", "x100"),
        ("Voltage (V) / 100", "/ 100"),
        ("Drive (bar)", "bar"),
        ("Drive / bar", "bar"),
        ("Drive (kV/mm)", "kV/mm"),
    ],
)
def test_a_stated_unit_that_is_not_known_is_not_volts(
    tmp_path: Path, heading: str, stated: str
) -> None:
    path = write(tmp_path / "a.csv", ("Time (s)", heading, "Probe (um)"), T, U, Y)
    text = asked(path)
    assert f"states '{stated}'" in text
    assert "--drive-unit" in text
    is_it(read(path, ReadOptions(drive_unit="v")))


def test_a_drive_of_charge_can_be_confirmed(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", ("Time (s)", "Charge (uC)", "Probe (um)"), T, U, Y)
    assert '--columns u="Charge (uC)"' in asked(path)
    assert "states 'uC'" in asked(path, ReadOptions({"u": "Charge (uC)"}))
    is_it(read(path, ReadOptions({"u": "Charge (uC)"}, drive_unit="v")))


@pytest.mark.parametrize(
    "heading", ["Displacement (Mm)", "Displacement (nm/10)", "Strain (um/m)", "Strain um/m"]
)
def test_a_displacement_in_no_known_unit_is_asked_for(tmp_path: Path, heading: str) -> None:
    path = write(tmp_path / "a.csv", (*USUAL[:2], heading), T, U, Y)
    text = asked(path)
    assert heading in text
    assert "--unit" in text


@pytest.mark.parametrize("heading", ["Velocity (um/s)", "Velocity, um/s", "Field (kV/mm)"])
def test_a_quotient_is_no_role_and_stays_a_channel(tmp_path: Path, heading: str) -> None:
    heading = f'"{heading}"'
    found = read(write(tmp_path / "a.csv", (*USUAL, heading), T, U, Y, 3 * Y))
    is_it(found)
    ((name, values),) = found.channels.items()
    assert name.startswith(("velocity", "field"))
    np.testing.assert_allclose(values, 3 * Y)


@pytest.mark.parametrize(
    ("heading", "unit"),
    [
        ("Voltage (mV).2", "mv"),
        ("Voltage_mV.1", "mv"),
        ("Voltage (CH1) [V]", "v"),
        ("Weg (Sensor) / µm", "um"),
        ("Weg s / um", "um"),
        ("s / µm", "um"),
        ("Voltage (mV", "mv"),
        ("Sensor D", ""),
        ("Time (days)", "d"),
        ("Voltage (V) (mV)", ""),
        ("Channel A", ""),
        ("Weg (Sensor) A", ""),
        ("Weg / m", "m"),
        ("Weg in m", "m"),
        ("Weg [m]", "m"),
        ("Time_h", "h"),
        ("temp_c", "c"),
        ("Strom A", "a"),
    ],
)
def test_the_unit_in_a_heading(heading: str, unit: str) -> None:
    assert read_heading(heading).unit == unit


def test_the_second_column_of_one_name_keeps_its_unit(tmp_path: Path) -> None:
    names = ("Time (s)", "Voltage (mV)", "Voltage (mV)", "Probe (um)")
    path = write(tmp_path / "a.csv", names, T, 0 * U, 1e3 * U, Y)
    assert "which is the drive" in asked(path)
    is_it(read(path, ReadOptions({"u": 2})))


@pytest.mark.processes
def test_an_attribute_that_is_a_list_of_one_text(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for name, values, unit in (("t", T, "s"), ("voltage", 1e3 * U, "mV"), ("probe", Y, "um")):
            file[name] = values
            file[name].attrs["units"] = np.array([unit], dtype=object)
    is_it(read(tmp_path / "a.h5"))
    with h5py.File(tmp_path / "a.h5", "a") as file:
        file["voltage"].attrs["units"] = "dV"
    assert "states 'dV'" in asked(tmp_path / "a.h5")


def test_a_line_of_units_may_hold_one_that_is_not_known(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", ("time", "drive", "sensor"), T, U, Y)
    path.write_text(path.read_text().replace("sensor\n", "sensor\ns,bar,um\n"))
    assert "states 'bar'" in asked(path)
    is_it(read(path, ReadOptions(drive_unit="v")))


def test_a_channel_keeps_the_name_that_it_is_given(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", (*USUAL, "PT100 (C)"), T, U, Y, 0.01 * U)
    found = read(path, ReadOptions({"temp_c": "PT100 (C)"}))
    is_it(found)
    np.testing.assert_allclose(found.channels["temp_c"], 0.01 * U)
    assert "temp_c from 'PT100 (C)'" in found.read
    assert "is in um" in asked(
        write(path, (*USUAL, "Z (um)"), T, U, Y, Y),
        ReadOptions({"y": "Displacement (um)", "z_nm": "Z (um)"}),
    )


def test_a_channel_takes_no_role_away(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", ("t_s", "u_v", "y_um"), T, U, Y)
    with pytest.raises(BadRecording, match="no drive is left"):
        read_columns(path, reading=ReadOptions({"z": "u_v"}))
    found = read(path, ReadOptions({"clock": "t_s"}, rate_hz=1000.0))
    np.testing.assert_allclose(found.channels["clock"], T)
    write(path, (*USUAL, "Monitor"), T, U, Y, U)
    assert "u_mv is not free" in asked(path, ReadOptions({"u_mv": "Monitor"}))


def test_two_columns_and_a_period_of_their_own(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    rows = "".join(f"{u},{y}\n" for u, y in zip(U, Y, strict=True))
    path.write_text(f"Sample Interval,0.001\nmade by,us\nCH1,CH2\n{rows}")
    is_it(read(path, ReadOptions({"u": "CH1", "y": "CH2"}, unit="um")))


@pytest.mark.parametrize("start", [0.0, 45356.5])
def test_days(tmp_path: Path, start: float) -> None:
    days = start + T / 86400
    found = read(write(tmp_path / "a.csv", ("Time (days)", *USUAL[1:]), days, U, Y))
    np.testing.assert_allclose(found.t_s - found.t_s[0], T, atol=1e-6)
    text = asked(write(tmp_path / "a.csv", ("Time", *USUAL[1:]), days, U, Y))
    assert "if these are days" in text
    assert "--time-unit" in text


def test_seconds_of_a_day_are_still_seconds(tmp_path: Path) -> None:
    found = read(write(tmp_path / "a.csv", ("Time", *USUAL[1:]), 45356.5 + T, U, Y))
    np.testing.assert_allclose(found.t_s - 45356.5, T, atol=1e-9)


def test_a_unit_of_time_that_is_not_known_is_asked_for(tmp_path: Path) -> None:
    for heading, stated in (("Time (weeks)", "weeks"), ("Time (Ms)", "Ms")):
        path = write(tmp_path / "a.csv", (heading, *USUAL[1:]), T, U, Y)
        assert f"states '{stated}'" in asked(path)
        is_it(read(path, ReadOptions(time_unit="s")))


@pytest.mark.parametrize(
    ("headings", "reading", "both"),
    [
        (("t_s", "u_v", "y_nm"), ReadOptions(unit="um"), "in nm, but --unit says um"),
        (USUAL, ReadOptions(drive_unit="mV"), "in v, but --drive-unit says mv"),
        (("t_s", "u_v", "Sensor (V)"), ReadOptions(unit="um"), "in v, but --unit says um"),
    ],
)
def test_an_option_does_not_overrule_a_heading(
    tmp_path: Path, headings: Sequence[str], reading: ReadOptions, both: str
) -> None:
    assert both in asked(write(tmp_path / "a.csv", headings, T, U, Y), reading)


@pytest.mark.parametrize(
    "headings",
    [
        ("Time (s)", "Voltage set (V)", "Probe (um)", "Voltage measured (V)"),
        ("Time (s)", "Output Voltage (V)", "Probe (um)"),
    ],
)
def test_a_measured_voltage_is_no_displacement_beside_a_length(
    tmp_path: Path, headings: Sequence[str]
) -> None:
    path = write(tmp_path / "a.csv", headings, *(T, U, Y, 0.9 * U)[: len(headings)])
    is_it(read(path))
    is_it(read(path, ReadOptions({"y": "Probe (um)"})))


def test_a_measured_voltage_may_be_the_gauge(tmp_path: Path) -> None:
    names = ("Time (s)", "Drive voltage (V)", "Measured voltage (V)")
    found = read(write(tmp_path / "a.csv", names, T, U, Y))
    assert found.displacement is not None
    assert found.displacement_unit == "v"
    np.testing.assert_allclose(found.displacement, Y)


@pytest.mark.processes
def test_the_advice_for_several_runs_names_one_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    for title, factor in (("Run 1", 1.0), ("Run 2", 0.5)):
        sheet = book.create_sheet(title)
        sheet.append(list(USUAL))
        for row in zip(T, factor * U, factor * Y, strict=True):
            sheet.append([float(x) for x in row])
    path = tmp_path / "a.xlsx"
    book.save(path)
    run = 't="Run 1/Time (s)",u="Run 1/Voltage (V)",y="Run 1/Displacement (um)"'
    assert f"--columns {run}" in asked(path)
    text = asked(path, ReadOptions({"u": "Run 2/Voltage (V)"}))
    assert '--columns t="Run 2/Time (s)",y="Run 2/Displacement (um)"' in text
    words = [word for one in run.split(",") for word in ("--columns", one)]
    assert main(["convert", str(path), str(tmp_path / "a.csv"), *words]) == 0
    capsys.readouterr()
    is_it(read(tmp_path / "a.csv"))


def test_headings_in_capitals_throughout_keep_their_units(tmp_path: Path) -> None:
    path = write(
        tmp_path / "a.csv", ("TIME (MS)", "VOLTAGE (V)", "DISPLACEMENT (NM)"), 1e3 * T, U, 1e3 * Y
    )
    found = read(path)
    np.testing.assert_allclose(found.t_s, T, atol=1e-9)
    np.testing.assert_allclose(found.displacement, 1e3 * Y, rtol=1e-6)
    assert found.displacement_unit == "nm"
