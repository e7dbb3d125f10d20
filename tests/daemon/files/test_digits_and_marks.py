"""What a file states beside its numbers replaces the digits that they lack and answers for their
units; numbers whose marks can be read in two ways are refused, and counts are called so."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from tests.rigs.foreign_files import asked, read

from dehyst.models.recording import Recording

N = 400
STEP = 0.0005
T = STEP * np.arange(N)
U = np.round(75 + 70 * np.sin(2 * np.pi * 15 * T), 3)
Y = np.round(3 + 0.1 * U + 0.9 * np.cos(2 * np.pi * 15 * T), 4)
COUNT = np.arange(N)
ROWS = [f"{T[i]:.4f},{U[i]},{Y[i]}" for i in range(N)]


def write(path: Path, *lines: str) -> Path:
    path.write_text("\n".join(lines) + "\n")
    return path


def is_it(found: Recording, at: np.ndarray = T) -> None:
    assert found.displacement is not None
    assert (found.drive_unit, found.displacement_unit) == ("v", "um")
    np.testing.assert_allclose(found.t_s - found.t_s[0], at - at[0], atol=1e-9)
    np.testing.assert_allclose(found.drive, U)
    np.testing.assert_allclose(found.displacement, Y)


def lvm(
    path: Path,
    digits: int,
    columns: str = "One",
    step: float = STEP,
    names: tuple[str, str] = ("Voltage", "Position"),
    segments: int = 1,
) -> Path:
    lines = [
        "LabVIEW Measurement",
        "Separator\tTab",
        f"X_Columns\t{columns}",
        "***End_of_Header***",
    ]
    own = "\tX_Value\t" if columns == "Multi" else "\t"
    for rows in np.split(COUNT, segments):
        at = [f"{STEP * i:.{digits}f}" for i in rows]
        lines += [
            f"Channels\t2\nSamples\t{len(rows)}\t{len(rows)}\nY_Unit_Label\tV\tum",
            f"X_Dimension\tTime\tTime\nX0\t{at[0]}\t{at[0]}\nDelta_X\t{step}\t{step}",
            f"***End_of_Header***\nX_Value\t{names[0]}{own}{names[1]}\tComment",
        ]
        again = [f"\t{t}\t" if columns == "Multi" else "\t" for t in at]
        lines += [f"{t}\t{U[i]}{b}{Y[i]}" for i, t, b in zip(rows, at, again, strict=True)]
    return write(path, *lines)


@pytest.mark.parametrize("digits", [2, 3])
@pytest.mark.parametrize("columns", ["One", "Multi"])
def test_rounded_times_of_labview_follow_the_stated_step(
    tmp_path: Path, columns: str, digits: int
) -> None:
    found = read(lvm(tmp_path / "a.lvm", digits, columns))
    is_it(found)
    said = f"the times are rounded to {10.0**-digits:g} s: counted from the period that the file"
    assert f"{said} states, 0.0005 s a row" in found.read
    found = read(lvm(tmp_path / "b.lvm", 6, columns))
    is_it(found)
    assert "rounded" not in found.read  # they have all digits


def test_rounded_times_of_several_segments_follow_the_stated_step(tmp_path: Path) -> None:
    is_it(read(lvm(tmp_path / "a.lvm", 3, segments=4)))


def test_a_stated_step_against_the_times_of_labview_is_said(tmp_path: Path) -> None:
    for digits in (3, 6):
        found = read(lvm(tmp_path / "a.lvm", digits, step=2 * STEP))
        np.testing.assert_allclose(np.diff(found.t_s), STEP, rtol=1e-3)
        assert "the file states 1000 Hz" in found.read


ROUNDED: dict[str, tuple[str, Callable[[int], str]]] = {
    "rounded": ("0.0005", lambda i: f"{T[i]:.3f}"),
    "truncated": ("0.0005", lambda i: f"{i // 2 / 1000:.3f}"),
    "a time before zero": ("0.0005", lambda i: f"{T[i] - 0.1:.3f}"),
    "significant digits": ("0.0005", lambda i: f"{T[i]:.2g}"),
}


@pytest.mark.parametrize("kind", ROUNDED)
def test_rounded_times_of_any_file_follow_the_period_it_states(tmp_path: Path, kind: str) -> None:
    step, at = ROUNDED[kind]
    rows = [f"{at(i)},{U[i]},{Y[i]}" for i in range(N)]
    head = [f"Sample interval,{step},s", "Time (s),Voltage (V),Position (um)"]
    found = read(write(tmp_path / "a.csv", *head, *rows))
    is_it(found)
    assert "counted from the period" in found.read


def test_a_pause_between_rounded_times_is_kept(tmp_path: Path) -> None:
    at = T + 0.25 * (COUNT > 200)
    rows = [f"{at[i]:.3f},{U[i]},{Y[i]}" for i in range(N)]
    head = ["Sample interval,0.0005,s", "Time (s),Voltage (V),Position (um)"]
    is_it(read(write(tmp_path / "a.csv", *head, *rows)), at)


@pytest.mark.parametrize("step", ["0.0004", "0.000498"])
def test_rounded_times_of_another_pace_are_not_those_of_the_stated_period(
    tmp_path: Path, step: str
) -> None:
    rows = [f"{T[i]:.3f},{U[i]},{Y[i]}" for i in range(N)]
    head = [f"Sample interval,{step},s", "Time (s),Voltage (V),Position (um)"]
    found = read(write(tmp_path / "a.csv", *head, *rows))
    np.testing.assert_allclose(np.diff(found.t_s), STEP, rtol=1e-3)
    assert "counted from the period" not in found.read


def test_times_that_jitter_are_not_taken_for_rounded_ones(tmp_path: Path) -> None:
    at = T + 1e-4 * np.sin(COUNT**2)
    rows = [f"{at[i]:.6f},{U[i]},{Y[i]}" for i in range(N)]
    head = ["Sample interval,0.0005,s", "Time (s),Voltage (V),Position (um)"]
    found = read(write(tmp_path / "a.csv", *head, *rows))
    np.testing.assert_allclose(found.t_s - found.t_s[0], at - at[0], atol=2e-6)


@pytest.mark.parametrize(
    "names",
    [
        ("Spannung (Gleichspannung)", "Weg (Kapazitiv)"),
        ("Voltage (DC)", "Position (RMS)"),
        ("Voltage - Dev1_ai0 (Formula Result)", "Position (ADC 1)"),
    ],
)
def test_words_in_brackets_are_no_unit_beside_that_of_labview(
    tmp_path: Path, names: tuple[str, str]
) -> None:
    is_it(read(lvm(tmp_path / "a.lvm", 6, names=names)))


def test_a_unit_in_brackets_against_that_of_labview_is_asked_for(tmp_path: Path) -> None:
    path = lvm(tmp_path / "a.lvm", 6, names=("Voltage (mV)", "Position (um)"))
    assert "states two units, mv and v: add --drive-unit mv or --drive-unit v" in asked(path)
    path = lvm(tmp_path / "a.lvm", 6, names=("Voltage (A)", "Position (um)"))
    assert "two units, a and v: add --drive-unit v, whichever" in asked(path)
    is_it(read(path, drive_unit="v"))


def comma(value: float, digits: int) -> str:
    return f"{value:.{digits}f}".replace(".", ",")


TWO_COMMAS: dict[str, tuple[str, Callable[[int], str], str]] = {
    "fields without a heading": (
        "Time (ms),Voltage (V),Position (um)",
        lambda i: f"{i},{comma(U[i], 3)},{comma(Y[i], 4)}", "3 headings over 5 fields",
    ),
    "a count before them": (
        "Time (ms),Voltage (V),Position (um)",
        lambda i: f"{i},{int(U[i])},{comma(Y[i], 4)}", "3 headings over 4 fields",
    ),
    "a comma at the end": (
        "Time (ms),Voltage (V),Position (um),",
        lambda i: f"{i},{int(U[i])},5,{int(Y[i])},", "3 headings over 4 fields",
    ),
    "as many headings as fields": (
        "Time (ms),Voltage (V),Position (um),Comment",
        lambda i: f"{i},{comma(U[i], 3)},{int(Y[i])}", "fields such as '000'",
    ),
    "numbers for words": (
        "Time (ms),Voltage (V),Position (um),Comment",
        lambda i: f"{i},{int(U[i])},5,{int(Y[i])}", "numbers below 'Comment'",
    ),
    "lines of two lengths": (
        "Time (ms),Voltage (V),Position (um),Force",
        lambda i: f"{i},{int(U[i])}{',5' * (i % 3 > 0)},{int(Y[i])}",
        "lines of 3 and of 4 fields",
    ),
    "no headings": ("", lambda i: f"{comma(U[i], 2)},{int(Y[i])}", "fields such as '00'"),
}  # fmt: skip


@pytest.mark.parametrize("kind", TWO_COMMAS)
def test_commas_that_may_be_decimal_marks_and_separators_are_refused(
    tmp_path: Path, kind: str
) -> None:
    names, row, why = TWO_COMMAS[kind]
    path = write(tmp_path / "a.csv", *([names] if names else []), *map(row, range(N)))
    for said in (asked(path), asked(path, "u=1,y=2", rate_hz=2000.0)):
        assert f"{why}: the commas in '" in said
        assert "may be decimal marks and separators at once: write it with decimal points" in said


def test_commas_between_whole_numbers_without_headings_are_named_in_the_question(
    tmp_path: Path,
) -> None:
    path = write(tmp_path / "a.csv", *(f"{i + 23},{int(U[i]) + 40},{i % 7 + 12}" for i in COUNT))
    said = "the commas in '23,115,12' are taken for separators (if some are decimal marks, write"
    assert said in asked(path)
    found = read(path, "u=1,y=2", rate_hz=2000.0, unit="counts")
    assert said in found.read  # never taken in silence


def test_whole_numbers_below_headings_of_their_own_are_read(tmp_path: Path) -> None:
    rows = [f"{i},{int(U[i])},{int(Y[i])}" for i in COUNT]
    found = read(write(tmp_path / "a.csv", "Time (ms),Voltage (V),Position (um)", *rows))
    np.testing.assert_array_equal(found.drive, U.astype(int))
    assert "commas" not in found.read


@pytest.mark.parametrize("mark", [".", ","])
def test_a_number_with_several_marks_is_refused_with_what_they_may_be(
    tmp_path: Path, mark: str
) -> None:
    what = (
        f"its {'points' if mark == '.' else 'commas'} may separate numbers, thousands or the parts"
    )
    head, text = "Time (ms);Voltage (V);Position (um)", f"23{mark}42{mark}12"
    rows = [f"{i};{U[i] if i != 20 else text};{Y[i]}" for i in COUNT]
    assert f"line 22: Voltage (V) is '{text}', not a number; {what}" in asked(
        write(tmp_path / "a.csv", head, *rows)
    )
    rows = [f"{i};{int(U[i])}{mark}42{mark}12;{Y[i]}" for i in COUNT]
    assert f"42{mark}12'; {what}" in asked(write(tmp_path / "a.csv", head, *rows))
    if mark == ".":
        rows = [f"{i}.{int(U[i])}.{int(Y[i])}" for i in COUNT]
        assert what in asked(write(tmp_path / "a.csv", "t.u.y", *rows))


COUNTERS = {
    "rows": COUNT,
    "from one": COUNT + 1,
    "in tens": 10 * COUNT,
    "with gaps": COUNT + (COUNT > 100),
    "of a byte": COUNT % 256,
    "backwards": N - COUNT,
}


@pytest.mark.parametrize("kind", COUNTERS)
@pytest.mark.parametrize("role", ["drive", "displacement"])
def test_a_count_is_advised_neither_as_drive_nor_as_displacement(
    tmp_path: Path, kind: str, role: str
) -> None:
    name, values = ("Voltage (V)", U) if role == "displacement" else ("Position (um)", Y)
    rows = [f"{T[i]},{values[i]},{COUNTERS[kind][i]}" for i in COUNT]
    said = asked(write(tmp_path / "a.csv", f"Time (s),{name},X", *rows))
    assert "X' only counts the samples; name it with --columns if it measures something" in said
    assert "=X" not in said
    warm = [f"{row},{23 + i % 5}" for i, row in enumerate(rows)]
    said = asked(write(tmp_path / "b.csv", f"Time (s),{name},X,Temperature (C)", *warm))
    assert "X' only counts the samples" in said
    assert "=X" not in said
    said = asked(write(tmp_path / "a.csv", *rows))
    assert "column 2 only counts the samples" in said
    assert "=2" not in said
    assert "--columns t=0,u=1" in said


def test_a_count_is_not_advised_among_several(tmp_path: Path) -> None:
    rows = [f"{T[i]},{U[i]},{i},{Y[i]}" for i in COUNT]
    said = asked(write(tmp_path / "a.csv", "Time (s),Voltage (V),X1,Y1", *rows))
    assert "--columns y=Y1" in said
    assert "'X1' only counts the samples" in said
    rows = [f"{U[i]},{i},{Y[i]}" for i in COUNT]
    said = asked(write(tmp_path / "b.csv", "A,B,C", *rows), rate_hz=2000.0)
    assert "u=A" in said
    assert "y=C" in said
    assert "'B' only counts the samples" in said


def test_without_headings_a_constant_is_advised_before_a_count(tmp_path: Path) -> None:
    said = asked(write(tmp_path / "a.csv", *(f"{T[i]},{i},{U[i]},3.5" for i in COUNT)))
    assert "--columns t=0,u=2,y=3" in said


def gw_instek(
    path: Path, mode: str, end: Sequence[str] = ("Waveform Data,,Waveform Data,",), **other: str
) -> Path:
    """Write two channels as an oscilloscope of GW Instek does, each with its labels."""
    labels = {
        "Memory Length": f"{N}", "Trigger Level": "1.000e+00", "Source": "CH1 CH2",
        "Probe": "1.000E+00", "Vertical Units": "V", "Vertical Scale": "2.000E+01",
        "Horizontal Units": "s", "Horizontal Scale": "5.000E-02", "Horizontal Mode": "Main",
        "Sampling Period": "5.000e-04", "Firmware": "V1.06", "Mode": mode, **other,
    }  # fmt: skip
    head = [",".join(f"{k},{v.split()[j % len(v.split())]}" for j in (0, 1)) + ","
            for k, v in labels.items()]  # fmt: skip
    detail = mode == "Detail"
    rows = [
        ",".join(f"{T[i] - 0.1:.6e},{v[i]}" if detail else f"{v[i]}," for v in (U, Y)) + ","
        for i in COUNT
    ]
    return write(path, *head, *end, *rows)


@pytest.mark.parametrize("end", [("Waveform Data,,Waveform Data,",), ()])
@pytest.mark.parametrize("mode", ["Detail", "Fast"])
def test_the_sources_of_a_gw_instek_name_its_columns(
    tmp_path: Path, mode: str, end: Sequence[str]
) -> None:
    path = gw_instek(tmp_path / "a.csv", mode, end)
    said = asked(path)
    assert "which is the drive, which the displacement?" in said
    assert '--columns u="CH1 [V]",y="CH2 [V]"' in said
    found = read(path, "u=CH1,y=CH2")
    assert found.displacement is not None
    np.testing.assert_allclose(found.t_s - found.t_s[0], T, atol=1e-9)
    np.testing.assert_allclose(found.drive, U)
    np.testing.assert_allclose(found.displacement, Y)
    assert ("t from the file's own period (0.0005 s a row)" in found.read) == (mode == "Fast")


def test_a_gw_instek_whose_columns_are_not_those_of_its_mode_is_asked_about(
    tmp_path: Path,
) -> None:
    path = gw_instek(tmp_path / "a.csv", "Fast", Mode="Detail")
    assert "--columns" in asked(path)
    assert "CH1" not in asked(path)
    other = {"Sampling Period": "5.000e-04 1.000e-03"}
    said = asked(gw_instek(tmp_path / "b.csv", "Fast", **other), "u=CH1,y=CH2")
    assert "no column of times: add --rate HZ" in said  # it states two periods


FAR = ["Model,X", "Date,2024", "Owner,me", "Place,laboratory"]
UNITS: dict[str, list[str]] = {
    "below the names": ["Time,CH1,CH2", "s,V,um"],
    "above the names": ["Units,s,V,um", "Time,CH1,CH2"],
    "far above": ["Units,s,V,um", *FAR, "Time,CH1,CH2"],
    "in a comment": ["# Units: s, V, um", *FAR, "Time,CH1,CH2"],
    "not for the times": ["Units,V,um", *FAR, "Time (s),CH1,CH2"],
    "not for the times, near": ["Units,V,um", "Time (s),CH1,CH2"],
    "by the names": ["CH1 Unit,V", "Unit CH2,um", *FAR, "Time (s),CH1,CH2"],
    "by the numbers of channels": ["Channel 1 unit: V", "Channel 2 unit: um", "Time (s),CH1,CH2"],
}


@pytest.mark.parametrize("kind", UNITS)
def test_units_that_a_preamble_states_for_the_columns_are_theirs(tmp_path: Path, kind: str) -> None:
    is_it(read(write(tmp_path / "a.csv", *UNITS[kind], *ROWS)))


def test_units_that_a_preamble_states_are_those_of_the_numbers(tmp_path: Path) -> None:
    head = ["Units,ms,kV,nm", *FAR, "Time,Drive,Position"]
    rows = [f"{1e3 * T[i]:.1f},{U[i] / 1e3:.6f},{Y[i]}" for i in COUNT]
    found = read(write(tmp_path / "a.csv", *head, *rows))
    np.testing.assert_allclose(found.t_s, T, atol=1e-12)
    np.testing.assert_allclose(found.drive, U)
    assert found.displacement_unit == "nm"


def test_units_of_a_preamble_against_those_of_the_columns_are_asked_for(tmp_path: Path) -> None:
    head = ["Units,s,mV,um", *FAR, "Time (s),Drive (V),Position (um)"]
    said = asked(write(tmp_path / "a.csv", *head, *ROWS))
    assert "'Drive (V)' (mV) states two units, v and mv: add --drive-unit" in said
    head = ["Units,s,mV,um", *FAR, "Time,Drive,Position", "s,V,um"]
    assert "'V and mV', which is not a known unit" in asked(write(tmp_path / "a.csv", *head, *ROWS))


@pytest.mark.parametrize("line", ["Unit: nm", "Unit,ms", "Pump unit,V"])
def test_the_unit_of_something_else_is_that_of_no_column(tmp_path: Path, line: str) -> None:
    path = write(tmp_path / "a.csv", line, *FAR[:1], "Time (s),Voltage (V),Position", *ROWS)
    assert "the unit of 'Position' is not given" in asked(path)


def test_the_unit_of_the_line_above_is_not_that_of_the_only_channel(tmp_path: Path) -> None:
    rows = [f"{T[i]},{Y[i]}" for i in COUNT]
    head = ["Averaging,2", "Unit,ms", "Time (s),Position"]
    assert "(ms)" not in asked(write(tmp_path / "a.csv", *head, *rows))


@pytest.mark.parametrize("empty", [False, True])
@pytest.mark.parametrize("head", ["t_s,u_v,y_um", "Time (s),Voltage (V),Position (um)"])
def test_digits_with_underscores_are_no_number(tmp_path: Path, head: str, empty: bool) -> None:
    rows = [f"{T[i]},{U[i] if i != 30 else '1_000'},{Y[i]}" for i in COUNT]
    rows[31] = f"{T[31]},,{Y[31]}" if empty else rows[31]
    said = asked(write(tmp_path / "a.csv", head, *rows))
    assert "line 32: " in said
    assert "is '1_000', not a number" in said


@pytest.mark.parametrize("text", ["0x1F", "1D4C", "0x1D4C"])
def test_hexadecimal_numbers_are_refused_as_such(tmp_path: Path, text: str) -> None:
    rows = [f"{T[i]},{U[i] if i != 30 else text},{Y[i]}" for i in COUNT]
    said = asked(write(tmp_path / "a.csv", "Time (s),Voltage (V),Position (um)", *rows))
    assert f"line 32: Voltage (V) is '{text}', not a number; it may be hexadecimal" in said


@pytest.mark.parametrize("mark", [",", " "])
def test_the_units_of_an_ecsv_are_those_of_its_columns(tmp_path: Path, mark: str) -> None:
    """As astropy writes them, in a comment above the names."""
    head = [
        "# %ECSV 1.0", "# ---", f"# delimiter: '{mark}'", "# datatype:",
        "# - {name: time, unit: ms, datatype: float64}",
        "# - {name: drive, datatype: float64, unit: kV, description: at the stage}",
        "# - {name: position, unit: um, datatype: float64}", "# schema: astropy-2.0",
        mark.join(["time", "drive", "position"]),
    ]  # fmt: skip
    rows = [mark.join([f"{1e3 * T[i]:.1f}", f"{U[i] / 1e3:.6f}", f"{Y[i]}"]) for i in COUNT]
    is_it(read(write(tmp_path / "a.ecsv", *head, *rows)))
