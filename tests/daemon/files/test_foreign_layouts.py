"""Layouts of text by kind: names with blanks, lines of units, columns that are sparse or begin
late, headings that do not fit, clocks and long times. What is read equals what was written; what
cannot be known is asked for."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from tests.rigs.foreign_files import asked, read

from dehyst.daemon.files.recordings import read_recordings, recording_of
from dehyst.models.errors import BadRecording
from dehyst.models.recording import Recording

N = 400
COUNT = np.arange(N)
T = np.round(0.005 * COUNT, 3)
U = np.round(50 + 40 * np.sin(2 * np.pi * 1.5 * T), 4)
Y = np.round(3 + 0.06 * U + 0.3 * np.cos(2 * np.pi * 1.5 * T), 5)
C = np.round(25 + 0.1 * T, 4)
NAMES = "Time (s),Voltage (V),Displacement (um)"


def rows(*columns: Sequence[float] | np.ndarray, separator: str = ",", decimal: str = ".") -> list:
    cells = [[f"{x:.5f}".replace(".", decimal) for x in column] for column in columns]
    return [separator.join(row) for row in zip(*cells, strict=True)]


def write(path: Path, *lines: str) -> Path:
    path.write_text("\n".join(lines) + "\n")
    return path


def is_it(found: Recording, y: np.ndarray = Y, unit: str = "um") -> None:
    assert found.displacement is not None
    assert (found.drive_unit, found.displacement_unit) == ("v", unit)
    np.testing.assert_allclose(found.t_s - found.t_s[0], T, atol=1e-6)
    np.testing.assert_allclose(found.drive, U, rtol=1e-9)
    np.testing.assert_allclose(found.displacement, y, rtol=1e-9)


BLANK_NAMES = {
    "Time (s) u_v y_um temp_c": 1.0,
    "# Time (s) Voltage Displacement (um) Temp": 1.0,
    "t [ms] u_v y_um temp_c": 1e3,
    "% Time Drive_V Sensor (um) Temp": 1.0,
    "t / s U / V y / um temp / C": 1.0,
    "# t (s), drive voltage (V), y_um, temp": 1.0,
    "Time (ms)  Drive voltage (V)  Sensor [um]  PT 100": 1e3,
    '"Time (s)" "u_v" "y_um" "PT 100"': 1.0,
}


@pytest.mark.parametrize("names", BLANK_NAMES)
def test_names_with_blanks_between_blanks(tmp_path: Path, names: str) -> None:
    body = rows(BLANK_NAMES[names] * T, U, Y, C, separator=" ")
    is_it(read(write(tmp_path / "a.dat", names, *body)))


@pytest.mark.parametrize(
    "names", ["Time Drive voltage Displacement", "Time (s) Voltage", "time, applied drive, y_um, x"]
)
def test_names_that_do_not_fit_are_asked_for_by_number(tmp_path: Path, names: str) -> None:
    path = write(tmp_path / "a.dat", names, *rows(T, U, Y, separator=" "))
    assert "without headings" in asked(path)
    is_it(read(path, columns={"t": 0, "u": 1, "y": 2}, unit="um"))


UNITS = {
    "below": ["time,drive,sensor", "ms,mV,nm"],
    "above": ["ms,mV,nm", "time,drive,sensor"],
    "in brackets above": ["[ms],[mV],[nm]", "t,u,y"],
    "then comments": ["Time,Voltage,Position", "ms,mV,nm", "raw,raw,filtered"],
    "then kinds": ["A title", "time,drive,sensor", "ms,mV,nm", "double,double,double"],
    "then a word": ["time,drive,sensor", "ms,mV,nm", "Begin data"],
    "with labels": ["Long Name,Time,Voltage,Position", "Units,ms,mV,nm", "Comments,,,"],
}


@pytest.mark.parametrize("kind", UNITS)
def test_a_line_of_units_near_the_names(tmp_path: Path, kind: str) -> None:
    path = write(tmp_path / "a.csv", *UNITS[kind], *rows(1e3 * T, 1e3 * U, 1e3 * Y))
    is_it(read(path), 1e3 * Y, "nm")


def test_units_in_the_preamble_are_not_those_of_the_columns(tmp_path: Path) -> None:
    body = rows(T, U, Y)
    is_it(read(write(tmp_path / "a.csv", "Vertical Units,mV,mV", NAMES, *body)))
    is_it(read(write(tmp_path / "b.csv", "a,b,c", NAMES, *body)))
    path = write(tmp_path / "c.csv", "Vertical Units,mV,mV", "Time,Drive,Sensor", *body)
    with pytest.raises(BadRecording, match=r"Vertical Units mV mV.*--drive-unit v, mv or kv"):
        read(path, unit="um")
    is_it(read(path, unit="um", drive_unit="v"))


def some(count: int, every: int) -> np.ndarray:
    """Return a displacement of which only each n-th value is there, from `count` on."""
    return np.where((count <= COUNT) & (COUNT % every == 0), Y, np.nan)


SPARSE = {
    "1 of 5": some(0, 5),
    "1 of 20": some(0, 20),
    "first missing": some(1, 1),
    "late": some(390, 1),
    "one": some(N - 1, N - 1),
}


@pytest.mark.parametrize("missing", ["", "NaN", "--"])
@pytest.mark.parametrize("last", [True, False])
@pytest.mark.parametrize("kind", SPARSE)
@pytest.mark.parametrize("looked", [2000, 100])
def test_a_column_that_holds_few_numbers(
    tmp_path: Path,
    kind: str,
    last: bool,
    missing: str,
    looked: int,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """looked: the layout is found in as many lines; then the column may begin later."""
    monkeypatch.setattr("dehyst.daemon.files.foreign.text.LOOKED_AT", looked)
    body = [row.replace("nan", missing) for row in rows(T, U, SPARSE[kind])]
    lines = [NAMES, *body]
    if not last:
        lines = [",".join(line.split(",")[k] for k in (0, 2, 1)) for line in lines]
    is_it(read(write(tmp_path / "a.csv", *lines)), SPARSE[kind])


def test_rows_that_end_before_a_column_are_not_left_out(tmp_path: Path) -> None:
    """The lines hold the displacement, and the comma before it, only from some row on."""
    body = rows(T, U, Y)
    short = [row.rpartition(",")[0] for row in body]
    for cut in (3, 200, 390):
        path = write(tmp_path / "a.csv", NAMES, *short[:cut], *body[cut:])
        assert "one field too" in asked(path)


def test_a_column_of_remarks_that_begins_late(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dehyst.daemon.files.foreign.text.LOOKED_AT", 100)
    body = [row + "\t" for row in rows(T, U, Y, separator="\t")]
    names = NAMES.replace(",", "\t") + "\tComment"
    is_it(read(write(tmp_path / "a.txt", names, *body)))
    body[300] += "touched the table"
    is_it(read(write(tmp_path / "a.txt", names, *body)))
    wrong = [*body[:200], *(row.rpartition("\t")[0] + "\t5" for row in body[200:])]
    wrong[350] = wrong[350].rpartition("\t")[0] + "\tERR"
    assert "line 352: Comment is 'ERR'" in asked(write(tmp_path / "a.txt", names, *wrong))


def clock(t: float, decimal: str = ".") -> str:
    return f"12:00:{t:09.6f}".replace(".", decimal)


CLOCKS = {
    "comma": [f"12:00:{t:06.3f}".replace(".", ",") for t in T],
    "long comma": [clock(t, ",") for t in T],
    "log": [f"2024-03-05 12:00:{t:06.3f}".replace(".", ",") for t in T],
    "US": [f"3/5/2024 1:00:{t:09.6f} PM" for t in T],
    "noon": [f"12/31/2024 12:00:{t:06.3f} am" for t in T],
    "duration": [f"0 days 00:00:{t:09.6f}" for t in T],
    "days": [f"{'0 days 23:59:59' if t < 1 else '1 days 00:00:00'}.{t % 1 * 1e3:03.0f}" for t in T],
    "half days": [
        f"{'11:59:59' if t < 1 else '12:00:00'}.{t % 1 * 1e3:03.0f} {'A' if t < 1 else 'P'}M"
        for t in T
    ],
}  # fmt: skip


@pytest.mark.parametrize("kind", CLOCKS)
def test_clocks(tmp_path: Path, kind: str) -> None:
    body = [f"{a};{b}" for a, b in zip(CLOCKS[kind], rows(U, Y, separator=";"), strict=True)]
    is_it(read(write(tmp_path / "a.csv", "Time;Voltage (V);Displacement (um)", *body)))


def test_noon_is_no_new_beginning_of_the_clock(tmp_path: Path) -> None:
    body = [f"{a};{b}" for a, b in zip(CLOCKS["half days"], rows(U, Y, separator=";"), strict=True)]
    found = read(write(tmp_path / "a.csv", "Time;Voltage (V);Displacement (um)", *body))
    assert "starts again" not in found.read
    assert found.t_s[0] == pytest.approx(43199.0)  # 11:59:59 AM


@pytest.mark.parametrize("kind", ["comma", "seconds"])
def test_commas_in_times_do_not_decide_about_points(tmp_path: Path, kind: str) -> None:
    """50.123 next to 12:00:01,250 or to 0,005: a decimal point, or thousands."""
    times = CLOCKS["comma"] if kind == "comma" else [f"{t:.3f}".replace(".", ",") for t in T]
    body = [f"{t};{u:.3f};{y:.3f}" for t, u, y in zip(times, U, Y, strict=True)]
    said = asked(write(tmp_path / "a.csv", "Time (s);Voltage (V);Displacement (um)", *body))
    assert "may have a decimal point, or thousands set apart" in said


CUT = [
    "Sample Rate,1,000 Hz", "Sample Rate (Hz),10,000", "Sampling interval (us),5,000",
    "Delta_X,0.005,0.010", "Sample rate,200,100",
]  # fmt: skip


@pytest.mark.parametrize("stated", CUT)
def test_a_rate_that_the_separator_cuts_is_asked_for(tmp_path: Path, stated: str) -> None:
    path = write(tmp_path / "a.csv", stated, "Voltage (V),Displacement (um)", *rows(U, Y))
    assert "add --rate HZ" in asked(path)
    is_it(read(path, rate_hz=200.0))


@pytest.mark.parametrize(
    "stated",
    [
        "Abtastrate;200;Hz",
        "Abtastfrequenz [kHz];0,2",
        "Abtastintervall;5;ms",
        "Delta_X;0,005;0,005",
    ],
)
def test_a_rate_in_german_or_for_each_channel(tmp_path: Path, stated: str) -> None:
    body = rows(U, Y, separator=";", decimal=",")
    is_it(read(write(tmp_path / "a.csv", stated, "Spannung [V];Weg [um]", *body)))


SHORT = {
    "R, blanks": (" ", '"t_s" "u_v" "y_um"', '"{}"', 1),
    "R, commas": (",", '"t_s","u_v","y_um"', '"{}"', 1),
    "no quotes": (" ", "t_s u_v y_um", "{}", 1),
    "hash": (",", "#,Time (s),Voltage (V),Displacement (um)", "{}", 1),
    "hash, from 0": ("\t", "#\tTime (s)\tVoltage (V)\tDisplacement (um)", "{}", 0),
    "empty": (",", ",t_s,u_v,y_um", "{}", 0),
}


@pytest.mark.parametrize("kind", SHORT)
def test_rows_that_are_counted_without_a_heading(tmp_path: Path, kind: str) -> None:
    separator, names, number, begin = SHORT[kind]
    body = rows(T, U, Y, separator=separator)
    counted = [number.format(i) + separator + row for i, row in enumerate(body, begin)]
    is_it(read(write(tmp_path / "a.txt", names, *counted)))


def test_a_missing_heading_over_no_count_is_asked_for(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", "u_v,y_um,temp_c", *rows(T, U, Y, C))
    assert "without headings" in asked(path)
    is_it(read(path, columns={"t": 0, "u": 1, "y": 2}, unit="um"))


@pytest.mark.parametrize("words", ["Run5", "Samples,400", "Begin data"])
def test_words_directly_above_the_numbers_are_notes(tmp_path: Path, words: str) -> None:
    path = write(tmp_path / "a.csv", words, *rows(T, U, Y))
    is_it(read(path, columns={"t": 0, "u": 1, "y": 2}, unit="um"))
    is_it(read(write(tmp_path / "b.csv", NAMES, words, *rows(T, U, Y))))
    two = write(tmp_path / "c.csv", words, *rows(U, Y))
    assert "without headings" in asked(two)
    is_it(read(two, columns={"u": 0, "y": 1}, unit="um", rate_hz=200.0))


def test_the_header_of_a_controller_of_pi(tmp_path: Path) -> None:
    names = ["NAME0 = Control Voltage of Output 1", "NAME1 = Current Position of Axis 1"]
    head = ["DIM = 2", "SAMPLE_TIME = 0.005000", *names, "END_HEADER"]
    path = write(tmp_path / "a.dat", *(f"# {line}" for line in head), *rows(U, Y, separator=" "))
    assert asked(path).count(": add ") == asked(path).count("add --unit um") == 1
    is_it(read(path, unit="um"))


def lvm(x_columns: str, segments: int, decimal: str = ",", again: bool = False) -> list[str]:
    out = ["LabVIEW Measurement\t", "Separator\tTab", f"Decimal_Separator\t{decimal}"]
    out += [f"X_Columns\t{x_columns}", "***End_of_Header***\t", "\t"]
    size = N // segments
    for s in range(segments):
        part = slice(s * size, (s + 1) * size)
        begin = "0" if again else f"{T[s * size]:.3f}".replace(".", decimal)
        step = "0.005".replace(".", decimal)
        out += ["Channels\t2\t\t", f"Samples\t{size}\t{size}\t", "X_Dimension\tTime\tTime\t"]
        out += ["Y_Unit_Label\tVolts\tMicrometers\t", f"X0\t{begin}\t{begin}\t"]
        out += [f"Delta_X\t{step}\t{step}\t", "***End_of_Header***\t\t\t"]
        out += ["X_Value\tDrive\tSensor\tComment"]
        columns = (U[part], Y[part]) if x_columns == "No" else (T[part], U[part], Y[part])
        body = rows(*columns, separator="\t", decimal=decimal)
        out += ["\t" * (x_columns == "No") + row + "\t" for row in body] + [""]
    return out


@pytest.mark.parametrize("decimal", ".,")
@pytest.mark.parametrize("segments", [1, 4])
@pytest.mark.parametrize("x_columns", ["One", "No"])
def test_segments_of_labview(tmp_path: Path, x_columns: str, segments: int, decimal: str) -> None:
    lines = lvm(x_columns, segments, decimal)
    is_it(read(write(tmp_path / "a.lvm", *lines)))
    lines[-3] = lines[-3].rstrip("\t").rpartition("\t")[0] + "\tERR\t"
    assert f"line {len(lines) - 2}: Sensor is 'ERR'" in asked(write(tmp_path / "b.lvm", *lines))


def test_segments_of_labview_that_each_begin_at_0_are_recordings(tmp_path: Path) -> None:
    path = write(tmp_path / "a.lvm", *lvm("No", 4, again=True))
    parts = read_recordings(path, need_displacement=True)
    assert [part.size for part in parts] == [N // 4] * 4
    np.testing.assert_allclose(np.concatenate([part.drive for part in parts]), U)
    assert all(part.t_s[0] == 0.0 for part in parts)


def test_labview_with_a_step_for_each_channel_is_refused(tmp_path: Path) -> None:
    lines = [line.replace("Delta_X\t0,005\t0,005", "Delta_X\t0,005\t0,01") for line in lvm("No", 1)]
    assert "a row every 0.005 s" in asked(write(tmp_path / "a.lvm", *lines))


def test_segments_of_labview_with_other_channels_are_refused(tmp_path: Path) -> None:
    lines = lvm("One", 2)
    at = len(lines) - 1 - lines[::-1].index("X_Value\tDrive\tSensor\tComment")
    lines[at] = "X_Value\tSensor\tDrive\tComment"
    assert f"line {at + 1}: this segment holds other channels" in asked(
        write(tmp_path / "a.lvm", *lines)
    )


def test_an_empty_column_in_front(tmp_path: Path) -> None:
    head = ['"SampleRate",200,200', '"TraceName","Drive","Sensor"', '"VUnit","V","um"']
    body = ["," + row for row in rows(U, Y)]
    assert "add --rate HZ" in asked(write(tmp_path / "a.csv", *head, '"HUnit","s","s"', *body))
    is_it(read(tmp_path / "a.csv", rate_hz=200.0))


@pytest.mark.parametrize(
    ("resolution", "unit"), [("5.0e-03,5.0e-03", "s,s"), ("5,5", "ms,ms"), ("5000,5000", "us,us")]
)
def test_yokogawas_resolution_of_time_has_the_unit_of_its_line(
    tmp_path: Path, resolution: str, unit: str
) -> None:
    head = ['"TraceName","Drive","Sensor"', '"VUnit","V","um"', f"HResolution,{resolution}"]
    body = ["," + row for row in rows(U, Y)]
    is_it(read(write(tmp_path / "a.csv", *head, f"HUnit,{unit}", *body)))
    assert "add --rate HZ" in asked(write(tmp_path / "b.csv", *head, *body))


@pytest.mark.parametrize(
    ("resolution", "unit"), [("5.0e-03,1.0e-03", "s,s"), ("5.0e-03,5.0e-03", "s,ms")]
)
def test_different_resolutions_of_time_give_no_times(
    tmp_path: Path, resolution: str, unit: str
) -> None:
    head = ['"TraceName","Drive","Sensor"', '"VUnit","V","um"', f"HResolution,{resolution}"]
    body = ["," + row for row in rows(U, Y)]
    path = write(tmp_path / "a.csv", *head, f"HUnit,{unit}", *body)
    assert "add --rate HZ" in asked(path)


def test_a_log_of_a_terminal_is_text(tmp_path: Path) -> None:
    """PuTTY and many terminal programs call what they record .log."""
    is_it(read(write(tmp_path / "a.log", NAMES, *rows(T, U, Y))))


@pytest.mark.parametrize("text", ["5th of May, 1 o'clock", "13/13/2024 13:00:00"])
def test_times_that_cannot_be_read_are_named(tmp_path: Path, text: str) -> None:
    body = [f'"{text}",{row}' for row in rows(U, Y)]
    path = write(tmp_path / "a.csv", NAMES, *body)
    said = asked(path)
    assert "add --rate HZ" in said
    assert "'Time (s)'" in said
    is_it(read(path, rate_hz=200.0))


@pytest.mark.parametrize("name", ["time_ns", "time (us)", "%time", "stamp (ns)"])
def test_times_of_16_to_19_digits(tmp_path: Path, name: str) -> None:
    factor = 10**6 if "us" in name else 10**9
    first = 1_700_000_000 * factor
    body = [f"{first + round(t * factor)},{row}" for t, row in zip(T, rows(U, Y), strict=True)]
    path = write(tmp_path / "a.csv", f"{name},Voltage (V),Displacement (um)", *body)
    found = read(path)
    is_it(found)
    np.testing.assert_allclose(found.t_s, T, atol=1e-12)
    assert str(first) in found.read
    body[200] = f"{first - 5},9.0,9.0"
    write(path, path.read_text().split("\n")[0], body[0], *body[200:1:-1])
    assert "not a number" in asked(path)


def test_times_of_19_digits_in_arrays() -> None:
    t = 1_700_000_000_000_000_000 + np.round(1e9 * T).astype(np.int64)
    is_it(recording_of({"time": t, "Voltage (V)": U, "Displacement (um)": Y}, "a"))
