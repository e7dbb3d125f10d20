"""Which column of a file of another program is the drive and which the displacement: read as it was
written, or asked for, and what the question advises reads right."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.daemon.files.test_foreign_units import N, T, U, Y, asked, is_it, read, write

from dehyst.daemon.files.foreign.reading import ReadOptions, parse_columns
from dehyst.daemon.files.foreign.units import read_heading
from dehyst.models.recording import Floats, Recording


def columns_of(headings: Sequence[str]) -> dict[str, Floats]:
    """Return the times and different numbers for every other heading."""
    return {name: T if j == 0 else U + 10 * j for j, name in enumerate(headings)}


def is_between(found: Recording, drive: Floats, displacement: Floats) -> None:
    assert found.displacement is not None
    np.testing.assert_allclose(found.t_s, T, atol=1e-9)
    np.testing.assert_allclose(found.drive, drive, rtol=1e-12)
    np.testing.assert_allclose(found.displacement, displacement, rtol=1e-12)


def advised(text: str) -> Mapping[str, str | int]:
    """Return the columns that a refusal advises."""
    options = re.findall(r'--columns ((?:\w+=(?:"[^"]*"|[^,;\s]+),?)+)', text)
    assert options, text
    return parse_columns(",".join(options))


def file_with(path: Path, headings: Sequence[str]) -> dict[str, Floats]:
    columns = columns_of(headings)
    write(path, list(columns), *columns.values())
    return columns


S = "Time (s)"
ASKS = {
    "y beside x": ((S, "Voltage (V)", "X (um)", "Y (um)"), "Voltage (V)", "X (um)"),
    "y of three axes": ((S, "Vz (V)", "x (nm)", "y (nm)", "z (nm)"), "Vz (V)", "z (nm)"),
    "two axes": ((S, "Vx (V)", "Vy (V)", "x (um)", "y (um)"), "Vx (V)", "x (um)"),
    "y in volts": ((S, "Voltage (V)", "x (um)", "y (V)"), "Voltage (V)", "x (um)"),
    "axes in volts": ((S, "X (V)", "Y (V)"), "X (V)", "Y (V)"),
    "voltages of axes": (
        (S, "X voltage (V)", "Y voltage (V)", "X (um)", "Y (um)"), "X voltage (V)", "X (um)"),
    "drives of axes": (
        (S, "X drive (V)", "Y drive (V)", "X position (um)", "Y position (um)"),
        "X drive (V)", "X position (um)"),
    "sides": (
        (S, "Left drive (V)", "Right drive (V)", "Right sensor (um)", "Left sensor (um)"),
        "Left drive (V)", "Left sensor (um)"),
    "numbered": (("t_s", "v0", "y0", "v1", "y1"), "v0", "y0"),
    "a word without a unit": (
        (S, "Vpzt (V)", "Amplifier", "Position (um)"), "Vpzt (V)", "Position (um)"),
    "input without a unit": ((S, "Piezo (V)", "Position (um)", "Input"),
                             "Piezo (V)", "Position (um)"),
    "sensor without a unit": ((S, "Drive (V)", "Sensor", "z (um)"), "Drive (V)", "z (um)"),
    "outputs and inputs": (("Zeit (s)", "Ausgang (V)", "Eingang (V)"),
                           "Ausgang (V)", "Eingang (V)"),
    "input and output": ((S, "Input (V)", "Output (V)"), "Input (V)", "Output (V)"),
    "of an amplifier": ((S, "Vin (V)", "Vout (V)", "Position (um)"), "Vin (V)", "Position (um)"),
    "output of what": ((S, "Drive (V)", "Output (V)"), "Drive (V)", "Output (V)"),
    "analog input beside a length": ((S, "AO (V)", "AI (V)", "gap (um)"), "AO (V)", "gap (um)"),
    "no roles": ((S, "foo", "bar"), "foo", "bar"),
    "own names for two sensors": (("t_s", "Drive (V)", "y_v", "y_um"), "Drive (V)", "y_um"),
}  # fmt: skip


@pytest.mark.parametrize("what", ASKS)
def test_what_is_asked_for_can_be_followed(tmp_path: Path, what: str) -> None:
    headings, u, y = ASKS[what]
    columns = file_with(tmp_path / "a.csv", headings)
    text = asked(tmp_path / "a.csv")
    unit = "um" if read_heading(y).unit == "" and y[:2] != "y_" else ""
    found = read(tmp_path / "a.csv", ReadOptions(advised(text), unit=unit))
    is_between(found, columns[u], columns[y])


READS = {
    "y alone": ((S, "Voltage (V)", "y (um)"), "Voltage (V)", "y (um)"),
    "a status": ((S, "Vpzt (V)", "Amplifier status", "z (um)"), "Vpzt (V)", "z (um)"),
    "a mode": ((S, "Vpzt (V)", "Control mode", "Pos (um)"), "Vpzt (V)", "Pos (um)"),
    "a temperature": ((S, "Piezo (V)", "Amplifier temp", "Pos (um)"), "Piezo (V)", "Pos (um)"),
    "analog": ((S, "Analog Input (V)", "Analog Output (V)"),
               "Analog Output (V)", "Analog Input (V)"),
    "converters": ((S, "ADC input (V)", "DAC output (V)"), "DAC output (V)", "ADC input (V)"),
    "ao and ai": ((S, "ai0 (V)", "ao0 (V)"), "ao0 (V)", "ai0 (V)"),
    "output of the piezo": ((S, "Sensor input (V)", "Piezo output (V)"),
                            "Piezo output (V)", "Sensor input (V)"),
    "analog input alone": ((S, "AI0 (V)", "Position (um)"), "AI0 (V)", "Position (um)"),
    "input and output of the stage": ((S, "Input (V)", "Output (um)"),
                                      "Input (V)", "Output (um)"),
}  # fmt: skip


@pytest.mark.parametrize("what", READS)
def test_what_the_headings_say_is_read(tmp_path: Path, what: str) -> None:
    headings, u, y = READS[what]
    columns = file_with(tmp_path / "a.csv", headings)
    is_between(read(tmp_path / "a.csv"), columns[u], columns[y])


@pytest.mark.parametrize("heading", ["Tracking error (um)", "Wavelength (nm)", "Noise (nm)"])
def test_what_is_no_displacement_is_not_advised(tmp_path: Path, heading: str) -> None:
    file_with(tmp_path / "a.csv", (S, "Voltage (V)", heading))
    assert "add --columns y=..." in asked(tmp_path / "a.csv")


@pytest.mark.parametrize("axis", "xy")
def test_the_advice_is_of_the_axis_that_was_named(tmp_path: Path, axis: str) -> None:
    columns = file_with(tmp_path / "a.csv", (S, "Vx (V)", "Vy (V)", "x (um)", "y (um)"))
    text = asked(tmp_path / "a.csv", ReadOptions({"u": f"V{axis} (V)"}))
    assert advised(text) == {"y": f"{axis} (um)"}
    given = ReadOptions({"u": f"V{axis} (V)", **advised(text)})
    is_between(read(tmp_path / "a.csv", given), columns[f"V{axis} (V)"], columns[f"{axis} (um)"])


@pytest.mark.processes
def test_axes_in_hdf5(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for name, values, unit in (
            ("t", T, "s"),
            ("u", U, "V"),
            ("x", 2 * Y, "um"),
            ("y", Y, "um"),
        ):
            file[name] = values
            file[name].attrs["units"] = unit
    assert "which is the displacement" in asked(tmp_path / "a.h5")
    is_it(read(tmp_path / "a.h5", ReadOptions({"y": "y"})))


@pytest.mark.processes
@pytest.mark.parametrize("run", [1, 2])
def test_the_advice_for_structures_of_matlab_names_one(tmp_path: Path, run: int) -> None:
    from scipy.io import savemat

    runs = {f"run{k}": {"t": T * k, "u": U * k, "y": Y * k} for k in (1, 2)}
    savemat(tmp_path / "a.mat", runs)
    given = {"u": f"run{run}.u"} if run > 1 else {}
    text = asked(tmp_path / "a.mat", ReadOptions(given, unit="um"))
    assert "it holds several runs: name one" in text
    found = read(tmp_path / "a.mat", ReadOptions({**given, **advised(text)}, unit="um"))
    np.testing.assert_allclose(found.t_s, T * run, atol=1e-9)
    is_between(replace(found, t_s=T), U * run, Y * run)


@pytest.mark.processes
@pytest.mark.parametrize("groups", [("Analog Output", "Analog Input"), ("A", "B")])
def test_one_channel_name_in_two_groups(tmp_path: Path, groups: tuple[str, str]) -> None:
    nptdms = pytest.importorskip("nptdms")
    more = {"unit_string": "V", "wf_increment": 1e-3, "wf_start_offset": 0.0}
    with nptdms.TdmsWriter(tmp_path / "a.tdms") as file:
        file.write_segment(
            [
                nptdms.ChannelObject(group, "Voltage", values, more)
                for group, values in sorted(zip(groups, (U, Y), strict=True), key=lambda g: g[0])
            ]
        )
    given = ReadOptions()
    if groups[0] == "A":
        given = ReadOptions(advised(asked(tmp_path / "a.tdms")))
    is_between(read(tmp_path / "a.tdms", given), U, Y)


ROW = range(N)
NUMBERED = {
    "a column of text": (
        "".join(f"{T[i]!r},run,{U[i]!r},{Y[i]!r},25\n" for i in ROW), {"t": 0, "u": 2, "y": 3}),
    "text under headings": (
        "time,state,ch1,ch2\n" + "".join(f"{T[i]!r},on,{U[i]!r},{Y[i]!r}\n" for i in ROW),
        {"t": 0, "u": 2, "y": 3}),
    "row numbers": (
        f"index,Time (s),{'a' * 50} (V),{'b' * 50} (V)\n"
        + "".join(f"{i},{T[i]!r},{U[i]!r},{Y[i]!r}\n" for i in ROW), {"u": 2, "y": 3}),
    "no heading": (
        "index,Time (s),,u_v\n" + "".join(f"{i},{T[i]!r},{Y[i]!r},{U[i]!r}\n" for i in ROW),
        {"y": 2}),
}  # fmt: skip


@pytest.mark.parametrize("what", NUMBERED)
def test_numbers_of_columns_are_those_in_the_file(tmp_path: Path, what: str) -> None:
    text, numbers = NUMBERED[what]
    path = tmp_path / "a.csv"
    path.write_text(re.sub(r"np\.float64\(([^)]*)\)", r"\1", text))
    if what != "text under headings":
        assert advised(asked(path)) == numbers
    unit = "v" if what == "row numbers" else "um"
    is_between(read(path, ReadOptions(numbers, unit=unit)), U, Y)


@pytest.mark.processes
def test_numbers_in_a_spreadsheet_count_its_texts(tmp_path: Path) -> None:
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    for t, u, y in zip(T, U, Y, strict=True):
        book.active.append([float(t), "run", float(u), float(y)])
    book.save(tmp_path / "a.xlsx")
    numbers = advised(asked(tmp_path / "a.xlsx"))
    assert numbers == {"t": 0, "u": 2, "y": 3}
    is_it(read(tmp_path / "a.xlsx", ReadOptions(numbers, unit="um")))


@pytest.mark.parametrize(
    ("names", "units"),
    [
        (("Time", "Channel A", "Channel B"), ("(ms)", "(V)", "(um)")),
        (("Time", "Channel N", "Channel C"), ("ms", "V", "um")),
        (("Time", "Drive_A", "Sensor_C"), ("ms", "V", "um")),
    ],
)
def test_a_letter_is_no_unit_where_the_unit_is_given_apart(
    tmp_path: Path, names: Sequence[str], units: Sequence[str]
) -> None:
    path = write(tmp_path / "a.csv", names, 1e3 * T, U, Y)
    path.write_text(path.read_text().replace("\n", f"\n{','.join(units)}\n", 1))
    is_it(read(path))


@pytest.mark.parametrize("heading", ["Position_A", "Sensor C", "Weg m", "Sensor: K"])
def test_a_letter_that_may_be_a_label_is_asked_for(tmp_path: Path, heading: str) -> None:
    path = write(tmp_path / "a.csv", (S, "Voltage (V)", heading), T, U, Y)
    assert "which may be a label: add --unit" in asked(path)
    is_it(read(path, ReadOptions(unit="um")))


CONFLICTS = {
    "volts over mV": (
        (S, "Voltage (V)", "Probe (um)"), "s,mV,um", (1, 1e3, 1), ReadOptions(drive_unit="mv")),
    "um over nm": ((S, "Drive (V)", "Probe (um)"), "s,V,nm", (1, 1, 1), ReadOptions(unit="um")),
    "mm over um": ((S, "Drive (V)", "Probe (mm)"), "s,V,um", (1, 1, 1e-3), ReadOptions(unit="mm")),
    "x100 V over V": (
        (S, "Drive (x100 V)", "Probe (um)"), "s,V,um", (1, 1, 1), ReadOptions(drive_unit="v")),
    "own names": (("t_s", "u_v", "y_nm"), "s,V,um", (1, 1, 1), ReadOptions(unit="um")),
    "times": ((S, "Drive (V)", "Probe (um)"), "ms,V,um", (1e3, 1, 1), ReadOptions(time_unit="ms")),
}  # fmt: skip


@pytest.mark.parametrize("what", CONFLICTS)
def test_two_units_that_differ_are_asked_for(tmp_path: Path, what: str) -> None:
    headings, below, factors, reading = CONFLICTS[what]
    columns = [f * column for f, column in zip(factors, (T, U, Y), strict=True)]
    path = write(tmp_path / "a.csv", headings, *columns)
    path.write_text(path.read_text().replace("\n", f"\n{below}\n", 1))
    text = asked(path)
    assert "states two units" in text
    option = "--time-unit" if reading.time_unit else "--unit" if reading.unit else "--drive-unit"
    assert f"add {option}" in text
    is_it(read(path, reading))


@pytest.mark.parametrize(
    ("columns", "unit"), [(("y_v", "y_um"), "um"), (("y_counts", "y_nm"), "nm"), (("y_v",), "v")]
)
def test_a_length_precedes_the_voltage_of_its_sensor(
    tmp_path: Path, columns: Sequence[str], unit: str
) -> None:
    values = {name: Y * (1.0 if name.endswith(unit) else 7.0) for name in columns}
    found = read(write(tmp_path / "a.csv", ("t_s", "u_v", *values), T, U, *values.values()))
    is_between(found, U, Y)
    assert found.displacement_unit == unit
    said = f"displacement from {columns[-1]}, not from {columns[0]}"
    assert (said in found.read) == (len(columns) > 1)


@pytest.mark.parametrize(
    ("unit", "kept", "factor"),
    [("m", "um", 1e6), ("pm", "nm", 1e-3), ("rad", "mrad", 1e3), ("deg", "mrad", 17.453292519943)],
)
def test_units_of_a_displacement(tmp_path: Path, unit: str, kept: str, factor: float) -> None:
    path = write(tmp_path / "a.csv", ("t_s", "u_v", "Sensor"), T, U, Y)
    found = read(path, ReadOptions(unit=unit))
    is_between(found, U, factor * Y)
    assert found.displacement_unit == kept
