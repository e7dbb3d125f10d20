"""The scale of a file's numbers, stated where programs state it: a clock's text, a rate with its
unit, a factor with a name. It is applied, or asked for; numbers of another scale are never read in
silence."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from scipy.io import savemat
from tests.rigs.foreign_files import asked, read

from dehyst.models.recording import Recording

pytestmark = pytest.mark.processes

N = 300
T = np.round(0.005 * np.arange(N), 3)
U = np.round(50 + 40 * np.sin(2 * np.pi * 1.5 * T), 4)
Y = np.round(3 + 0.06 * U + 0.3 * np.cos(2 * np.pi * 1.5 * T), 5)


def is_it(found: Recording) -> None:
    assert found.displacement is not None
    np.testing.assert_allclose(found.t_s - found.t_s[0], T, atol=2e-6)
    np.testing.assert_allclose(found.drive, U, rtol=1e-9)
    np.testing.assert_allclose(found.displacement, Y, rtol=1e-9)


def table(path: Path, head: str, *columns: Any, above: str = "") -> Path:
    rows = [",".join(map(str, row)) for row in zip(*columns, strict=True)]
    path.write_text("\n".join([above + head, *rows]) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize(
    "heading", ["Time (min)", "Time (ms)", "Time_ms", "Time [h]", "Time of day", "t / s"]
)
@pytest.mark.parametrize("clock", ["00:00:{:06.3f}", "0:{:06.3f}", "{:.3f} s"])
def test_the_unit_of_a_clocks_heading_is_not_applied_again(
    tmp_path: Path, heading: str, clock: str
) -> None:
    path = table(tmp_path / "a.csv", f"{heading},U (V),Y (um)", map(clock.format, T), U, Y)
    is_it(read(path))
    assert "leave out --time-unit min" in asked(path, time_unit="min")


def test_a_heading_that_an_option_contradicts_is_named(tmp_path: Path) -> None:
    path = table(tmp_path / "a.csv", "Time (min),U (V),Y (um)", T, U, Y)
    found = read(path, time_unit="s")
    is_it(found)
    assert "'Time (min)', whose heading says min" in found.read


TOGETHER: dict[str, tuple[str, list[Any]]] = {
    "hours to milliseconds": (
        "Hour,Min,Sec,msec",
        [np.full(N, 14), np.full(N, 7), 58 + T // 1 - 60 * (58 + T // 1 >= 60), 1000 * T % 1000],
    ),
    "minutes and seconds": ("Minute,Second", [np.full(N, 3), T]),
    "seconds and nanoseconds": ("sec,nanoseconds", [1.7e9 + T // 1, np.round(1e9 * (T % 1))]),
    "two units of one name": ("Time (s),Time (ms)", [T // 1, np.round(1000 * T % 1000)]),
}


@pytest.mark.parametrize("kind", [k for k in TOGETHER if k != "hours to milliseconds"])
def test_times_over_several_columns_are_joined(tmp_path: Path, kind: str) -> None:
    head, columns = TOGETHER[kind]
    is_it(read(table(tmp_path / "a.csv", f"{head},U (V),Y (um)", *columns, U, Y)))


def test_times_over_four_columns_are_joined_over_the_minute(tmp_path: Path) -> None:
    ms = np.round(1000 * T).astype(int) + 58_600
    minute, second = 7 + ms // 60_000, ms // 1000 % 60
    columns = [np.full(N, 14), minute, second, ms % 1000, U, Y]
    is_it(read(table(tmp_path / "a.csv", "Hour,Min,Sec,msec,U (V),Y (um)", *columns)))


def test_one_time_in_two_units_is_not_joined(tmp_path: Path) -> None:
    columns = [T, np.round(1000 * T), U, Y]
    path = table(tmp_path / "a.csv", "Time (s),Time (ms),U (V),Y (um)", *columns)
    is_it(read(path))
    columns[1] *= 2.0
    assert "which is the time" in asked(table(path, "Time (s),Time (ms),U (V),Y (um)", *columns))


def test_a_latency_next_to_whole_seconds_is_no_part_of_the_time(tmp_path: Path) -> None:
    seconds, late = np.arange(N), np.random.default_rng(0).integers(0, 900, N)
    head = "Time (s),Latency (ms),U (V),Y (um)"
    found = read(table(tmp_path / "a.csv", head, seconds, late, U, Y))
    np.testing.assert_array_equal(found.t_s, seconds)


def test_hours_minutes_and_seconds_in_one_number_are_asked_for(tmp_path: Path) -> None:
    ms = np.round(1000 * T).astype(int) + 59_000
    packed = 140_700 + 100 * (ms // 60_000) + ms % 60_000 / 1000
    path = table(tmp_path / "a.csv", "Time,U (V),Y (um)", packed, U, Y)
    assert "HHMMSS" in asked(path)
    is_it(read(path, rate_hz=200.0))


def test_a_pause_of_forty_seconds_is_a_pause(tmp_path: Path) -> None:
    paused = T + 40.0 * (np.arange(N) >= 150)
    found = read(table(tmp_path / "a.csv", "Time,U (V),Y (um)", paused, U, Y))
    assert found.t_s[-1] == pytest.approx(T[-1] + 40.0)


@pytest.mark.parametrize("heading", ["Time (s)", "t_s", "Zeit [s]", "t (s)", "seconds"])
@pytest.mark.parametrize("pause", [40.0, 100.0, 200.0, 1000.0])
def test_a_heading_that_says_seconds_is_believed(
    tmp_path: Path, heading: str, pause: float
) -> None:
    paused = 59.25 + T + (pause - 0.005 if pause > 40.0 else pause) * (np.arange(N) >= 150)
    found = read(table(tmp_path / "a.csv", f"{heading},U (V),Y (um)", paused, U, Y))
    assert np.ptp(found.t_s) == pytest.approx(np.ptp(paused))


@pytest.mark.parametrize("step", [0.005, 0.05])
def test_pauses_without_a_unit_are_asked_for_and_then_kept(tmp_path: Path, step: float) -> None:
    paused = 20.0 + step * np.arange(N) + 200.0 * (np.arange(N) >= 150)
    path = table(tmp_path / "a.csv", "Time,U (V),Y (um)", paused, U, Y)
    assert "HHMMSS): add --time-unit s if these are seconds with pauses" in asked(path)
    found = read(path, time_unit="s")
    assert np.ptp(found.t_s) == pytest.approx(np.ptp(paused))


def test_a_jump_at_each_minute_is_no_pause_whatever_the_heading_says(tmp_path: Path) -> None:
    s = 59.0 + np.arange(N) / 2.0
    packed = 140_700 + 100 * (s // 60) + s % 60
    path = table(tmp_path / "a.csv", "Time (s),U (V),Y (um)", packed, U, Y)
    assert "HHMMSS" in asked(path)


def in_json(path: Path, **more: Any) -> None:
    path.write_text(json.dumps({"voltage_v": U.tolist(), "displacement_um": Y.tolist(), **more}))


def in_mat(path: Path, **more: Any) -> None:
    savemat(path, {"voltage_v": U, "displacement_um": Y, **more})


def in_hdf5(path: Path, **more: Any) -> None:
    with h5py.File(path, "w") as file:
        file["voltage_v"], file["displacement_um"] = U, Y
        for name, value in more.items():
            file.attrs[name] = value


def in_a_dataset(path: Path, **more: Any) -> None:
    with h5py.File(path, "w") as file:
        file["voltage_v"], file["displacement_um"] = U, Y
        (name, value), (_, unit) = more.items()
        file[name] = value
        file[name].attrs["units"] = unit


def in_text(path: Path, **more: Any) -> None:
    (name, value), (_, unit) = more.items()
    above = f"{name.replace('_', ' ')},{value}\nUnit,{unit}\n"
    table(path, "Voltage (V),Displacement (um)", U, Y, above=above)


BESIDE: dict[str, Callable[..., None]] = {
    "a.json": in_json,
    "a.mat": in_mat,
    "a.h5": in_hdf5,
    "b.h5": in_a_dataset,
    "a.csv": in_text,
}


@pytest.mark.parametrize("name", list(BESIDE))
@pytest.mark.parametrize(
    ("stated", "value", "unit"), [("sampling_rate", 0.2, "kHz"), ("sample_period", 5.0, "ms")]
)
def test_the_unit_beside_a_rate_is_its_unit(
    tmp_path: Path, name: str, stated: str, value: float, unit: str
) -> None:
    BESIDE[name](tmp_path / name, **{stated: value, f"{stated}_unit": unit})
    is_it(read(tmp_path / name))


@pytest.mark.parametrize("rate", [1.0, 5.0, 40.0])
def test_a_slow_scan_rate_may_be_that_of_lines(tmp_path: Path, rate: float) -> None:
    path = tmp_path / "a.csv"
    table(path, "Voltage (V),Height (um)", U, Y, above=f"# Scan rate: {rate:g} Hz\n")
    assert "add --rate HZ" in asked(path)
    is_it(read(path, rate_hz=200.0))
    table(path, "Voltage (V),Height (um)", U, Y, above="# Scan rate: 200 Hz\n")
    is_it(read(path))


def test_a_time_unit_without_times_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    table(path, "Voltage (V),Height (um)", U, Y, above="# Sampling rate: 2 Hz\n")
    assert "which --rate HZ replaces" in asked(path, time_unit="ms")


@pytest.mark.parametrize(
    ("drive", "displacement", "option"),
    [
        ("U/10 V", "Y (um)", "drive_unit"),
        ("HV/15 [V]", "Y (um)", "drive_unit"),
        ("Drive/10 (V)", "Y (um)", "drive_unit"),
        ("Voltage*10 (V)", "Y (um)", "drive_unit"),
        ("Voltage x15 (V)", "Y (um)", "drive_unit"),
        ("Voltage (V) [1:15]", "Y (um)", "drive_unit"),
        ("Voltage_div10_V", "Y (um)", "drive_unit"),
        ("Voltage (V)", "Weg/100 nm", "unit"),
        ("Voltage (V)", "10*Displacement (um)", "unit"),
        ("Voltage (V)", "Displacement/0.1 µm", "unit"),
    ],
)
def test_a_factor_with_the_name_is_asked_for(
    tmp_path: Path, drive: str, displacement: str, option: str
) -> None:
    path = table(tmp_path / "a.csv", f"t (s),{drive},{displacement}", T, U, Y)
    said = asked(path)
    assert f"--{option.replace('_', '-')} and the unit" in said
    assert "not multiplied" in said
    is_it(read(path, **{option: "v" if option == "drive_unit" else "um"}))


@pytest.mark.parametrize(
    "drive", ["Dev1/ai0 (V)", "Piezo x2 (V)", "Voltage 1:1 (V)", "run/1/U (V)", "Channel 10 (V)"]
)
def test_a_number_in_a_name_is_no_factor(tmp_path: Path, drive: str) -> None:
    is_it(read(table(tmp_path / "a.csv", f"t (s),{drive},Displacement (um)", T, U, Y)))


FACTORS: dict[str, Callable[[Path, str], None]] = {
    "a.json": lambda path, word: in_json(path, t_s=T.tolist(), **{f"voltage_v_{word}": 15}),
    "b.json": lambda path, word: path.write_text(
        json.dumps(
            {
                "t": {"unit": "s", "data": T.tolist()},
                "drive": {"unit": "V", word: 15, "data": U.tolist()},
                "displacement": {"unit": "um", word: 1, "data": Y.tolist()},
            }
        )
    ),
    "a.mat": lambda path, word: in_mat(path, t_s=T, **{f"voltage_v_{word}": 15.0}),
}


@pytest.mark.parametrize("name", list(FACTORS))
@pytest.mark.parametrize("word", ["scale", "conversion_factor", "multiplier", "ScaleFactor", "lsb"])
def test_a_factor_beside_the_numbers_is_asked_for(tmp_path: Path, name: str, word: str) -> None:
    FACTORS[name](tmp_path / name, word)
    assert "x 15" in asked(tmp_path / name)
    is_it(read(tmp_path / name, drive_unit="v"))


def test_a_monitor_does_not_win_over_the_voltage_that_it_shows(tmp_path: Path) -> None:
    head = "t (s),Voltage monitor (V),Piezo (V),Displacement (um)"
    path = table(tmp_path / "a.csv", head, T, U / 15, U, Y)
    assert 'which is the drive? add --columns u="Piezo (V)"' in asked(path)
    alone = table(tmp_path / "b.csv", "t (s),Voltage monitor (V),Displacement (um)", T, U, Y)
    is_it(read(alone))


@pytest.mark.parametrize("times", [2, 3])
def test_rows_that_are_written_several_times_count_once(tmp_path: Path, times: int) -> None:
    columns = [np.repeat(values, times) for values in (T, U, Y)]
    found = read(table(tmp_path / "a.csv", "t (s),U (V),Y (um)", *columns))
    is_it(found)
    assert f"{(times - 1) * N} rows that are written twice left out" in found.read


def test_a_structure_of_a_signal_gives_its_unit_to_the_numbers_alone(tmp_path: Path) -> None:
    savemat(tmp_path / "a.mat", {
        "drive": {"Time": T, "Data": U, "Units": "V", "Name": "volt"},
        "displacement": {"Time": T, "Data": Y, "Units": "um"},
    })  # fmt: skip
    is_it(read(tmp_path / "a.mat"))


def test_lines_of_json_are_read_whatever_the_file_is_called(tmp_path: Path) -> None:
    rows = [{"t_s": t, "u_v": u, "y_um": y} for t, u, y in zip(T, U, Y, strict=True)]
    (tmp_path / "a.json").write_text("\n".join(json.dumps(row) for row in rows))
    is_it(read(tmp_path / "a.json"))
