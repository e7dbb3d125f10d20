"""Habits of loggers and programs by kind: packed files, clocks that start again, lines that were
cut, numbers that stand for none, fields with units, channels that do not belong together."""

import bz2
import gzip
import json
import lzma
import time
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.rigs.foreign_files import asked, read

from dehyst.daemon.files.foreign.roles import daq_side
from dehyst.daemon.files.recordings import read_recordings, recording_of
from dehyst.models.errors import BadRecording
from dehyst.models.recording import Recording

N = 300
T = np.round(0.005 * np.arange(N), 3)
U = np.round(50 + 40 * np.sin(2 * np.pi * 1.5 * T), 4)
Y = np.round(3 + 0.06 * U + 0.3 * np.cos(2 * np.pi * 1.5 * T), 5)
HEAD = ["Time (s)", "Voltage (V)", "Displacement (um)"]


def is_it(found: Recording, y: np.ndarray = Y, rows: int = N) -> None:
    assert found.displacement is not None
    assert (found.drive_unit, found.displacement_unit) == ("v", "um")
    np.testing.assert_allclose(found.t_s - found.t_s[0], T[:rows], atol=1e-6)
    np.testing.assert_allclose(found.drive, U[:rows], rtol=1e-9)
    np.testing.assert_allclose(found.displacement, y[:rows], rtol=1e-9)


def lines(*columns: Any, head: list[str] = HEAD, mark: str = ",") -> list[str]:
    body = zip(*(map(str, np.asarray(column).tolist()) for column in columns), strict=True)
    return [mark.join(head), *(mark.join(row) for row in body)]


def write(path: Path, rows: list[str], end: str = "\n") -> Path:
    path.write_text("\n".join(rows) + end)
    return path


TEXT = ("\n".join(lines(T, U, Y)) + "\n").encode()


def zipped(data: bytes, *names: str) -> Callable[[Path], None]:
    def make(path: Path) -> None:
        with zipfile.ZipFile(path, "w") as archive:
            for name in names:
                archive.writestr(name, data)

    return make


PACKED: dict[str, Callable[[Path], Any]] = {
    "a.txt.gz": lambda path: path.write_bytes(gzip.compress(TEXT)),
    "a.csv.bz2": lambda path: path.write_bytes(bz2.compress(TEXT)),
    "a.dat.xz": lambda path: path.write_bytes(lzma.compress(TEXT)),
    "a.gz": lambda path: path.write_bytes(gzip.compress(TEXT)),
    "a.zip": zipped(TEXT, "folder/run 1.csv"),
    "mac.zip": zipped(TEXT, "run.csv", "__MACOSX/._run.csv"),
}


@pytest.mark.parametrize("name", PACKED)
def test_a_packed_file_is_read_as_what_it_holds(tmp_path: Path, name: str) -> None:
    PACKED[name](tmp_path / name)
    found = read(tmp_path / name)
    is_it(found)
    assert found.name == name
    assert found.read.startswith(f"{name}: read {N} rows")


def test_what_is_wrong_in_a_packed_file_is_said_of_its_own_name(tmp_path: Path) -> None:
    path = tmp_path / "a.csv.xz"
    path.write_bytes(lzma.compress(TEXT.replace(b"50.0,", b"x,", 1)))
    assert asked(path).startswith("a.csv.xz: line 2: Voltage (V) is 'x'")
    path.write_bytes(lzma.compress(TEXT)[:-20])
    assert "a.csv.xz: cannot be unpacked" in asked(path)
    zipped(TEXT, "a.csv", "b.csv")(tmp_path / "two.zip")
    assert "holds 2 files (a.csv, b.csv): unpack it" in asked(tmp_path / "two.zip")
    (tmp_path / "a.tar.gz").write_bytes(gzip.compress(bytes(600)))
    assert "unpack it, and name the recordings in it" in asked(tmp_path / "a.tar.gz")
    path = tmp_path / "bomb.txt.bz2"
    path.write_bytes(bz2.compress(bytes(64 << 20)))
    assert "unpacks to more than 60 times its size" in asked(path)


def test_the_remedy_for_a_file_of_unknown_kind_is_that_of_its_content(tmp_path: Path) -> None:
    (tmp_path / "a.xls").write_bytes(TEXT)
    assert "it begins like text: rename it to .txt" in asked(tmp_path / "a.xls")
    (tmp_path / "a.csv").write_bytes(gzip.compress(TEXT))
    assert "begins like a .gz file: rename it to a.csv.gz" in asked(tmp_path / "a.csv")
    zipped(TEXT, "mimetype", "content.xml")(tmp_path / "a.ods")
    assert "save it as .csv or .xlsx" in asked(tmp_path / "a.ods")
    zipped(TEXT, "xl/workbook.xml")(tmp_path / "a.xls")
    assert "it begins like a .xlsx file: rename it to .xlsx" in asked(tmp_path / "a.xls")


JSON = {
    "columns": dict(zip(HEAD, (T.tolist(), U.tolist(), Y.tolist()), strict=True)),
    "rows": [dict(zip(HEAD, row, strict=True)) for row in zip(T.tolist(), U.tolist(), Y.tolist(),
                                                              strict=True)],
    "by number": {name: {str(i): value for i, value in enumerate(values.tolist())}
                  for name, values in zip(HEAD, (T, U, Y), strict=True)},
    "nested": {"meta": {"fs": 200}, "data": {"drive": {"unit": "V", "values": U.tolist()},
                                             "sensor": {"unit": "um", "values": Y.tolist()}}},
}  # fmt: skip


@pytest.mark.processes
@pytest.mark.parametrize("form", JSON)
def test_json(tmp_path: Path, form: str) -> None:
    (tmp_path / "a.json").write_text(json.dumps(JSON[form]))
    is_it(read(tmp_path / "a.json"))


@pytest.mark.processes
def test_json_lines_and_netcdf(tmp_path: Path) -> None:
    write(tmp_path / "a.jsonl", [json.dumps(row) for row in JSON["rows"]])
    is_it(read(tmp_path / "a.jsonl"))
    from scipy.io import netcdf_file

    with netcdf_file(tmp_path / "a.nc", "w") as file:
        file.createDimension("n", N)
        for name, values, unit in (("t", 1e3 * T, "ms"), ("drive", U, "V"), ("sensor", Y, "um")):
            file.createVariable(name, "f8", ("n",))[:] = values
            file.variables[name].units = unit
    is_it(read(tmp_path / "a.nc"))


def counter(first: int, turn: int) -> list[int]:
    return [(first + 5 * k) % turn for k in range(N)]


def clock(first: float, form: str) -> list[str]:
    out = []
    for t in T:
        s = (first + t) % (3600.0 if form == "minutes" else 86400.0)
        hour = f"{int(s // 3600):02d}:" if form == "day" else ""
        out.append(f"{hour}{int(s % 3600 // 60):02d}:{s % 60:06.3f}")
    return out


AGAIN = {
    "a counter of 32 bits": (lines(counter(2**32 - 703, 2**32), U, Y), "t (ms)"),
    "a counter of 16 bits": (lines(counter(2**16 - 703, 2**16), U, Y), "t (ms)"),
    "a counter of 24 bits": (lines(counter(2**24 - 703, 2**24), U, Y), "t (ms)"),
    "a counter of 31 bits": (lines(counter(2**31 - 703, 2**31), U, Y), "t (ms)"),
    "midnight": (lines(clock(86399.5, "day"), U, Y), "time"),
    "minutes": (lines(clock(3599.5, "minutes"), U, Y), "time"),
}


@pytest.mark.parametrize("kind", AGAIN)
def test_a_clock_that_starts_again_is_continued(tmp_path: Path, kind: str) -> None:
    rows, name = AGAIN[kind]
    rows[0] = rows[0].replace("Time (s)", name)
    found = read(write(tmp_path / "a.csv", rows))
    is_it(found)
    assert "starts again at line" in found.read


def test_a_counter_from_0_is_continued_where_its_even_step_shows_it(tmp_path: Path) -> None:
    count = 250 * np.arange(N)
    head = ["t (ms)", *HEAD[1:]]
    found = read(write(tmp_path / "a.csv", lines(count % 2**16, U, Y, head=head)))
    np.testing.assert_allclose(found.t_s, count / 1000)
    late = np.where(count < 2**16, count, count % 2**16 + 100)  # another step across
    path = write(tmp_path / "b.csv", lines(late, U, Y, head=head))
    assert [part.size for part in read_recordings(path)] == [263, 37]


def test_recordings_that_each_begin_at_0_are_cut_and_others_too(tmp_path: Path) -> None:
    """65536 rows from 0 may be a recording of that length; a fall by another number is a start."""
    again = np.tile(np.arange(65536), 2)
    drive = np.tile(np.round(50 + 40 * np.sin(0.01 * np.arange(65536)), 3), 2)
    path = write(tmp_path / "a.csv", lines(again, drive, drive, head=["t (ms)", *HEAD[1:]]))
    assert [part.size for part in read_recordings(path)] == [65536, 65536]
    other = [*counter(2**16 - 703, 2**16)[:200], *range(0, 500, 5)]
    path = write(tmp_path / "b.csv", lines(other, U, Y, head=["t (ms)", *HEAD[1:]]))
    assert len(read_recordings(path)) == 3


def test_a_last_line_that_was_cut_is_left_out(tmp_path: Path) -> None:
    rows = lines(T, U, Y)
    cut = [*rows[:-1], rows[-1].rpartition(",")[0]]
    found = read(write(tmp_path / "a.csv", cut, end=""))
    is_it(found, rows=N - 1)
    assert f"line {N + 1}, the last, is cut short and left out" in found.read
    assert f"line {N + 1} has 2 fields" in asked(write(tmp_path / "a.csv", cut))
    is_it(read(write(tmp_path / "a.csv", rows, end="")))
    cut[0] = "t_s,u_v,y_um"
    own = asked(write(tmp_path / "own.csv", cut, end=""))
    assert "dehyst convert --unfinished own.csv whole.csv keeps the lines before" in own


EVERY = np.arange(N) % 40 == 7
LOST = np.where(EVERY, np.nan, Y)


@pytest.mark.parametrize("number", [-9999, 99999.0, -999.9, 1e30, 3.4028235e38, -32768, 2147483647])
def test_numbers_that_stand_for_no_value(tmp_path: Path, number: float) -> None:
    path = write(tmp_path / "a.csv", lines(T, U, np.where(EVERY, number, Y)))
    found = read(path)
    is_it(found, LOST)
    said = f"{number:g} in {np.count_nonzero(EVERY)} rows of Displacement (um) taken for no value"
    assert said in found.read


def test_a_recording_in_the_own_form_keeps_every_number(tmp_path: Path) -> None:
    values = np.where(EVERY, -9999.0, Y)
    found = read(write(tmp_path / "a.csv", lines(T, U, values, head=["t_s", "u_v", "y_um"])))
    is_it(found, values)
    assert f"-9999 in {np.count_nonzero(EVERY)} rows of y_um may stand for no value" in found.read


def test_numbers_in_arrays_that_stand_for_no_value() -> None:
    values = np.where(EVERY, 9.969209968386869e36, Y)
    is_it(recording_of(dict(zip(HEAD, (T, U, values), strict=True)), "here"), LOST)
    with pytest.raises(BadRecording, match="beyond any measurement"):
        recording_of(dict(zip(HEAD, (T, U, 1e30 * Y), strict=True)), "here")


def test_a_gauge_at_its_end_is_measured(tmp_path: Path) -> None:
    """The end of an integer's range, and a number of nines, which others come near."""
    counts = np.clip(np.round(5000 * (Y - 2.0)), -32768, 32767)
    assert np.count_nonzero(counts == 32767) == 0
    clipped = np.minimum(counts + 17000, 32767)
    head = [*HEAD[:2], "Displacement (counts)"]
    found = read(write(tmp_path / "a.csv", lines(T, U, clipped, head=head)))
    np.testing.assert_array_equal(found.displacement, clipped)
    nines = np.where(EVERY, 999, 700 + Y)
    is_wild = read(write(tmp_path / "b.csv", lines(T, U, np.where(EVERY, 999, 90 * Y))))
    np.testing.assert_array_equal(is_wild.displacement, np.where(EVERY, 999, 90 * Y))
    lost = read(write(tmp_path / "c.csv", lines(T, U, nines)))
    assert np.count_nonzero(np.isnan(lost.displacement)) == np.count_nonzero(EVERY)


def test_a_time_beyond_any_measurement_is_missing(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", lines(np.where(np.arange(N) == 9, 1e30, T), U, Y))
    assert "line 11: the time is missing" in asked(path)


@pytest.mark.parametrize("mark", ["|", " | "])
def test_columns_between_bars(tmp_path: Path, mark: str) -> None:
    is_it(read(write(tmp_path / "a.txt", lines(T, U, Y, mark=mark))))
    rows = [f"| {row} |" for row in lines(T, U, Y, mark=mark)]
    is_it(read(write(tmp_path / "b.txt", [rows[0], "|---|---|---|", *rows[1:]])))


def affixed(t: float, u: float, y: float) -> dict[str, str]:
    return {
        "units": f"{t:.3f} s,{u:.4f} V,{y:.5f} um",
        "units without blanks": f"{1e3 * t:.0f}ms;{u:.4f}V;{y:.5f}µm",
        "names": f"time:{t:.3f}\tu_v:{u:.4f}\ty_um:{y:.5f}",
        "names and units": f"t={t:.3f} s, drive={1e3 * u:.1f} mV, sensor={y:.5f} um",
        "lists": f"[{t:.3f}, {u:.4f}, {y:.5f}],",
        "numbers of numpy": f"np.float64({t:.3f}),np.float64({u:.4f}),np.float64({y:.5f})",
    }


@pytest.mark.parametrize("kind", affixed(0.0, 0.0, 0.0))
def test_fields_that_repeat_their_names_or_units(tmp_path: Path, kind: str) -> None:
    rows = [affixed(*row)[kind] for row in zip(T, U, Y, strict=True)]
    head = {"units without blanks": ["Time;Voltage;Displacement"], "units": ["Time,Voltage,Disp"]}
    head |= {"lists": [", ".join(HEAD)], "numbers of numpy": [",".join(HEAD)]}
    found = read(write(tmp_path / "a.txt", [*head.get(kind, []), *rows]))
    np.testing.assert_allclose(found.t_s, T, atol=1e-6)
    np.testing.assert_allclose(found.drive, U, atol=1e-4)
    np.testing.assert_allclose(found.displacement, Y, atol=1e-5)
    assert (found.drive_unit, found.displacement_unit) == ("v", "um")


def test_a_column_that_repeats_the_unit(tmp_path: Path) -> None:
    head = "time,drive,unit,sensor,unit"
    rows = [f"{t:.3f},{1e3 * u:.4f},mV,{y:.5f},um" for t, u, y in zip(T, U, Y, strict=True)]
    found = read(write(tmp_path / "a.csv", [head, *rows]))
    is_it(found)
    assert "left out" not in found.read
    rows[250] = rows[250].replace("mV", "V")
    said = asked(write(tmp_path / "a.csv", [head, *rows]))
    assert "write all values of this column in one unit" in said


def test_units_that_differ_from_row_to_row_are_refused(tmp_path: Path) -> None:
    rows = [f"{t:.3f} s,{u:.4f} V,{y * (1e3 if y < 5 else 1):.5f} {'nm' if y < 5 else 'um'}"
            for t, u, y in zip(T, U, Y, strict=True)]  # fmt: skip
    said = asked(write(tmp_path / "a.txt", rows))
    assert "without numbers and left out: column 2 ('6.30000 um')" in said


@pytest.mark.processes
def test_channels_of_several_rates_do_not_belong_together(tmp_path: Path) -> None:
    nptdms = pytest.importorskip("nptdms")
    with nptdms.TdmsWriter(tmp_path / "a.tdms") as file:
        drive = nptdms.ChannelObject("G", "Drive", U, {"unit_string": "V", "wf_increment": 0.005})
        gauge = {"unit_string": "um", "wf_increment": 0.02}
        file.write_segment([drive, nptdms.ChannelObject("G", "Gauge", Y[::4], gauge)])
    said = asked(tmp_path / "a.tdms")
    assert "'Drive' of 300 rows and 'Gauge' of 75 rows do not belong together" in said
    assert "'Drive' of 300 rows and 'Gauge'" in asked(tmp_path / "a.tdms", "u=Drive,y=Gauge")


def test_one_channel_is_not_two(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", Y)
    for path in (write(tmp_path / "a.csv", lines(T, Y, head=["Time", "Ampl"])), tmp_path / "a.npy"):
        said = asked(path)
        assert "no heading names the displacement" in said
        assert "no column is left for it" in said
        assert "write drive and displacement to one file" in said


def test_times_of_their_own_are_not_one_another(tmp_path: Path) -> None:
    head = ["Time 1 (s)", "Voltage (V)", "Time 2 (s)", "Displacement (um)"]
    for other, apart in ((T + 0.0025, True), (2.0 * T, True), (T + 1.7e9, False)):
        said = asked(write(tmp_path / "a.csv", lines(T, U, other, Y, head=head)))
        assert ("if each has its own, bring them to one column of times first" in said) == apart
        assert 'add --columns t="Time 1 (s)"' in said


def test_what_stands_still_or_counts_is_not_advised_as_the_drive(tmp_path: Path) -> None:
    head = ["chunk", "Rdg No.", "timestamp", "aux", "demod"]
    ticks = 123456789 + 300000 * np.arange(N)
    path = write(tmp_path / "a.csv", lines(0 * ticks, np.arange(1, N + 1), ticks, U, Y, head=head))
    said = asked(path)
    assert "add --columns u=aux" in said
    assert "--rate HZ if it counts the rows or the ticks of a clock" in said
    is_it(read(path, "u=aux,y=demod", rate_hz=200.0, unit="um"))


@pytest.mark.processes
def test_a_table_that_begins_beside_and_a_text_in_one_column(tmp_path: Path) -> None:
    """Units below the headings count wherever the table begins; a text that was opened with another
    separator has each line in one cell."""
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    for row in (["t", "drive", "sensor"], ["ms", "mV", "um"]):
        book.active.append([None, None, *row])
    for t, u, y in zip(T, U, Y, strict=True):
        book.active.append([None, None, 1e3 * float(t), 1e3 * float(u), float(y)])
    book.save(tmp_path / "a.xlsx")
    is_it(read(tmp_path / "a.xlsx"))
    book = openpyxl.Workbook()
    for line in lines(T, U, Y, mark=";"):
        book.active.append([line])
    book.save(tmp_path / "b.xlsx")
    is_it(read(tmp_path / "b.xlsx"))


def test_wide_brackets_and_units_since_a_date(tmp_path: Path) -> None:
    is_it(
        read(
            write(tmp_path / "a.csv", lines(T, U, Y, head=["时间（s）", "电压（V）", "位移［μm］"]))
        )
    )
    head = ["time (nanoseconds since 2024-03-05)", *HEAD[1:]]
    is_it(read(write(tmp_path / "b.csv", lines(np.round(1e9 * T).astype(int), U, Y, head=head))))


UNITS = {
    "MATLAB": ["Time_s_", "Voltage_mV_", "Displacement_um_"],
    "R": ["Time..s.", "Voltage..mV.", "Displacement..um."],
    "LaTeX": ["$t$ [s]", "$U$ [mV]", "Displacement [$\\mu$m]"],
    "LaTeX, text": ["t [s]", "U [mV]", "Displacement [\\mu m]"],
    "Origin": ["t (s)", "U (mV)", "Displacement (\\g(m)m)"],
    "UTF-8 as Latin-1": ["t (s)", "U (mV)", "Displacement (Âµm)"],
}


@pytest.mark.parametrize("kind", UNITS)
def test_units_as_programs_rewrite_them(tmp_path: Path, kind: str) -> None:
    is_it(read(write(tmp_path / "a.csv", lines(T, 1e3 * U, Y, head=UNITS[kind]))))


def test_channels_in_lines_are_to_be_transposed(tmp_path: Path) -> None:
    rows = [",".join(map(str, values)) for values in (T, U, Y)]
    assert "transpose the file" in asked(write(tmp_path / "a.csv", rows))
    rows = [" ".join(map(str, np.tile(values, 100))) for values in (T, U, Y)]
    assert "transpose the file" in asked(write(tmp_path / "a.txt", rows))


HEADS = {
    "announced": (["# columns: time,drive,sensor", "# units: s,mV,um"], ","),
    "announced, blanks": (["# columns: time drive sensor", "# units: s mV um", "# x", "#"], " "),
    "a line of kinds": (["t_s,u_mv,y_um", "double,double,double"], ","),
    "commas over tabs": (["Time (s), Drive (mV), Sensor (um)"], "\t"),
    "semicolons over commas": (["Time (s);Drive (mV);Sensor (um)"], ","),
    "tabs over blanks": (["Time (s)\tDrive (mV)\tSensor (um)"], "  "),
    "quoted line breaks": (['"Time\n(s)","Drive\n(mV)","Sensor,\nat the tip\n(um)"'], ","),
    "a label in each field": (
        ["time,drive,sensor", ",Type: double,Type: double", ",Unit: mV,Unit: um", ",Interp: zoh,"],
        ",",
    ),
}


@pytest.mark.parametrize("kind", HEADS)
def test_names_in_another_form_than_the_numbers(tmp_path: Path, kind: str) -> None:
    head, mark = HEADS[kind]
    body = lines(T, 1e3 * U, Y, mark=mark)[1:]
    body[7] = body[7].replace(mark, f"{mark} ", 1)
    is_it(read(write(tmp_path / "a.txt", [*head, *body])))


def test_a_title_over_another_separator_names_no_columns(tmp_path: Path) -> None:
    body = lines(T, U, Y, mark="\t")[1:]
    path = write(tmp_path / "a.txt", ["Stage 3, drawer 5, in the morning", *body])
    assert "3 columns of numbers without headings" in asked(path)


def test_a_quote_that_nothing_closes_joins_no_lines(tmp_path: Path) -> None:
    head = ['"made by hand', "t_s u_v y_um"]
    is_it(read(write(tmp_path / "a.txt", [*head, *lines(T, U, Y, mark=" ")[1:]])))


def test_remarks_behind_numbers_and_durations(tmp_path: Path) -> None:
    body = lines(T, U, Y, head=["t_s", "u_v", "y_um"], mark=" ")
    body[9] += " # touched the table"
    is_it(read(write(tmp_path / "a.txt", body)))
    durations = [f"{t:.3f} sec" for t in T]
    is_it(read(write(tmp_path / "b.csv", lines(durations, U, Y, head=["Time", *HEAD[1:]]))))


def test_a_drive_beyond_amplifiers_is_not_taken_as_volts(tmp_path: Path) -> None:
    """Millivolts or counts under a heading that does not say so."""
    for unit, name in (("mv", "voltage"), ("counts", "dac")):
        path = write(tmp_path / "a.csv", lines(T, np.round(1e3 * U), Y, head=["t", name, HEAD[2]]))
        assert "gives no unit, and reaches 89995: add --drive-unit v, mv, kv or counts" in asked(
            path
        )
        assert read(path, drive_unit=unit).drive_unit == ("v" if unit == "mv" else "counts")


def test_letters_of_mechanics_are_no_volts_and_no_seconds(tmp_path: Path) -> None:
    """In "t, x, v" the v may be a velocity, and in "t, U, s" the s falls, as no time does."""
    path = write(tmp_path / "a.csv", lines(T, Y, np.gradient(Y), U, head=["t", "x", "v", "F"]))
    assert "no heading names the drive" in asked(path)
    is_it(read(path, "u=F,y=x", unit="um"))
    path = write(tmp_path / "b.csv", lines(T, U, Y, head=["t", "U", "s"]))
    assert "add --columns y=s" in asked(path)
    is_it(read(path, "y=s", unit="um"))


def test_a_set_point_may_be_the_drive(tmp_path: Path) -> None:
    head = [HEAD[0], "Setpoint (um)", "Measured position (um)"]
    path = write(tmp_path / "a.csv", lines(T, U, Y, head=head))
    assert 'add --columns u="Setpoint (um)"' in asked(path)
    assert read(path, 'u="Setpoint (um)"').drive_unit == "um"


def test_arrays_of_three_dimensions_are_named_as_such(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.stack([np.column_stack([T, U, Y])] * 4))
    assert "of more than two dimensions and left out" in asked(tmp_path / "a.npy")


@pytest.mark.parametrize("end", ["", "\n"])
def test_short_files_are_refused_in_one_short_line(tmp_path: Path, end: str) -> None:
    """One row, cut or not; a first row without its last field; headings of a thousand letters."""
    for text in (
        "# ,a\n0,1e30",
        "a,b\n1,2,\n3",
        "t_s,u_v,y_um\n0,1",
        f"t,{'u' * 999},b\n1,x,3\n2,x,4",
    ):
        path = tmp_path / "a.txt"
        path.write_text(text + end)
        assert len(asked(path)) < 1000


def test_a_heading_of_60000_letters_takes_no_seconds() -> None:
    begin = time.process_time()
    assert daq_side("AI0 " + "a" * 60000, "") == "in"
    assert time.process_time() - begin < 1.0


@pytest.mark.processes
def test_numbers_too_large_for_any_float_are_left_out(tmp_path: Path) -> None:
    columns = JSON["columns"] | {"serial": [10**400] * N}
    (tmp_path / "a.json").write_text(json.dumps(columns))
    found = read(tmp_path / "a.json")
    is_it(found)
    assert "without numbers and left out: serial" in found.read
