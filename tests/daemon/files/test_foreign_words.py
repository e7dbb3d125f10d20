"""Fields, clocks and periods as instruments write them: words beyond the range, thousands apart,
exponents, dates; and lines that belong to no row, which are counted or named."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from tests.rigs.foreign_files import asked, read

from dehyst.models.errors import BadRecording
from dehyst.models.recording import Recording

N = 300
T = np.round(0.005 * np.arange(N), 3)
U = np.round(50 + 40 * np.sin(2 * np.pi * 2.0 * T), 3)
Y = np.round(3 + 0.06 * U + 0.3 * np.cos(2 * np.pi * 2.0 * T), 4)
NAMES = "Time (s),Voltage (V),Displacement (um)"
BODY = [f"{t:.3f},{u:.3f},{y:.4f}" for t, u, y in zip(T, U, Y, strict=True)]


def write(path: Path, *lines: str) -> Path:
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def is_it(
    found: Recording, displacement: np.ndarray = Y, drive: np.ndarray = U, times: np.ndarray = T
) -> None:
    assert found.displacement is not None
    np.testing.assert_allclose(found.t_s - found.t_s[0], times - times[0], atol=2e-6)
    np.testing.assert_allclose(found.drive, drive, rtol=1e-9)
    np.testing.assert_allclose(found.displacement, displacement, rtol=1e-9)


LOST = np.where((np.arange(N) >= 100) & (np.arange(N) < 110), np.nan, Y)
WORDS = [
    "OVER", "Overflow", "Over range", "OVLD", "-OVLD", "OL", "+OL", "∞", "-∞", "Inf", "-infinity",
    "9.91E+37", "9.9E+37", "-9.90000000E+37", "n.d.", "?", "*****", "#DIV/0!", "1.#INF",
]  # fmt: skip


@pytest.mark.parametrize("word", WORDS)
def test_words_of_instruments_for_no_value(tmp_path: Path, word: str) -> None:
    lines = [row.rpartition(",")[0] + "," + word for row in BODY[100:110]]
    found = read(write(tmp_path / "a.csv", NAMES, *BODY[:100], *lines, *BODY[110:]))
    is_it(found, LOST)
    assert "10 displacement values missing" in found.defects()


@pytest.mark.parametrize("word", ["OVERALL", "L"])
def test_other_words_are_not_passed_over(tmp_path: Path, word: str) -> None:
    line = BODY[100].rpartition(",")[0] + "," + word
    with pytest.raises(BadRecording):
        read(write(tmp_path / "a.csv", NAMES, *BODY[:100], line, *BODY[101:]))


def test_infinity_in_an_array_is_missing(tmp_path: Path) -> None:
    for name, nothing in (("a", np.inf), ("b", -np.inf)):
        y = np.where(np.isnan(LOST), nothing, Y)
        np.savez(tmp_path / f"{name}.npz", **{"Time (s)": T, "Voltage (V)": U, "Weg (um)": y})
        is_it(read(tmp_path / f"{name}.npz"), LOST)


def french(value: float, digits: int) -> str:
    return f"{value:,.{digits}f}".replace(",", " ").replace(".", ",")


def spaced(value: float, digits: int) -> str:
    return f"{value:,.{digits}f}".replace(",", " ")


@pytest.mark.parametrize("separator", ["\t", ";", " \t"])
@pytest.mark.parametrize("form", [french, spaced])
@pytest.mark.parametrize("least", [0.0, 4000.0])
def test_thousands_set_apart_by_spaces(
    tmp_path: Path, separator: str, form: Callable[[float, int], str], least: float
) -> None:
    """least [mV]: with 0 the drive crosses 1000, so that only some rows hold a second space."""
    drive, position = 40.0 * U + least, 1e3 * Y
    body = [
        separator.join([form(t, 3), form(u, 1), form(y, 1)])
        for t, u, y in zip(T, drive, position, strict=True)
    ]
    names = separator.join(["Time (s)", "Voltage (mV)", "Position (nm)"])
    found = read(write(tmp_path / "a.txt", names, *body))
    assert found.displacement is not None
    np.testing.assert_allclose(found.drive, drive / 1e3, atol=6e-5)
    np.testing.assert_allclose(found.displacement, position, atol=0.06)


def test_blanks_between_fields_that_also_hold_tabs(tmp_path: Path) -> None:
    body = [row.replace(",", "  ") for row in BODY]
    is_it(read(write(tmp_path / "a.txt", NAMES.replace(",", "\t"), *body)))
    pairs = ["\t".join((row.replace(",", " "), "7 8")) for row in BODY]
    is_it(read(write(tmp_path / "b.txt", "t_s u_v y_um a b", *pairs)))


NUMBERS: dict[str, Callable[[float], str]] = {
    "Fortran": lambda x: f"{x:.8E}".replace("E", "D"),
    "Fortran, small": lambda x: f"{x:.8e}".replace("e", "d"),
    "typographic minus": lambda x: f"{x:.5f}".replace("-", "\u2212"),
}


@pytest.mark.parametrize("kind", NUMBERS)
@pytest.mark.parametrize("separator", [",", "\t", "  "])
def test_numbers_of_fortran_and_of_word_processors(
    tmp_path: Path, kind: str, separator: str
) -> None:
    form = NUMBERS[kind]
    rows = zip(T, U - 50.0, Y - 6.0, strict=True)
    body = [separator.join(map(form, row)) for row in rows]
    found = read(write(tmp_path / "a.txt", NAMES.replace(",", separator), *body))
    assert found.displacement is not None
    np.testing.assert_allclose(found.drive, U - 50.0, atol=1e-9)
    np.testing.assert_allclose(found.displacement, Y - 6.0, atol=1e-9)


@pytest.mark.parametrize("unit", ["Å", "Angstrom", "ångström"])
def test_angstroms(tmp_path: Path, unit: str) -> None:
    body = [f"{t:.3f},{u:.3f},{1e4 * y:.0f}" for t, u, y in zip(T, U, Y, strict=True)]
    path = write(tmp_path / "a.csv", f"Time (s),Voltage (V),Height ({unit})", *body)
    found = read(path)
    assert found.displacement_unit == "nm"
    is_it(found, 1e3 * Y)
    is_it(read(write(path, "Time (s),Voltage (V),Position", *body), unit="angstrom"), 1e3 * Y)


def second(t: float) -> str:
    return f"{t:06.3f}"


DATES: dict[str, Callable[[float], str]] = {
    "05-Mar-2024": lambda t: f"05-Mar-2024 14:05:{second(t)}",
    "2024年3月5日": lambda t: f"2024年3月5日 14:05:{second(t)}",
    "5 mar 2024": lambda t: f"5 mar 2024 14:05:{second(t)}",
    "05.03.24": lambda t: f"05.03.24 14:05:{second(t)}",
    "03/05/2024": lambda t: f"03/05/2024 14:05:{second(t)}",
    "25/03/2024": lambda t: f"25/03/2024 14:05:{second(t)}",
    "25/03/2024 pm": lambda t: f"25/03/2024 2:05:{second(t)} p.m.",
    "a colon": lambda t: f"14:05:{second(t)}".replace(".", ":"),
    "midnight, month first": lambda t: (
        f"03/05/2024 11:59:59.{1e3 * t:03.0f} PM"
        if t < 1.0
        else f"03/06/2024 12:00:00.{1e3 * (t - 1.0):03.0f} AM"
    ),
}


def dated(kind: Callable[[float], str]) -> list[str]:
    names = "Time,Voltage (V),Displacement (um)"
    return [names, *(f"{kind(t)},{row.partition(',')[2]}" for t, row in zip(T, BODY, strict=True))]


@pytest.mark.parametrize("kind", DATES)
def test_dates_in_front_of_the_clock(tmp_path: Path, kind: str) -> None:
    is_it(read(write(tmp_path / "a.csv", *dated(DATES[kind]))))


@pytest.mark.parametrize("half", [True, False])
def test_a_day_in_front_of_the_month_is_not_a_pause_of_a_month(tmp_path: Path, half: bool) -> None:
    def british(t: float) -> str:
        day, rest = (
            (5, f"59:59.{1e3 * t:03.0f}") if t < 1.0 else (6, f"00:00.{1e3 * (t - 1):03.0f}")
        )
        if half:
            return (
                f"{day:02d}/03/2024 {'11' if t < 1.0 else '12'}:{rest} {'PM' if day == 5 else 'AM'}"
            )
        return f"{day:02d}/03/2024 {'23' if t < 1.0 else '00'}:{rest}"

    path = write(tmp_path / "a.csv", *dated(british))
    assert "line 202: if the day comes before the month, write the dates as 2024-03-05" in asked(
        path
    )
    is_it(read(path, rate_hz=200.0))


PAIRS = "Voltage (V),Displacement (um)"
UNTIMED = [row.partition(",")[2] for row in BODY]
STATED = {
    "Increment,0.5": False,
    "Increment,0.005": False,
    "Start,0|Stop,100|Increment,0.5": False,
    "Increment (V),0.005": False,
    "Delta X,0.5": False,
    "Sample Interval,5": False,
    "Sample rate,200|Sample interval,0.01": False,
    "Sample Interval,0.005": True,
    "Sample Interval (ms),5": True,
    "Increment,0.005,s": True,
    "Sample rate,200|Sample interval,0.005": True,
    "Sample rate,200|Sample interval,5 ms": True,
}
"""What a preamble states -> whether it is a period that can only be meant as one of time."""


@pytest.mark.parametrize("stated", STATED)
def test_a_period_is_taken_only_if_it_is_one_of_time(tmp_path: Path, stated: str) -> None:
    path = write(tmp_path / "a.csv", *stated.split("|"), PAIRS, *UNTIMED)
    if not STATED[stated]:
        assert "add --rate HZ" in asked(path)
    is_it(read(path, rate_hz=0.0 if STATED[stated] else 200.0))


@pytest.mark.parametrize("mark", "!#%")
@pytest.mark.parametrize("every", [50, 299])
def test_rows_behind_a_mark_are_counted(tmp_path: Path, mark: str, every: int) -> None:
    body = [mark * (i % every == 3) + row for i, row in enumerate(BODY)]
    found = read(write(tmp_path / "a.csv", NAMES, *body))
    kept = np.arange(N) % every != 3
    is_it(found, Y[kept], U[kept], T[kept])
    lines = "1 line" if every == 299 else "6 lines"
    assert f"{lines} of numbers after a comment mark left out, the first in line 5" in found.read


OTHERS = {
    "Calibrated,50.1,6.2": "line 302: Time (s) is 'Calibrated', not a number",
    "u=50:,90.0,8.4": "line 302: Time (s) is 'u=50:', not a number",
    ",50.1,6.2": "line 302: the time is missing",
}


@pytest.mark.parametrize("line", OTHERS)
def test_a_line_that_is_none_of_the_recordings_is_named(tmp_path: Path, line: str) -> None:
    said = asked(write(tmp_path / "a.csv", NAMES, *BODY, line))
    assert OTHERS[line] in said
    assert "delete the line if it is not part of the recording" in said


def test_zero_bytes_at_the_end_are_named_by_their_line(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", NAMES, *BODY)
    path.write_bytes(path.read_bytes() + bytes(300))
    said = asked(path)
    assert "line 302 holds a zero byte" in said
    assert "delete that line and what follows" in said


def test_the_suffix_of_another_kind_is_said(tmp_path: Path) -> None:
    text = write(tmp_path / "a.csv", NAMES, *BODY).read_bytes()
    np.save(tmp_path / "a.npy", np.column_stack([T, U, Y]))
    others = {
        "a.xlsx": (text, "not a spreadsheet but text: rename it to .txt"),
        "a.mat": (text, "not a MATLAB file but text: rename it to .txt"),
        "b.npy": (text, "not an .npy file but text: rename it to .txt"),
        "b.csv": ((tmp_path / "a.npy").read_bytes(), "begins like a .npy file: rename it"),
        "c.txt": (b"PK\x03\x04" + bytes(40), "begins like a .zip file: rename it"),
        "a.xyz": (text, "rename it to .txt"),
    }
    for name, (data, what) in others.items():
        (tmp_path / name).write_bytes(data)
        assert what in asked(tmp_path / name)
