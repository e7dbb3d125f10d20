"""Sums, means and other figures, and notes, below the numbers are left out and counted; other words
there are refused with their line, and words between the numbers, too."""

import gzip
from pathlib import Path

import numpy as np
import pytest
from tests.rigs.foreign_files import asked, read

from dehyst.models.recording import Recording

pytestmark = pytest.mark.processes
N = 300
T = np.round(0.005 * np.arange(N), 3)
U = np.round(50 + 40 * np.sin(2 * np.pi * 1.5 * T), 4)
Y = np.round(3 + 0.06 * U + 0.3 * np.cos(2 * np.pi * 1.5 * T), 5)
BODY = [f"{t:g},{u},{y}" for t, u, y in zip(T, U, Y, strict=True)]
NAMES, OWN = "Time (s),Voltage (V),Displacement (um)", "t_s,u_v,y_um"
FOOTERS = {
    "mean": ["Mean,50.1,6.2"],
    "total without the first": ["Total,,1830.2"],
    "several after an empty line": ["", "Average,50,6", "Min,10,3", "Max,90,8", ""],
    "with colons": ["Mean:,50.1,6.2", "Std. Dev.:,28.3,1.7"],
    "among other figures": ["Statistics", "Slope,,0.06", "Peak-to-Peak,80,4.8"],
    "German": ["Mittelwert,50.1,6.2", "Standardabweichung,28.3,1.7"],
    "Chinese": ["平均值,50.1,6.2", "最大,90,8"],
    "in a field of its own": ["AVG,0.75,50.1,6.2"],
    "below an empty field": [",Mean,50.1,6.2"],
    "below their names": [",Mean,Mean", ",50.1,6.2"],
    "in words": ["Mean = 50.1 V", "Max = 90 V,8 um"],
}


def is_it(found: Recording) -> None:
    assert found.displacement is not None
    np.testing.assert_allclose(found.t_s, T, atol=1e-12)
    np.testing.assert_array_equal(found.drive, U)
    np.testing.assert_array_equal(found.displacement, Y)


@pytest.mark.parametrize("names", [NAMES, OWN])
@pytest.mark.parametrize("kind", FOOTERS)
@pytest.mark.parametrize("end", ["\n", ""])
def test_figures_below_the_numbers_are_left_out_and_counted(
    tmp_path: Path, names: str, kind: str, end: str
) -> None:
    footer = FOOTERS[kind]
    path = tmp_path / "a.csv"
    path.write_text("\n".join([names, *BODY, *footer]) + end, encoding="utf-8")
    found = read(path)
    is_it(found)
    first = next(i for i, line in enumerate(footer) if line)
    count = sum(bool(line) for line in footer)
    assert (
        f"{count} line{'s' * (count > 1)} of sums or means below the numbers left out" in found.read
    )
    assert f"in line {N + 2 + first}" in found.read
    with gzip.open(tmp_path / "a.csv.gz", "wt", encoding="utf-8") as file:
        file.write(path.read_text(encoding="utf-8"))
    is_it(read(tmp_path / "a.csv.gz"))


@pytest.mark.parametrize("mark", ["\t", ";", "  "])
@pytest.mark.parametrize("first", ["", "Sample"])
def test_figures_in_a_column_of_their_own(tmp_path: Path, mark: str, first: str) -> None:
    number = [f"{i}" if first else "" for i in range(N)]
    if mark == "  " and not first:
        return
    rows = [f"{n},{row}" for n, row in zip(number, BODY, strict=True)]
    lines = [f"{first},{NAMES}", *rows, "Mean,0.75,50,6", "Max,1.5,90,8"]
    path = tmp_path / "a.txt"
    path.write_text("\n".join(lines).replace(",", mark) + "\n")
    found = read(path)
    is_it(found)
    assert "2 lines of sums or means below the numbers left out, the first ('Mean')" in found.read


def test_figures_in_a_spreadsheet(tmp_path: Path) -> None:
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    sheet = book.active
    for row in (NAMES.split(","), *zip(T.tolist(), U.tolist(), Y.tolist(), strict=True)):
        sheet.append(list(row))
    for row in ([None], ["Average", 50.1, 6.2], ["Max", 90.0, 8.4]):
        sheet.append(row)
    book.save(tmp_path / "a.xlsx")
    found = read(tmp_path / "a.xlsx")
    is_it(found)
    assert "left out, the first ('Average') in row 303" in found.read


@pytest.mark.parametrize("names", [NAMES, OWN])
@pytest.mark.parametrize("notes", [["Samples,300"], ["", "End time,14:05:03", "Gain,1", "End"]])
def test_notes_below_the_numbers_are_left_out_and_counted(
    tmp_path: Path, names: str, notes: list[str]
) -> None:
    path = tmp_path / "a.csv"
    path.write_text("\n".join([names, *BODY, *notes, ""]))
    found = read(path)
    is_it(found)
    assert "of notes below the numbers left out, the first" in found.read


def test_the_last_rows_without_a_time_are_no_figures(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    untimed = [f",{row.partition(',')[2]}" for row in BODY[-3:]]
    path.write_text("\n".join([NAMES, *BODY[:-3], *untimed, "Mean,50.1,6.2", ""]))
    assert f"line {N - 1}: the time is missing" in asked(path)


@pytest.mark.parametrize("names", [NAMES, OWN])
def test_other_words_below_and_sums_between_are_refused(tmp_path: Path, names: str) -> None:
    path = tmp_path / "a.csv"
    path.write_text("\n".join([names, *BODY, "Calibrated,50,6", ""]))
    assert f"line {N + 2}" in asked(path)
    path.write_text("\n".join([names, *BODY[:150], "Mean,50,6", *BODY[150:], ""]))
    assert "line 152" in asked(path)


def test_a_column_of_words_is_not_taken_for_figures(tmp_path: Path) -> None:
    words = ["min" if i % 100 < 50 else "max" for i in range(N)]
    path = tmp_path / "a.csv"
    rows = [f"{w},{row}" for w, row in zip(words, BODY, strict=True)]
    path.write_text("\n".join([f"Range,{NAMES}", *rows, ""]))
    found = read(path)
    is_it(found)
    assert "sums" not in found.read


def test_names_over_merged_fields_complete_those_below(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    head = ["Time (s),Drive,,Sensor,", ",Voltage (V),Current (mA),Displacement (um),Force (N)"]
    rows = [f"{t:g},{u},1.5,{y},0.2" for t, u, y in zip(T, U, Y, strict=True)]
    path.write_text("\n".join([*head, *rows, ""]))
    found = read(path)
    is_it(found)
    assert "t from 'Time (s)'" in found.read
    head[0] = "Operator,me"  # names no column
    path.write_text("\n".join([*head, *rows, ""]))
    assert "column 0 rises evenly" in asked(path)


def test_a_spreadsheet_of_lines_is_to_be_transposed(tmp_path: Path) -> None:
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    for name, values in zip(NAMES.split(","), (T, U, Y), strict=True):
        book.active.append([name, *values.tolist()])
    book.save(tmp_path / "a.xlsx")
    assert "transpose the file" in asked(tmp_path / "a.xlsx")
