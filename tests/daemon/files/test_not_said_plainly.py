"""What a file does not say plainly is asked for, and what it says in an odd place is used: a line
cut inside a number, lost samples, decimation, units and gains in words."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.rigs.foreign_files import asked, read

from dehyst.daemon.files.foreign.reading import ReadOptions
from dehyst.daemon.files.recordings import read_columns
from dehyst.models.errors import BadRecording
from dehyst.models.recording import Recording

N = 300
T = np.round(0.005 * np.arange(N), 3)
U = np.round(50 + 40 * np.sin(2 * np.pi * 1.5 * T), 4)
Y = np.round(3 + 0.06 * U + 0.3 * np.cos(2 * np.pi * 1.5 * T), 5)
HEAD = ("Time (s)", "Voltage (V)", "Displacement (um)")


def is_it(found: Recording, y: np.ndarray = Y, t: np.ndarray = T) -> None:
    assert found.displacement is not None
    assert (found.drive_unit, found.displacement_unit) == ("v", "um")
    np.testing.assert_allclose(found.t_s - found.t_s[0], t, atol=1e-9)
    np.testing.assert_allclose(found.drive, U[: t.size], rtol=1e-9)
    np.testing.assert_allclose(found.displacement, y[: t.size], rtol=1e-9)


def lines(*columns: Any, head: Sequence[str] = HEAD, mark: str = ",") -> list[str]:
    body = zip(*(map(str, np.asarray(column).tolist()) for column in columns), strict=True)
    return [mark.join(head), *(mark.join(row) for row in body)]


def write(path: Path, rows: Sequence[str], end: str = "\n") -> Path:
    path.write_text("\n".join(rows) + end, encoding="utf-8")
    return path


OWN = ("t_s", "u_v", "y_um")


@pytest.mark.parametrize("head", [HEAD, OWN])
@pytest.mark.parametrize("end", ["\n\x1a", "\r\n\x1a", "\x1a"])
def test_the_end_of_a_file_of_dos_is_no_line(tmp_path: Path, head: Sequence[str], end: str) -> None:
    found = read(write(tmp_path / "a.csv", lines(T, U, Y, head=head), end))
    is_it(found)
    assert "cut" not in found.read


@pytest.mark.parametrize("zeros", [1, 300, 200_000])
def test_zero_bytes_behind_the_rows_are_left_out_by_the_option_that_is_named(
    tmp_path: Path, zeros: int
) -> None:
    path = write(tmp_path / "a.csv", lines(T, U, Y, head=OWN), "\n" + zeros * "\0")
    said = asked(path)
    assert f"zero bytes from line {N + 2} to the end" in said
    assert "dehyst convert --unfinished a.csv whole.csv keeps the lines before" in said
    columns, _ = read_columns(path, unfinished=True)
    np.testing.assert_array_equal(columns["y_um"], Y)


def test_decimal_points_are_no_commas_twice(tmp_path: Path) -> None:
    head = ["Mode,Detail,", "Waveform Data,"]
    rows = [f"{t:.6E},{u:.6E},{t:.6E},{y:.6E}," for t, u, y in zip(T, U, Y, strict=True)]
    said = asked(write(tmp_path / "a.csv", [*head, *rows]))
    assert said.endswith("say which is which: --columns t=0,u=1,y=3")
    is_it(read(tmp_path / "a.csv", "t=0,u=1,y=3", unit="um"))


@pytest.mark.parametrize("lost", [3, 5, 7])
def test_a_last_line_that_was_cut_inside_its_last_number_is_left_out(
    tmp_path: Path, lost: int
) -> None:
    y = Y + np.where(np.arange(N) == N - 1, 10.0, 0.0)
    rows = [f"{t:g},{u:.4f},{v:.5f}" for t, u, v in zip(T, U, y, strict=True)]
    cut = [",".join(HEAD), *rows[:-1], rows[-1][:-lost]]
    found = read(write(tmp_path / "a.csv", cut, end=""))
    is_it(found, t=T[:-1])
    assert f"line {N + 1}, the last, is cut short and left out" in found.read
    assert read(write(tmp_path / "a.csv", cut)).t_s.size == N  # it ends as a line does
    is_it(read(write(tmp_path / "a.csv", [cut[0], *rows], end="")), y)
    cut[0] = "t_s,u_v,y_um"
    own = asked(write(tmp_path / "own.csv", cut, end=""))
    assert f"line {N + 1} ends inside a number" in own
    assert "dehyst convert --unfinished own.csv whole.csv" in own


@pytest.mark.parametrize(
    ("encoding", "head"),
    [
        ("cp1252", ("Zeit (s)", "Spannung (V)", "Größe (µm)")),
        ("cp1251", ("Время (с)", "Напряжение (В)", "Перемещение (мкм)")),
        ("cp932", ("時間(s)", "電圧(V)", "変位(μm)")),
        ("gbk", ("时间(秒)", "电压(伏)", "位移(微米)")),
    ],
)
def test_headings_in_the_encoding_of_a_region(
    tmp_path: Path, encoding: str, head: tuple[str, str, str]
) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes("\n".join(lines(T, U, Y, head=head)).encode(encoding))
    found = read(path)
    is_it(found)
    assert head[2] in found.read


KEPT = np.arange(N + 100) // 50 != 2
COUNT = np.arange(N + 100)[KEPT][:N]


@pytest.mark.parametrize("heading", ["Sample", "Count", "Packet number", "seq"])
@pytest.mark.parametrize("given", [{"rate_hz": 200.0}, {}])
def test_times_follow_a_counter_that_leaves_samples_out(
    tmp_path: Path, heading: str, given: dict[str, float]
) -> None:
    rows = lines(7 + COUNT, U, Y, head=[heading, *HEAD[1:]])
    found = read(write(tmp_path / "a.csv", [*([] if given else ["# fs = 200 Hz"]), *rows]), **given)
    is_it(found, t=0.005 * COUNT)
    assert f"'{heading}' leaves out 50 samples, and so do the times" in found.read
    np.savez(tmp_path / "a.npz", fs=200.0, n=COUNT, drive_v=U, position_um=Y)
    is_it(read(tmp_path / "a.npz", **given), t=0.005 * COUNT)


def test_a_time_in_whole_milliseconds_is_no_counter_of_samples(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", lines(COUNT, U, Y, head=["Time (ms)", *HEAD[1:]]))
    is_it(read(path, rate_hz=200.0))  # as the option says: rows a second


@pytest.mark.parametrize(
    "note",
    ["Decimation: 10", "Averages per point: 10", "oversampling_ratio = 10", "down-sampling,10"],
)
def test_a_rate_beside_a_decimation_is_asked_for(tmp_path: Path, note: str) -> None:
    rows = ["# Sample rate: 2000 Hz", f"# {note}", *lines(U, Y, head=HEAD[1:])]
    said = asked(write(tmp_path / "a.csv", rows))
    assert note.replace(",", " ") in said
    assert "add --rate 2000 or --rate 200" in said
    is_it(read(write(tmp_path / "a.csv", rows), rate_hz=200.0))
    rows[1] = rows[1].replace("10", "1")
    is_it(read(write(tmp_path / "a.csv", rows)), t=T / 10)
    rows[1] = f"# Averaging time: {10} ms"
    is_it(read(write(tmp_path / "a.csv", rows)), t=T / 10)


RATES = [
    "采样频率: 200Hz", "采样率：0.2 kHz", "サンプリング周波数,200,Hz", "サンプリング間隔: 5 ms",
    "Частота дискретизации: 200 Гц", "частота дискретизации = 0.2 кГц", "采样间隔: 5 毫秒",
]  # fmt: skip


@pytest.mark.parametrize("line", RATES)
def test_a_rate_is_stated_in_any_script(tmp_path: Path, line: str) -> None:
    is_it(read(write(tmp_path / "a.csv", [line, *lines(U, Y, head=HEAD[1:])])))


def test_seconds_in_turkish_are_no_serial_number(tmp_path: Path) -> None:
    is_it(read(write(tmp_path / "a.csv", lines(T, U, Y, head=["Zaman (sn)", *HEAD[1:]]))))
    path = write(tmp_path / "b.csv", lines(np.arange(N) + 10, U, Y, head=["sn", *HEAD[1:]]))
    assert "no column of times" in asked(path)


def test_a_decimation_next_to_arrays_is_asked_for(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", fs=2000, decimation=10, drive_v=U, position_um=Y)
    assert "add --rate 2000 or --rate 200" in asked(tmp_path / "a.npz")


@pytest.mark.parametrize(
    "heading",
    [
        "Voltage|kV", "Voltage=kV", "Voltage 'kV'", "Voltage (in kV)", "VoltageInKV", "driveKv",
        "Piezo_voltage_kVolt", "U, кВ", "Voltage (кВ)", "Напряжение, кВ", "Voltage（千伏）",
    ],
)  # fmt: skip
def test_a_unit_of_any_script_or_behind_any_mark_is_read(tmp_path: Path, heading: str) -> None:
    path = write(
        tmp_path / "a.txt", lines(T, U / 1e3, Y, head=["t, с", heading, HEAD[2]], mark="\t")
    )
    is_it(read(path))


@pytest.mark.parametrize(
    "heading", ["t, мс", "TimeMs", "timestampInMs", "Время (мс)", "Time|ms", "時刻[ミリ秒]"]
)
def test_milliseconds_of_any_script_or_behind_any_mark(tmp_path: Path, heading: str) -> None:
    is_it(
        read(write(tmp_path / "a.txt", lines(1e3 * T, U, Y, head=[heading, *HEAD[1:]], mark=";")))
    )


@pytest.mark.parametrize(
    ("heading", "stated"),
    [
        ("kV Voltage", "kV"), ("UkV", "UkV"), ("voltageMV", "MV"), ("Voltage_div_1000", "div_1000"),
        ("U/U0", "U/U0"), ("Voltage 10V", "10V"), ("U, arb", "arb"), ("U, êÂ", "êÂ"),
    ],
)  # fmt: skip
def test_what_may_be_a_unit_or_a_factor_is_not_volts(
    tmp_path: Path, heading: str, stated: str
) -> None:
    path = write(tmp_path / "a.txt", lines(T, U, Y, head=[HEAD[0], heading, HEAD[2]], mark="\t"))
    said = asked(path)
    assert f"'{heading}' states '{stated}'" in said
    assert "add --drive-unit" in said
    is_it(read(path, drive_unit="v"))


@pytest.mark.parametrize(
    "heading", ["Drive", "driveVoltage", "Voltage CH1", "U1", "Voltage, measured", "AO0", "run_2/U"]
)
def test_a_heading_that_holds_nothing_like_a_unit_is_in_volts(tmp_path: Path, heading: str) -> None:
    path = write(tmp_path / "a.txt", lines(T, U, Y, head=[HEAD[0], heading, HEAD[2]], mark="\t"))
    found = read(path, {"u": heading})
    is_it(found)
    assert "taken as volts" in found.read


@pytest.mark.parametrize(
    "line",
    [
        "Gain,10,2", "Scale factor,1,0.5", "# HV amplifier gain = 10 V/V", "# Sensitivity: 2 um/V",
        "# Drive is the amplifier input: multiply by 10", "# amplified: 15 V/V",
    ],
)  # fmt: skip
def test_a_factor_in_the_words_of_a_preamble_is_asked_for(tmp_path: Path, line: str) -> None:
    path = write(tmp_path / "a.csv", [line, *lines(T, U, Y)])
    said = asked(path)
    assert "which is not applied: add --drive-unit and --unit" in said
    assert line.strip("# ").replace(",", " ") in said
    is_it(read(path, drive_unit="v", unit="um"))


@pytest.mark.parametrize(
    "line",
    ["Gain,1,1.0", "Vertical Scale,20,2", "# scale: linear", "# fs 200, PID gain 10", "# gain"],
)
def test_words_of_a_factor_that_say_none_are_harmless(tmp_path: Path, line: str) -> None:
    is_it(read(write(tmp_path / "a.csv", [line, *lines(T, U, Y)])))


@pytest.mark.parametrize(
    ("other", "real"),
    [
        ("Expected position (um)", "Actual position (um)"), ("s nominal (um)", "s actual (um)"),
        ("Demand position (um)", "Position (um)"), ("Zielposition (um)", "Istposition (um)"),
        ("consigne (um)", "mesure (um)"), ("y_hat (um)", "y (um)"), ("Fit (um)", "Weg (um)"),
        ("Simulated displacement (um)", "Measured displacement (um)"),
    ],
)  # fmt: skip
def test_what_was_wanted_or_calculated_is_no_measurement(
    tmp_path: Path, other: str, real: str
) -> None:
    head = [*HEAD[:2], other, real]
    is_it(read(write(tmp_path / "a.csv", lines(T, U, 2 * Y, Y, head=head))))


def test_what_stands_still_is_not_advised_as_the_drive(tmp_path: Path) -> None:
    head = [HEAD[0], "Bias voltage (V)", "Signal voltage (V)", HEAD[2]]
    said = asked(write(tmp_path / "a.csv", lines(T, 0 * U + 50, U, Y, head=head)))
    assert 'add --columns u="Signal voltage (V)"' in said
    head = [*HEAD[:2], "Raw displacement (um)", "Displacement readback (um)"]
    said = asked(write(tmp_path / "a.csv", lines(T, U, 2 * Y, Y, head=head)))
    assert 'add --columns y="Displacement readback (um)"' in said


@pytest.mark.parametrize("names", [("Ch 1, V", "Ch 2, V"), ("$CH1 (V)", "$CH2 (V)"), ("a`b", "c!")])
def test_a_heading_that_a_shell_does_not_keep_is_advised_by_number(
    tmp_path: Path, names: tuple[str, str]
) -> None:
    path = write(tmp_path / "a.csv", lines(T, U, Y, head=[HEAD[0], *names], mark=";"))
    assert "u=1" in asked(path, unit="um", drive_unit="v")


def long(order: np.ndarray) -> list[str]:
    """Return rows of one value each, in this order of 2 N."""
    rows = [f"{12 * 3600 + t:.3f},drive,{u}" for t, u in zip(T, U, strict=True)]
    rows += [f"{12 * 3600 + t:.3f},sensor,{y}" for t, y in zip(T, Y, strict=True)]
    return ["time (s),channel,drive (V)", *(rows[i] for i in order)]


def test_channels_one_below_the_other_are_refused(tmp_path: Path) -> None:
    in_turn = write(tmp_path / "a.csv", long(np.arange(2 * N).reshape(2, -1).T.reshape(-1)))
    with pytest.raises(BadRecording, match=r"names the channel of each row in turn \('drive'"):
        read_columns(in_turn)
    below = write(tmp_path / "b.csv", long(np.arange(2 * N)))
    with pytest.raises(BadRecording, match="the same times come again: one channel is below"):
        read_columns(below)
    octave = ["# name: t", *map(str, T), "# name: u", *map(str, U)]
    with pytest.raises(BadRecording, match=f"line {N + 2} begins another variable"):
        read_columns(write(tmp_path / "c.txt", octave), reading=ReadOptions({"t": 0}))


def test_a_table_of_one_value_a_row_is_refused_by_its_first_rows(tmp_path: Path) -> None:
    """The rows of the drive alone fill more than is read to find the layout. InfluxDB's pivot makes
    columns of the channels."""
    many = np.arange(2500)
    rows = [f",{'position_um,0.1' if i > 2400 else f'drive_V,{i % 90}'},{i}" for i in many]
    names = ",_field,_value,_time"
    with pytest.raises(BadRecording, match=r"names the channel of each row \('drive_V'.* pivot\("):
        read_columns(write(tmp_path / "a.csv", [names, *rows]))
    marks = ["#group,true,false,false", "#datatype,string,double,long", "#default,,,"]
    with pytest.raises(BadRecording, match=r"annotated CSV.* pivot"):
        read_columns(write(tmp_path / "b.csv", [*marks, names, *rows]))
    own = [f"{T[i]},{U[i]},{Y[i]},drive,7" for i in range(N)]
    head = "Time (s),Voltage (V),Position (um),moved,value"
    is_it(read(write(tmp_path / "c.csv", [head, *own])))


def test_a_word_that_changes_with_the_rows_is_kept(tmp_path: Path) -> None:
    rows = lines(T, U, Y)
    words = ["phase", *(f"{'AB'[i % 2]}" for i in range(N))]
    path = write(tmp_path / "a.csv", [f"{r},{w}" for r, w in zip(rows, words, strict=True)])
    is_it(read(path))


def test_a_clock_of_whole_seconds_is_joined_with_its_milliseconds(tmp_path: Path) -> None:
    clock = [f"12:{int(t + 59) // 60:02d}:{int(t + 59) % 60:02d}" for t in T]
    ms = np.round(1e3 * (T % 1.0)).astype(int)
    rows = lines(clock, ms, U, Y, head=["Time", "Millisecond", *HEAD[1:]])
    found = read(write(tmp_path / "a.csv", rows))
    is_it(found)
    assert "t from 'Time + Millisecond'" in found.read
    elapsed = lines(clock[150:], 5 * np.arange(150), U[150:], Y[150:], head=rows[0].split(","))
    assert "the time does not increase" in asked(write(tmp_path / "b.csv", elapsed))


@pytest.mark.parametrize(
    ("rows", "shown"),
    [
        (['"0.0,50.1,3.2"'] * 9, '"0.0,50.1,3.2"'),
        (["0x0A,0x1F"] * 9, "0x0A,0x1F"),
        (["12:00:00 -> 50.1,3.2"] * 9, "12:00:00 -> 50.1,3.2"),
    ],
)
def test_lines_that_are_no_numbers_are_shown(tmp_path: Path, rows: list[str], shown: str) -> None:
    assert f"line 6 is '{shown}'" in asked(write(tmp_path / "a.txt", [",".join(HEAD), *rows]))


def test_a_field_that_is_no_number_is_shown(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", lines(T, [f"{1e3 * u:.4f}m" for u in U], Y))
    assert "left out: 'Voltage (V)' ('50000.0000m')" in asked(path)


def test_html_under_another_name_is_called_so(tmp_path: Path) -> None:
    path = write(tmp_path / "a.xls", ["<html><table><tr><td>0.0</td></tr></table></html>"])
    assert "it holds HTML or XML: save it as .csv or .xlsx" in asked(path)


@pytest.mark.parametrize(("factor", "offset"), [("1", "0"), ("10", "0"), ("1", "5")])
def test_names_in_pairs_as_twincat_writes_them(tmp_path: Path, factor: str, offset: str) -> None:
    of = {"Name": ("fDrive", "fGauge"), "Data-Type": ("REAL64", "REAL64"), "Unit": ("V", "um")}
    of |= {"SampleTime[ms]": ("5", "5"), "ScaleFactor": (factor, "1"), "Offset": (offset, "0")}
    head = ["Name,Scope", "", *(f"{k},{a},{k},{b}" for k, (a, b) in of.items()), ""]
    rows = lines(1e3 * T, U, 1e3 * T, Y, head=[])[1:]
    path = write(tmp_path / "a.csv", [*head, *rows])
    if (factor, offset) == ("1", "0"):
        is_it(read(path))
    else:
        assert "the file states 'Scale factor (" in asked(path)
