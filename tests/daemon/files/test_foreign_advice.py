"""What a file of another program does not say is asked for with an option that works: followed to
the letter, it reads the file as it was written. Nothing that is named amiss becomes the drive."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.rigs.foreign_files import asked, read

from dehyst.daemon.files.foreign.reading import ReadOptions, parse_columns
from dehyst.daemon.files.loading import load_columns
from dehyst.daemon.files.recordings import read_columns
from dehyst.models.errors import BadRecording
from dehyst.models.recording import Recording

N = 300
COUNT = np.arange(N)
T = np.round(0.005 * COUNT, 3)
U = np.round(50 + 40 * np.sin(2 * np.pi * 1.5 * T), 4)
Y = np.round(3 + 0.06 * U + 0.3 * np.cos(2 * np.pi * 1.5 * T), 5)
Z = np.round(U / 7.0 + 0.1, 4)


def write(path: Path, head: Sequence[str], *columns: Sequence[Any] | np.ndarray) -> Path:
    body = [",".join(map(str, row)) for row in zip(*columns, strict=True)]
    path.write_text("\n".join([*head, *body]) + "\n", encoding="utf-8")
    return path


def advised(said: str) -> dict[str, str | int]:
    """Return the columns that a message advises, each role once."""
    found = re.findall(r"add (--columns \S+=.*?)(?=; |$)", said)
    found += re.findall(r"which is which: (--columns \S+)", said)
    parts = [parse_columns(option.removeprefix("--columns ")) for option in found]
    out = {role: column for part in parts for role, column in part.items()}
    assert len(out) == sum(map(len, parts)), said
    return out


def is_it(found: Recording, drive: np.ndarray = U, displacement: np.ndarray = Y) -> None:
    assert found.displacement is not None
    np.testing.assert_allclose(found.t_s - found.t_s[0], T, atol=2e-6)
    np.testing.assert_allclose(found.drive, drive, rtol=1e-9)
    np.testing.assert_allclose(found.displacement, displacement, rtol=1e-9)


STILL = np.full(N, 7.0)
BARE: dict[str, tuple[list[np.ndarray], dict[str, int], bool]] = {
    # columns without headings -> (columns, what is advised, whether there are times)
    "in order": ([T, U, Y], {"t": 0, "u": 1, "y": 2}, True),
    "times last": ([U, Y, T], {"t": 2, "u": 0, "y": 1}, True),
    "row numbers before": ([COUNT + 10, T, U, Y], {"t": 1, "u": 2, "y": 3}, True),
    "row numbers only": ([COUNT, U, Y], {"u": 1, "y": 2}, False),
    "no times": ([U, Y], {"u": 0, "y": 1}, False),
    "times for each channel": ([T, U, T, Y], {"t": 0, "u": 1, "y": 3}, True),
    "a setting": ([T, STILL, U, Y], {"t": 0, "u": 2, "y": 3}, True),
    "uneven times": ([T + 0.0024 * np.sin(COUNT), U, Y], {"t": 0, "u": 1, "y": 2}, True),
}


@pytest.mark.parametrize("kind", BARE)
@pytest.mark.parametrize("container", ["csv", "npy"])
def test_columns_without_headings(tmp_path: Path, kind: str, container: str) -> None:
    columns, expected, timed = BARE[kind]
    path = tmp_path / f"a.{container}"
    if container == "npy":
        np.save(path, np.column_stack(columns))
    else:
        write(path, [], *columns)
    with pytest.raises(BadRecording) as of_times:
        read_columns(path)  # as for a trajectory or to convert
    for said in (asked(path), str(of_times.value)):
        assert advised(said) == expected
        assert ("--rate HZ" in said) == (not timed)
    found = read(path, columns=expected, unit="um", rate_hz=0.0 if timed else 200.0)
    np.testing.assert_allclose(found.drive, U, rtol=1e-9)
    assert found.displacement is not None
    np.testing.assert_allclose(found.displacement, Y, rtol=1e-9)


def test_a_trajectory_without_headings(tmp_path: Path) -> None:
    """A target is asked for, and neither drive nor displacement."""
    for columns, expected in (([T, Y], {"t": 0, "target": 1}), ([COUNT, Y], {"target": 1})):
        path = write(tmp_path / "a.csv", [], *columns)
        with pytest.raises(BadRecording) as error:
            load_columns(path, wants=("t", "target"))
        assert advised(str(error.value)) == expected


CLOCK = [f"12:00:{t:06.3f}" for t in T]
NAMED = {
    # headings in no language that is known, or of lists -> what is advised
    "Vrijeme,Ulaz,Izlaz": ({"t": "Vrijeme", "u": "Ulaz", "y": "Izlaz"}, (T, U, Y)),
    "a.0,a.1,a.2": ({"t": "a.0", "u": "a.1", "y": "a.2"}, (T, U, Y)),
    "tout,yout.0,yout.1": ({"t": "tout", "u": "yout.0", "y": "yout.1"}, (T, U, Y)),
    "p,q,r": ({"t": "r", "u": "p", "y": "q"}, (U, Y, T)),
    "time[0],Y[0],Y[1]": ({"u": "Y[0]", "y": "Y[1]"}, (CLOCK, U, Y)),
    "Time (s),one/pos,two/pos": ({"u": "one/pos", "y": "two/pos"}, (T, U, Y)),
    "Time (s),Drive (%),Displacement (um)": ({"u": "Drive (%)"}, (T, U, Y)),
    "Time (s),Voltage (V),Strain (%)": ({"y": "Strain (%)"}, (T, U, Y)),
}


@pytest.mark.parametrize("names", NAMED)
def test_the_advice_for_names_that_are_not_known(tmp_path: Path, names: str) -> None:
    expected, columns = NAMED[names]
    path = write(tmp_path / "a.csv", [names], *columns)
    assert advised(asked(path)) == expected
    more = {"drive_unit": "" if "(V)" in names else "counts", "unit": "counts"}
    if "(um)" in names:
        more["unit"] = ""
    is_it(read(path, columns=expected, **more))


def test_an_axis_that_rises_evenly_is_not_advised_as_the_drive(tmp_path: Path) -> None:
    """LeCroy names the time x and the voltage y."""
    path = tmp_path / "a.npz"
    np.savez(path, x=T, y=U)
    said = asked(path, unit="v")
    assert "--columns t=x" in said
    assert "u=x" not in said
    assert "y=x" not in said


AMPLIFIERS = {
    "Function generator (V),Photodiode amplifier (V)": (U, Y),
    "AWG (V),Lock-in amplifier (V)": (U, Y),
    "Generator (V),Charge amplifier (V)": (U, Y),
    "Messverstärker (V),HV amplifier (V)": (Y, U),
    "Bridge amplifier (mV),Piezo amplifier (V)": (1e3 * Y, U),
}


@pytest.mark.parametrize("names", AMPLIFIERS)
def test_an_amplifier_that_measures_is_no_drive(tmp_path: Path, names: str) -> None:
    is_it(read(write(tmp_path / "a.csv", [f"Time (s),{names}"], T, *AMPLIFIERS[names])))


def test_of_two_that_measure_one_is_asked_for(tmp_path: Path) -> None:
    names = "Time (s),Generator (V),Charge amplifier (V),LVDT (V)"
    path = write(tmp_path / "a.csv", [names], T, U, Z, Y)
    assert "'Charge amplifier (V)', 'LVDT (V)': which is the displacement?" in asked(path)
    is_it(read(path, columns={"y": "LVDT (V)"}))


def test_row_numbers_named_time_are_asked_for(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", ["Time,Voltage (V),Displacement (um)"], COUNT, U, Y)
    assert "--rate HZ if it counts the rows" in asked(path)
    is_it(read(path, rate_hz=200.0))


NAMES = "Time (s),Voltage (V),Displacement (um)"


def test_the_newest_row_first(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", [NAMES], T[::-1], U[::-1], Y[::-1])
    assert "the newest row is first; reverse the order of the rows" in asked(path)
    is_it(read(write(path, [NAMES], T, U, Y)))


def test_rows_in_no_order_are_not_cut_into_hundreds_of_parts(tmp_path: Path) -> None:
    mixed = np.random.default_rng(1).permutation(N)
    few = np.r_[COUNT[:40], COUNT[40:80].reshape(20, 2)[:, ::-1].reshape(-1)]  # a third go back
    for order in (mixed, few):
        path = write(tmp_path / "a.csv", [NAMES], T[order], U[order], Y[order])
        assert "sort the rows by time" in asked(path)


def yokogawa(quoted_end: str) -> list[str]:
    return [
        f'"Model Name","DL850E"{quoted_end}', f'"TraceName","Drive","Sensor"{quoted_end}',
        f'"BlockSize","{N}","{N}"{quoted_end}', f'"VUnit","mV","nm"{quoted_end}',
        f'"SampleRate","200.000","200.000"{quoted_end}', f'"HUnit","s","s"{quoted_end}',
        f'"DisplayPointNo.","1","1"{quoted_end}', f'"Date","2024/03/05","2024/03/05"{quoted_end}',
        f'"Time","10:12:13.00","10:12:13.00"{quoted_end}', "",
    ]  # fmt: skip


@pytest.mark.parametrize("end", ["", ","])
def test_names_and_units_far_above_in_a_file_of_yokogawa(tmp_path: Path, end: str) -> None:
    path = write(tmp_path / "a.csv", yokogawa(end), [""] * N, 1e3 * U, 1e3 * Y, [""] * N)
    assert "add --rate HZ" in asked(path)
    found = read(path, rate_hz=200.0)
    assert (found.drive_unit, found.displacement_unit) == ("v", "nm")
    is_it(found, U, 1e3 * Y)


def test_the_preamble_of_tektronix_beside_the_numbers(tmp_path: Path) -> None:
    """Each channel has the preamble in its own first three columns."""
    beside = [["Record Length", N, ""], ["Sample Interval", 0.005, ""], ["Source", "CH1", ""]]
    beside += [["Vertical Units", "V", ""], ["Horizontal Units", "s", ""]]
    rest = [["", "", ""]] * (N - len(beside))
    three = list(zip(*beside, *rest, strict=True))
    path = write(tmp_path / "a.csv", [], *three, T, U, [""] * N, *three, T, Y)
    assert advised(asked(path)) == {"t": 3, "u": 4, "y": 10}
    is_it(read(path, columns={"t": 3, "u": 4, "y": 10}, unit="um"))


@pytest.mark.parametrize("blank", [True, False])
def test_the_labels_of_signalexpress_name_the_next_line(tmp_path: Path, blank: bool) -> None:
    """The period is no row of the numbers, but that of the rows; the names are headings."""
    head = ["channel names:", '"Dev1_ai0","Dev1_ai1"', "start times:"]
    head += ["03/05/2024 14:05:11.250,03/05/2024 14:05:11.250", "dt:", "0.005,0.005", "data:"]
    tabs = [line.replace(",", "\t") + "\t" * blank for line in head]
    body = [f"{u}\t{y}" for u, y in zip(U, Y, strict=True)]
    path = tmp_path / "a.txt"
    path.write_text("\n".join([*tabs, *body]) + "\n")
    assert advised(asked(path)) == {"u": "Dev1_ai0", "y": "Dev1_ai1"}
    is_it(read(path, columns={"u": 0, "y": 1}, unit="um"))


def test_an_alarm_beside_each_channel_of_a_data_logger(tmp_path: Path) -> None:
    """BenchLink: a scan number, a clock whose milliseconds stand behind a colon, an alarm."""
    names = "Scan,Time,101 (VDC),Alarm 101,102 (VDC),Alarm 102"
    clock = [f"03/05/2024 14:05:{int(t):02d}:{1e3 * (t % 1):03.0f}" for t in T]
    nought = np.zeros(N, dtype=int)
    head = ["Name:,piezo", "Instrument:,34970A", "", names]
    path = write(tmp_path / "a.csv", head, COUNT + 1, clock, U, nought, Y, nought)
    assert advised(asked(path)) == {"u": "101 (VDC)", "y": "102 (VDC)"}
    found = read(path, columns={"u": "101 (VDC)", "y": "102 (VDC)"})
    assert (found.drive_unit, found.displacement_unit) == ("v", "v")
    is_it(found)


def said_of(path: Path, columns: str = "") -> str:
    """Return how a file was read where drive and displacement are not required."""
    return load_columns(path, ReadOptions(parse_columns(columns)), wants=("t",)).said


def test_names_are_offered_where_drive_and_displacement_are_not_required(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", ["Time (s),Ampl,Ampl2"], T, U, Y)
    assert advised(said_of(path).replace(" if that is right", "")) == {"u": "Ampl", "y": "Ampl2"}
    assert "add" not in said_of(path, "t=0,v1=Ampl,v2=Ampl2")
    path = write(tmp_path / "b.csv", ["Time (s),Voltage (V),Temperature (C)"], T, U, Y)
    assert "add" not in said_of(path)


def test_a_matrix_is_asked_for_as_a_whole(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    np.savez(path, data=np.column_stack([T, U, Y]))
    with pytest.raises(BadRecording) as refused:
        read_columns(path)
    expected = {"t": "data.0", "u": "data.1", "y": "data.2"}
    assert advised(str(refused.value)) == advised(asked(path)) == expected
    is_it(read(path, columns=expected, unit="um"))
