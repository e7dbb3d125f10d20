"""Files as further programs of a laboratory write them: remarks between and below the numbers,
factors in a person's own words, a word beside each number, set points of the drive, rows that a
column marks as invalid. Numbers of another scale are never read in silence."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import openpyxl
import pytest
from tests.rigs.foreign_files import asked, read

from dehyst.models.recording import Recording

N = 300
T = np.round(0.005 * np.arange(N), 3)
U = np.round(60 + 70 * np.sin(2 * np.pi * 1.5 * T), 3)
Y = np.round(3 + 0.1 * U + 0.9 * np.cos(2 * np.pi * 1.5 * T), 4)
HEAD = "Time (s);Voltage (V);Position (um)"
NOT_APPLIED = (
    "which is not applied: add --drive-unit and --unit, the unit of the numbers as they are"
)


def is_it(found: Recording) -> None:
    assert found.displacement is not None
    assert (found.drive_unit, found.displacement_unit) == ("v", "um")
    np.testing.assert_allclose(found.t_s - found.t_s[0], T, atol=2e-5)
    np.testing.assert_allclose(found.drive, U, atol=1e-6)
    np.testing.assert_allclose(found.displacement, Y, atol=1e-6)


def plain(i: int) -> str:
    return f"{T[i]};{U[i]};{Y[i]}"


def write(
    path: Path, head: str = HEAD, row: Callable[[int], str] = plain, end: str = "", mid: str = ""
) -> Path:
    """Write a file. mid: a line between the first half and the second; end: lines below."""
    body = [row(i) for i in range(N)]
    body[N // 2 : N // 2] = [mid] if mid else []
    path.write_text("".join(f"{line}\n" for line in (head, *body)) + end, encoding="utf-8")
    return path


PLACES = {
    "below": {"end": "{}\n"},
    "below, in a comment": {"end": "# {}\n"},
    "between": {"mid": "{}"},
    "between, in a comment": {"mid": "# {}"},
}


@pytest.mark.parametrize("place", PLACES)
def test_a_factor_below_or_between_the_numbers_is_asked_for(tmp_path: Path, place: str) -> None:
    def put(line: str) -> Path:
        where = {key: text.format(line) for key, text in PLACES[place].items()}
        return write(tmp_path / "a.csv", **where)

    said = asked(put("Gain = 15"))
    assert "the file states 'Gain = 15'" in said
    assert NOT_APPLIED in said
    is_it(read(put("Gain = 15"), drive_unit="v", unit="um"))
    is_it(read(put("Operator = 15")))


@pytest.mark.parametrize("place", PLACES)
def test_a_unit_below_or_between_the_numbers_is_asked_for(tmp_path: Path, place: str) -> None:
    def put(head: str, line: str) -> Path:
        where = {key: text.format(line) for key, text in PLACES[place].items()}
        return write(tmp_path / "a.csv", head, **where)

    drive = put("Time (s);Drive;Position (um)", "drive in mV")
    assert "may be another than volts (drive in mV" in asked(drive)
    is_it(read(drive, drive_unit="v"))
    time = put("Time;Drive (V);Position (um)", "time in ms")
    assert "may be another than seconds (time in ms" in asked(time)
    is_it(read(time, time_unit="s"))


def test_a_factor_below_does_not_yield_to_one_of_its_name_above(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", f"Gain;1\n{HEAD}", end="Gain;15\n")
    assert "the file states 'Gain (again) 15'" in asked(path)


def test_units_that_igor_states_below_the_waves_are_asked_for(tmp_path: Path) -> None:
    head = "IGOR\nWAVES/D\ttime_s\tdrive\tposition_um\nBEGIN"
    end = 'END\nX SetScale d 0,0,"mV", drive\n'
    path = write(tmp_path / "a.txt", head, lambda i: f"\t{T[i]}\t{U[i]}\t{Y[i]}", end)
    assert 'may be another than volts (X SetScale d 0,0,"mV", drive)' in asked(path)
    is_it(read(path, drive_unit="v"))


@pytest.mark.processes
def test_a_factor_below_the_numbers_of_a_sheet_is_asked_for(tmp_path: Path) -> None:
    book = openpyxl.Workbook()
    book.active.append(HEAD.split(";"))
    for row in zip(T.tolist(), U.tolist(), Y.tolist(), strict=True):
        book.active.append(row)
    book.active.append(["Amplifier gain", 15])
    book.save(tmp_path / "a.xlsx")
    assert "the file states 'Amplifier gain 15'" in asked(tmp_path / "a.xlsx")
    is_it(read(tmp_path / "a.xlsx", drive_unit="v", unit="um"))


@pytest.mark.parametrize(
    "line",
    [
        "HV amp: 15x", "Amplifier x15", "HV amp gain: 15", "Piezo voltage = 15 * AO0",
        "piezo voltage is 15 × AO0", "voltage is piezo voltage / 15", "HV monitor 1:100",
        "drive times 15 gives the piezo voltage", "voltage reduced by 15", "scaled by 1/15",
        "1 V = 15 V", "0-10 V = 0-150 V", "10 V correspond to 150 V at the piezo",
        "Amplifier: E-505 (15 V per V)", "um/V: 2", "2 µm = 1 V", "1 V per 15 V", "x1;x15;x1",
        "a factor of 15", "Sensor: 10 um / 10 V", "10 V = 100 um", "5 um = 1 V",
    ],
)  # fmt: skip
def test_a_factor_in_a_persons_own_words_is_asked_for(tmp_path: Path, line: str) -> None:
    path = write(tmp_path / "a.csv", f"# {line}\n{HEAD}")
    said = asked(path)
    assert f"the file states '{line.replace(';', ' ')}'" in said
    assert NOT_APPLIED in said
    is_it(read(path, drive_unit="v", unit="um"))


@pytest.mark.parametrize(
    "line",
    [
        "Piezo: P-885.51, 5x5x18 mm", "position averaged 16x", "drive cycle 3x", "HV monitor 1:1",
        "drive 10 Vpp, 3 Hz", "Probe Attenuation;10;1", "Drive file 1/2", "slew rate 1000 V/s",
        "drive from 0 V to 150 V", "14/03/2025 drive test", "Vertical scale 5 V/div", "x1;x1;x1",
        "Gain;1.0E+00", "Faktor;1,0;1,0", "Calibration date: 14.03.2025", "Voltage ramp, 3x, 1 Hz",
        "position range 100 x 100 x 20 um", "Sensitivity: 1.00 V/V",
        "Stage: P-753, 12 um / 100 V", "Nominal stroke 15 um / 150 V", "maximum 150 V = 15 um",
        "Microscope objective: 20x, displacement by image correlation", "Actuator: 2x PK2JA2P2",
    ],
)  # fmt: skip
def test_other_numbers_beside_the_names_of_signals_are_harmless(tmp_path: Path, line: str) -> None:
    is_it(read(write(tmp_path / "a.csv", f"# {line}\n{HEAD}")))


def test_factors_between_the_names_and_the_numbers_are_asked_for(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", f"{HEAD}\nx1;x15;x1")
    assert "the file states 'x1 x15 x1'" in asked(path)


@pytest.mark.parametrize(
    ("heading", "stated"),
    [
        ("Voltage (V) gain 15", "gain 15"), ("Drive gain 15 (V)", "gain 15"),
        ("Drive gain=15 (V)", "gain=15"), ("Drive 15x (V)", "15x"), ("Drive gain 15", "gain 15"),
    ],
)  # fmt: skip
def test_a_gain_in_a_heading_is_asked_for(tmp_path: Path, heading: str, stated: str) -> None:
    path = write(tmp_path / "a.csv", f"Time (s);{heading};Position (um)")
    assert f"'{heading}' states '{stated}', which is not a known unit" in asked(path)
    is_it(read(path, drive_unit="v"))
    is_it(read(write(tmp_path / "b.csv", "Time (s);Drive gain 1 (V);Position (um)")))


ROWS = {
    "as many words": (f"{HEAD};S1;S2;S3", lambda i: f"{plain(i)};ok;closed;on"),
    "more words": (
        "Time (s);Voltage (V);Status;Severity;Position (um);Status;Severity;Valid",
        lambda i: f"{T[i]};{U[i]};OK;NO_ALARM;{Y[i]};OK;NO_ALARM;yes",
    ),
    "words in front": (f"Host;User;Run;Mode;{HEAD}", lambda i: f"pc1;anna;r1;on;{plain(i)}"),
    "a word behind the last number": ("t_s u_v y_um state", lambda i: f"{T[i]} {U[i]} {Y[i]} ok"),
    "words apart by blanks": (
        "t_s s1 u_v s2 y_um s3",
        lambda i: f"{T[i]} ok {U[i]} no {Y[i]} yes",
    ),
    "decimal commas": (
        f"{HEAD};S1;S2;S3;S4",
        lambda i: f"{plain(i)};ok;no;on;off".replace(".", ","),
    ),
}


@pytest.mark.parametrize("kind", ROWS)
def test_rows_of_more_words_than_numbers_are_read(tmp_path: Path, kind: str) -> None:
    found = read(write(tmp_path / "a.txt", *ROWS[kind]))
    is_it(found)
    assert "without numbers and left out: " in found.read


def test_one_number_beside_words_is_no_table(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", "Name;Value;Type;Note", lambda i: f"drive;{U[i]};real;")
    assert "holds no rows of numbers" in asked(path)


@pytest.mark.parametrize(
    "heading", ["pzt_drive_setpoint", "Sollspannung", "u_target", "Drive setpoint"]
)
def test_a_set_point_of_the_drive_is_no_target(tmp_path: Path, heading: str) -> None:
    head = f"Time (s);Drive (V);{heading};Position (um)"
    found = read(write(tmp_path / "a.csv", head, lambda i: f"{T[i]};{U[i]};{U[i] + 1};{Y[i]}"))
    is_it(found)
    assert "target from" not in found.read
    is_it(read(write(tmp_path / "b.csv", f"Time (s);{heading};Position (um)")))


def test_a_voltage_is_advised_as_the_drive_before_a_length(tmp_path: Path) -> None:
    head = "Time (ms);Ch1 Command (microns);Ch1 Control Output (V);Ch1 Sensor (microns)"
    path = write(tmp_path / "a.csv", head, lambda i: f"{1e3 * T[i]:g};{Y[i] + 1};{U[i]};{Y[i]}")
    said = asked(path)
    assert 'which is the drive? add --columns u="Ch1 Control Output (V)"' in said
    is_it(read(path, {"u": "Ch1 Control Output (V)"}))


@pytest.mark.parametrize("field", ["{:.4f}m", "{:.4f}u", "{:.4f}x10^0", "{:.3f}+002"])
def test_fields_that_are_no_plain_numbers_are_shown(tmp_path: Path, field: str) -> None:
    def row(i: int) -> str:
        return f"{T[i]};{field.format(U[i])};{Y[i]}"

    said = asked(write(tmp_path / "a.csv", HEAD, row))
    shown = field.format(U[0])
    assert f"'Voltage (V)' holds no number (the first field is '{shown}'): write each field" in said
    assert "formulas" not in said


@pytest.mark.parametrize("field", ["-.-", "--.--", "-----", "+++++", "**.**", "____", "???"])
def test_a_field_of_marks_alone_holds_no_value(tmp_path: Path, field: str) -> None:
    def row(i: int) -> str:
        return plain(i) if i != 7 else f"{T[i]};{U[i]};{field}"

    found = read(write(tmp_path / "a.csv", HEAD, row))
    assert found.displacement is not None
    assert np.flatnonzero(np.isnan(found.displacement)).tolist() == [7]


@pytest.mark.parametrize("minus", ["\u2013", "\u2010", "\uff0d", "- ", "\u2212"])
def test_a_dash_or_a_blank_in_a_sign_is_read(tmp_path: Path, minus: str) -> None:
    path = write(tmp_path / "a.csv", HEAD, lambda i: plain(i).replace("-", minus))
    is_it(read(path))


@pytest.mark.parametrize(("heading", "mark"), [("Valid", 0), ("Data OK", 0), ("invalid", 1)])
def test_rows_that_a_column_marks_as_invalid_are_said(
    tmp_path: Path, heading: str, mark: int
) -> None:
    def row(i: int) -> str:
        return f"{plain(i)};{mark if i in (5, 6) else 1 - mark}"

    found = read(write(tmp_path / "a.csv", f"{HEAD};{heading}", row))
    is_it(found)
    assert f"'{heading}' is {mark} in 2 rows, whose values are kept: empty their" in found.read
    whole = read(write(tmp_path / "b.csv", f"{HEAD};{heading}", lambda i: f"{plain(i)};{1 - mark}"))
    assert "whose values are kept" not in whole.read


@pytest.mark.parametrize("head", [HEAD, "t_s;u_v;y_um"])
@pytest.mark.parametrize("words", [("False", "True"), ("FALSE", "TRUE")])
def test_truth_values_in_words_are_those_of_a_spreadsheet(
    tmp_path: Path, head: str, words: tuple[str, str]
) -> None:
    def row(i: int) -> str:
        return f"{plain(i)};{words[i not in (5, 6)]}".replace(";", ",")

    found = read(write(tmp_path / "a.csv", f"{head};valid".replace(";", ","), row))
    is_it(found)
    assert "'valid' is 0 in 2 rows" in found.read


def test_channels_in_labelled_lines_are_to_be_transposed(tmp_path: Path) -> None:
    lines = [
        ",".join([name, *map(str, values[:60])])
        for name, values in zip(HEAD.split(";"), (T, U, Y), strict=True)
    ]
    (tmp_path / "a.csv").write_text("\n".join(lines) + "\n")
    said = asked(tmp_path / "a.csv")
    assert "3 rows of 60 numbers each; if each channel has a line of its own, transpose" in said
    assert "--rate" not in said


@pytest.mark.parametrize("line", ["X axis unit: s", "Y text: Z", "Curve number: 2"])
def test_a_label_with_its_value_names_no_columns(tmp_path: Path, line: str) -> None:
    path = write(tmp_path / "a.txt", line, lambda i: f"{T[i]} {U[i]} {Y[i]}")
    assert "3 columns of numbers without headings" in asked(path)


def test_a_known_unit_inside_a_heading_may_be_a_label(tmp_path: Path) -> None:
    said = asked(write(tmp_path / "a.csv", "time_ms_rel;Voltage (V);Position (um)"))
    assert "'time_ms_rel' states 'ms', which may be a label: add --time-unit s, ms or us" in said


def test_a_voltage_in_percent_is_advised_as_the_drive(tmp_path: Path) -> None:
    said = asked(write(tmp_path / "a.csv", "Time (s);Voltage (%);Position (um)"))
    assert "no heading names the drive" in said
    assert 'add --columns u="Voltage (%)"' in said


def test_one_rate_for_each_channel_is_one_rate(tmp_path: Path) -> None:
    found = read(write(tmp_path / "a.csv", f"SampleRate;200;200\n{HEAD}"))
    is_it(found)
    assert "the file states" not in found.read
    other = read(write(tmp_path / "a.csv", f"SampleRate;500;500\n{HEAD}"))
    assert "the file states SampleRate = 500, perhaps 500 Hz, its times 200 Hz" in other.read


@pytest.mark.parametrize("period", [2.0, 7.3])
def test_a_displacement_that_begins_again_is_said(tmp_path: Path, period: float) -> None:
    path = write(tmp_path / "a.csv", HEAD, lambda i: f"{T[i]};{U[i]};{Y[i] % period:.4f}")
    said = read(path).read
    assert "the displacement jumps by about" in said
    assert "if so, unwrap it first (numpy.unwrap with period=...)" in said


def test_other_jumps_of_a_displacement_are_not_said(tmp_path: Path) -> None:
    square = np.where(np.sin(2 * np.pi * 1.5 * T) > 0.0, 1.0, -1.0)
    others = {
        "a drive that jumps": (60 + 50 * square, 5 + 4 * square - 0.1 * (T * 9 % 1.0) * square),
        "a loop of friction": (U, 5 + 4 * np.where(np.cos(2 * np.pi * 1.5 * T) > 0.0, 1.0, -1.0)),
        "a single reading": (U, np.where(np.arange(N) == 70, 40.0, Y)),
        "none": (U, Y),
    }
    for u, y in others.values():
        path = write(tmp_path / "a.csv", HEAD, lambda i, u=u, y=y: f"{T[i]};{u[i]:.4f};{y[i]:.4f}")
        assert "jumps by about" not in read(path).read


UNITS_IN_FIELDS = {
    "next to a date": (
        "Time,drive,position",
        lambda i: f"2025-03-14 14:07:{50 + T[i]:06.3f},{U[i]} V,{Y[i]} µm",
    ),
    "in one column": ("Time (s);Drive;Position (um)", lambda i: f"{T[i]};{1e3 * U[i]:g} mV;{Y[i]}"),
    "without a blank": (
        "Time;Drive (V);Position",
        lambda i: f"{T[i]:.3f}s;{U[i]};{1e3 * Y[i]:g}nm",
    ),
    "as the heading says": (HEAD, lambda i: f"{T[i]};{U[i]} V;{Y[i]}"),
}


@pytest.mark.parametrize("kind", UNITS_IN_FIELDS)
def test_a_unit_that_each_field_of_a_column_repeats_is_its_unit(tmp_path: Path, kind: str) -> None:
    found = read(write(tmp_path / "a.csv", *UNITS_IN_FIELDS[kind]))
    scale = 1e3 if found.displacement_unit == "nm" else 1.0
    assert found.displacement is not None
    np.testing.assert_allclose(found.displacement / scale, Y, atol=1e-6)
    np.testing.assert_allclose(found.drive, U, atol=1e-6)
    np.testing.assert_allclose(found.t_s - found.t_s[0], T, atol=2e-5)


@pytest.mark.parametrize(
    ("head", "option"),
    [("Time (s);Drive (mV);Position (um)", "--drive-unit"), ("t;u;y\ns;mV;um", "--drive-unit")],
)
def test_a_unit_in_the_fields_against_the_one_above_is_asked_for(
    tmp_path: Path, head: str, option: str
) -> None:
    said = asked(write(tmp_path / "a.csv", head, lambda i: f"{T[i]};{U[i]} V;{Y[i]}"))
    assert option in said


def test_a_column_in_several_units_is_refused_as_a_whole(tmp_path: Path) -> None:
    def row(i: int) -> str:
        return f"{T[i]};{U[i] if i != 7 else 1e3 * U[i]:g} {'V' if i != 7 else 'mV'};{Y[i]}"

    assert "Voltage (V)' holds no number" in asked(write(tmp_path / "a.csv", HEAD, row))


@pytest.mark.parametrize("line", ["Channel 2: Range: 1 V/div, Attenuation: 10 X"])
def test_a_unit_alone_names_no_signal(tmp_path: Path, line: str) -> None:
    is_it(read(write(tmp_path / "a.csv", f"# {line}\n{HEAD}")))


def test_names_that_hold_commas_between_wide_blanks_are_found(tmp_path: Path) -> None:
    head = "% Time (s)    Terminal voltage (V)    Displacement field, Z component (um), Point: 5"
    is_it(read(write(tmp_path / "a.txt", head, lambda i: f"{T[i]}    {U[i]}    {Y[i]}")))


@pytest.mark.parametrize("end", ["Mean;60;9\nSlope;0.06\n", "Slope;0.06\nIntercept;3\n"])
def test_a_line_fitted_to_the_numbers_is_no_factor(tmp_path: Path, end: str) -> None:
    is_it(read(write(tmp_path / "a.csv", end=end)))
    above = write(tmp_path / "b.csv", f"# Slope: 0.06\n{HEAD}")
    assert "the file states 'Slope: 0.06'" in asked(above)


def test_a_row_of_empty_fields_is_a_sample_that_is_missing(tmp_path: Path) -> None:
    lines = [f"{u};{y}" for u, y in zip(U, Y, strict=True)]
    lines[100:103] = [";"] * 3
    path = tmp_path / "a.csv"
    path.write_text(
        "\n".join(["# fs = 200 Hz", "Voltage (V);Position (um)", *lines, ";", ";"]) + "\n"
    )
    found = read(path)
    np.testing.assert_allclose(found.t_s, np.delete(T, [100, 101, 102]), atol=1e-9)
    np.testing.assert_allclose(found.drive, np.delete(U, [100, 101, 102]), atol=1e-6)
    assert "3 rows of empty fields counted in the times, the first after line 102" in found.read


def test_an_empty_row_of_labview_is_counted(tmp_path: Path) -> None:
    head = ["LabVIEW Measurement\t", "Separator\tTab", "X_Columns\tNo", "***End_of_Header***\t", ""]
    head += ["Channels\t2\t", "X_Dimension\tTime\tTime", "X0\t0\t0", "Delta_X\t0.005\t0.005"]
    head += ["***End_of_Header***\t", "X_Value\tVoltage (V)\tPosition (um)\tComment"]
    rows = [f"\t{u}\t{y}" for u, y in zip(U, Y, strict=True)]
    rows[50] = "\t\t"
    path = tmp_path / "a.lvm"
    path.write_text("\r\n".join([*head, *rows]) + "\r\n")
    np.testing.assert_allclose(read(path).t_s, np.delete(T, 50), atol=1e-9)


@pytest.mark.parametrize(("blank", "said"), [(1, "1 blank line is between"), (N - 1, "")])
def test_blank_lines_are_no_samples(tmp_path: Path, blank: int, said: str) -> None:
    lines = [f"{u};{y}" for u, y in zip(U, Y, strict=True)]
    body = "".join(line + ("\n\n" if i < blank else "\n") for i, line in enumerate(lines))
    path = tmp_path / "a.csv"
    path.write_text("Voltage (V);Position (um)\n" + body)
    found = read(path, rate_hz=200.0)
    is_it(found)
    assert said in found.read
    assert ("blank" in found.read) == bool(said)


@pytest.mark.parametrize("units", ["V,A", "V,,A", "V,um"])
def test_a_unit_for_each_channel_above_the_names_is_not_passed_over(
    tmp_path: Path, units: str
) -> None:
    lines = [f"{t},{u},{y}" for t, u, y in zip(T, U, Y, strict=True)]
    path = tmp_path / "a.csv"
    path.write_text("\n".join([f"Vertical Units,{units}", "TIME (s),CH1,CH2", *lines]) + "\n")
    said = asked(path, columns={"u": "CH2", "y": "CH1"}, unit="um")
    assert "the unit of 'CH2' is not given, and may be another than volts (Vertical Units V" in said


@pytest.mark.parametrize("stress", ["Zugspannung", "Druckspannung", "Biegespannung"])
def test_a_mechanical_stress_is_no_drive(tmp_path: Path, stress: str) -> None:
    lines = [f"{t};{y};{u}" for t, u, y in zip(T, U, Y, strict=True)]
    path = tmp_path / "a.csv"
    path.write_text("\n".join([f"Zeit (s);Weg (um);{stress}", *lines]) + "\n")
    assert "no heading names the drive" in asked(path)
    path.write_text("\n".join(["Zeit (s);Weg (um);Piezospannung (V)", *lines]) + "\n")
    is_it(read(path))


def test_quick_times_whose_period_the_file_states_are_in_seconds(tmp_path: Path) -> None:
    lines = [f"{4e-8 * k - 2e-4:.8e},{u},{y}" for k, (u, y) in enumerate(zip(U, Y, strict=True))]
    path = tmp_path / "a.csv"
    head = ["Sample Interval,4e-08", "TIME,Voltage (V),Position (um)"]
    path.write_text("\n".join([*head, *lines]) + "\n")
    np.testing.assert_allclose(np.diff(read(path).t_s), 4e-8, rtol=1e-5)
    path.write_text("\n".join([*head[1:], *lines]) + "\n")
    assert "add --time-unit s, ms or us" in asked(path)


@pytest.mark.parametrize(
    "scale", ["Scale (V/DIV) = ;5;2", "Vertical scale;5 V/div", "Gain: 2 V per div"]
)
def test_the_scale_of_a_screen_is_no_factor(tmp_path: Path, scale: str) -> None:
    lines = [f"{t};{u};{y}" for t, u, y in zip(T, U, Y, strict=True)]
    path = tmp_path / "a.csv"
    path.write_text("\n".join([scale, HEAD, *lines]) + "\n")
    is_it(read(path))


def test_one_column_of_numbers_is_called_so(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("".join(f"{y}\n" for y in Y))
    assert "one column of numbers" in asked(path)
