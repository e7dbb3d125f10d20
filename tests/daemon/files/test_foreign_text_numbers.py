"""Numbers in text of other programs, in every habit of writing them: what is read equals what was
written, and what can be read in two ways is refused."""

import gzip
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dehyst.daemon.files.csv_table import line_of_row
from dehyst.daemon.files.foreign.text import understand_text
from dehyst.daemon.files.recordings import read_recording
from dehyst.models.errors import BadRecording

Forms = Sequence[Callable[[float], str]]
Columns = Sequence[np.ndarray[Any, Any]]
COUNT = np.arange(300)
T = np.round(COUNT * 1e-3, 3)
U = np.round(50 + 40 * np.sin(2 * np.pi * COUNT / 97) * (1 - COUNT / 900), 3)
Y = np.round(0.1 * U + 0.4 * np.sin(2 * np.pi * COUNT / 97 - 0.4), 3)
HEAD = ("Zeit (s)", "Spannung (V)", "Weg (um)")
COLUMNS = (T, U, Y)


def point(value: float, digits: int = 3) -> str:
    return f"{value:.{digits}f}"


def comma(value: float, digits: int = 3) -> str:
    return point(value, digits).replace(".", ",")


def quoted(value: float) -> str:
    return f'"{comma(value)}"'


def german(value: float) -> str:
    return f"{value:,.0f}".replace(",", ".")


def us(value: float) -> str:
    return f"{value:,.2f}"


def swiss(value: float) -> str:
    return us(value).replace(",", "'")


def french(value: float) -> str:
    return us(value).replace(",", "\u202f").replace(".", ",")


def french_wide(value: float) -> str:
    return us(value).replace(",", "\xa0").replace(".", ",")


def write(path: Path, *rows: str) -> Path:
    data = ("\n".join(rows) + "\n").encode()
    path.write_bytes(gzip.compress(data) if path.suffix.lower() == ".gz" else data)
    return path


def table(
    separator: str, forms: Forms, columns: Columns = COLUMNS, head: tuple[str, ...] = HEAD
) -> list[str]:
    rows = zip(*columns, strict=True)
    body = [separator.join(form(v) for form, v in zip(forms, r, strict=True)) for r in rows]
    return [separator.join(head), *body]


def holds(path: Path, columns: Columns = COLUMNS) -> str:
    found = read_recording(path, need_displacement=True)
    assert found.displacement is not None
    for read, wrote in zip((found.t_s, found.drive, found.displacement), columns, strict=True):
        np.testing.assert_allclose(read, wrote, rtol=1e-12)
    return found.read


def refused(path: Path) -> str:
    with pytest.raises(BadRecording) as error:
        read_recording(path, need_displacement=True)
    assert "\n" not in str(error.value)
    return str(error.value)


OWN = ("t_s", "u_v", "y_um")
MILLISECONDS = ("Zeit (ms)", *HEAD[1:])
SHIFTED = (T, U + 5.0, Y + 1.0)
"""No drive or displacement begins with 0: only the times show the decimal comma."""
THREE = {
    "semicolons.csv": table(";", (comma,) * 3),
    "tabs.txt": table("\t", (comma,) * 3),
    "own.csv": table(";", (comma,) * 3, head=OWN),
    "blanks.dat": table("  ", (comma,) * 3, head=OWN),
    "quoted.csv": table(",", (quoted,) * 3),
    "quoted_own.csv": table(",", (quoted,) * 3, head=OWN),
    "lvm.lvm": ["LabVIEW Measurement", "Separator\tTab", "Decimal_Separator\t,", "***End***",
                *table("\t", (comma,) * 3, head=("X_Value", *HEAD[1:]))],
}  # fmt: skip


@pytest.mark.parametrize("name", THREE)
def test_decimal_commas_with_three_decimals(tmp_path: Path, name: str) -> None:
    assert "decimal commas" in holds(write(tmp_path / name, *THREE[name]))


def test_whole_milliseconds_beside_decimal_commas(tmp_path: Path) -> None:
    columns = (1e3 * T, *SHIFTED[1:])
    rows = table(";", ("{:.0f}".format, comma, comma), columns, MILLISECONDS)
    holds(write(tmp_path / "a.csv", *rows), SHIFTED)
    said = refused(write(tmp_path / "a.txt", *(row.replace(";", "\t") for row in rows)))
    assert "may have a decimal comma" in said
    assert "write it with a decimal point" in said


def test_points_and_commas_that_tell_nothing_are_refused(tmp_path: Path) -> None:
    """Three digits behind every point and every comma: either may be the decimal mark."""
    columns = (T + 1.0, U + 100.0, np.round(10 * U) + 1000.0)
    for separator in "\t;":
        rows = table(separator, (point, point, "{:,.0f}".format), columns)
        assert "may have a decimal comma" in refused(write(tmp_path / "a.txt", *rows))


def test_a_comma_that_comes_late(tmp_path: Path) -> None:
    """Whole numbers as far as the layout is looked for, then decimal commas."""
    t = np.arange(2500.0)
    u = np.where(t < 2400.0, 10.0, 12.586)
    y = np.where(t < 2450.0, 1.0, 1.453)

    def short(value: float) -> str:
        return f"{value:g}".replace(".", ",")

    rows = table("\t", (short,) * 3, (t, u, y), ("Zeit (ms)", *HEAD[1:]))
    rows.append("2500\t0,5\t1")
    columns = (np.append(t, 2500.0) / 1e3, np.append(u, 0.5), np.append(y, 1.0))
    holds(write(tmp_path / "a.txt", *rows), columns)


@pytest.mark.processes
def test_decimal_commas_in_the_texts_of_a_sheet(tmp_path: Path) -> None:
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    for row in table(";", (comma,) * 3):
        book.active.append(row.split(";"))
    book.save(tmp_path / "a.xlsx")
    assert "decimal commas" in holds(tmp_path / "a.xlsx")


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    values=st.lists(st.tuples(*[st.floats(-9e5, 9e5)] * 2), min_size=3, max_size=30),
    separator=st.sampled_from([";", "\t", " ", ","]),
    decimal=st.sampled_from(".,"),
    digits=st.integers(1, 5),
)
def test_every_separator_with_every_decimal(
    values: list[tuple[float, float]], separator: str, decimal: str, digits: int
) -> None:
    """The times, of four decimals, show the decimal mark."""
    rounded = [(round(a, digits), round(b, digits)) for a, b in values]
    mark = '"' if separator == decimal else ""
    rows = [
        separator.join(mark + cell.replace(".", decimal) + mark for cell in cells)
        for i, (a, b) in enumerate(rounded)
        for cells in [(point(1e-4 * i, 4), point(a, digits), point(b, digits))]
    ]
    found = understand_text("a.csv", "\n".join([separator.join(OWN), *rows]))
    assert [c.heading for c in found.columns] == list(OWN)
    np.testing.assert_array_equal(found.columns[1].values, [a for a, _ in rounded])
    np.testing.assert_array_equal(found.columns[2].values, [b for _, b in rounded])


LARGE = (T, U, np.round(40 * U + 10.0))
FRACTION = (T, U, np.round(40 * U + 10.25, 2))
THOUSANDS = {
    "german": (";", (comma, comma, german), LARGE),
    "US": ("\t", (point, point, us), FRACTION),
    "US, whole": ("\t", (point, point, "{:,.0f}".format), LARGE),
    "Swiss": (",", (point, point, swiss), FRACTION),
    "French": (";", (comma, comma, french), FRACTION),
    "French, tabs": ("\t", (comma, comma, french_wide), FRACTION),
}  # fmt: skip


@pytest.mark.parametrize("habit", THOUSANDS)
def test_thousands_set_apart(tmp_path: Path, habit: str) -> None:
    """Numbers on both sides of a thousand: those below it have no mark."""
    separator, forms, columns = THOUSANDS[habit]
    assert columns[2].min() < 1000.0 < columns[2].max()
    holds(write(tmp_path / "a.csv", *table(separator, forms, columns)), columns)


MISSING = [
    "1.#IND", "-1.#IND", "1.#QNAN", "1.#INF", "-1.#INF00", "nan(ind)", "-nan(ind)", "<NA>", "NaT",
    "#DIV/0!", "#VALUE!", "#N/A",
]  # fmt: skip


@pytest.mark.parametrize("word", MISSING)
@pytest.mark.parametrize("head", [OWN, HEAD])
def test_words_for_a_missing_number(tmp_path: Path, word: str, head: tuple[str, ...]) -> None:
    """In the last column, and in the first of a line, which then is no comment."""
    rows = table(",", (point,) * 3, head=head)
    rows[101] = rows[101].rpartition(",")[0] + f",{word}"
    y = Y.copy()
    y[100] = np.nan
    found = read_recording(write(tmp_path / "a.csv", *rows), need_displacement=True)
    np.testing.assert_array_equal(found.displacement, y)
    swapped = [",".join(reversed(row.split(","))) for row in rows]
    if head == HEAD:
        again = read_recording(write(tmp_path / "b.csv", *swapped), need_displacement=True)
        np.testing.assert_array_equal(again.displacement, y)


def test_a_comment_begins_at_the_line_or_after_a_blank(tmp_path: Path) -> None:
    rows = table(",", (point,) * 3, head=OWN)
    rows[5] += " # touched the table"
    rows.insert(9, "# 0.5,1,2")
    assert holds(write(tmp_path / "a.csv", *rows)) == ""
    rows[20] += "#1"
    assert f"line 21: y_um is '{rows[20].split(',')[2]}'" in refused(
        write(tmp_path / "a.csv", *rows)
    )


@pytest.mark.parametrize("separator", ["\t", ";", ",", " "])
def test_a_row_with_a_field_too_many_is_refused(tmp_path: Path, separator: str) -> None:
    head = ("time_s", "voltage_v", "displacement_um")
    rows = table(separator, (point,) * 3, head=head)
    for at in (1, 101, 300):
        for more in ([rows[at], "7.777"], [rows[at], rows[at]]):
            broken = [*rows[:at], separator.join(more), *rows[at + 1 :]]
            said = refused(write(tmp_path / "a.txt", *broken))
            size = len(broken[at].split(separator))
            assert f"line {at + 1} has {size} fields, the headings are 3" in said
    empty = [*rows[:101], rows[101] + 2 * separator, *rows[102:]]
    holds(write(tmp_path / "a.txt", *empty))


def test_headings_in_another_order_are_not_passed_over(tmp_path: Path) -> None:
    rows = table("\t", (point,) * 3)
    again = [*rows[:150], rows[0], *rows[150:]]
    assert "1 line of text" in holds(write(tmp_path / "a.txt", *again))
    holds(write(tmp_path / "a.txt", *rows[:150], "# set 50 V\tmoved by 5 um", *rows[150:]))
    for other in (
        "\t".join((HEAD[0], HEAD[2], HEAD[1])),
        "# " + "\t".join((HEAD[0], HEAD[2], HEAD[1])),
        "t [ms]\tU [mV]\tx [nm]",
    ):
        said = refused(write(tmp_path / "a.txt", *rows[:150], other, *rows[150:]))
        assert "line 151 holds other headings" in said
    names = " ".join(("time_s", "voltage_v", "displacement_um"))
    exchanged = " ".join(("time_s", "displacement_um", "voltage_v"))
    body = [row.replace("\t", " ") for row in rows[1:]]
    said = refused(write(tmp_path / "a.dat", names, *body[:9], exchanged, *body[9:]))
    assert "line 11 holds other headings" in said


RATES = [
    'Sample rate,"1,000"', "Sample rate [MHz],0.001", "Sampling frequency,0.001 MHz",
    "Sampling interval (ns),1000000", "Sampling interval,1000,us", "Sample rate,1000 Hz",
    "Sample_rate [kS/s],1", "Sample rate,1e3", "fs,0.000001 GHz", "dt,1 ms", "dt,0.001",
    "Increment,5 V\nSample rate,1000 Hz", "Sampling period / ms,1", 'dt,"0,001"',
]  # fmt: skip


@pytest.mark.parametrize("stated", RATES)
def test_a_stated_rate_in_its_unit(tmp_path: Path, stated: str) -> None:
    holds(write(tmp_path / "a.csv", stated, *table(",", (point,) * 2, (U, Y), HEAD[1:])))


def test_a_stated_period_of_a_minute(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", "dt,1 min", *table(",", (point,) * 2, (U, Y), HEAD[1:]))
    holds(path, (60.0 * COUNT, U, Y))


@pytest.mark.parametrize(
    "stated",
    ["Sample rate,1 furlong", "Increment,5 V", "Sample rate [rpm],1000", "dt (ms),1 s"],
)
def test_a_rate_in_no_known_unit_is_asked_for(tmp_path: Path, stated: str) -> None:
    path = write(tmp_path / "a.csv", stated, *table(",", (point,) * 2, (U, Y), HEAD[1:]))
    assert "add --rate HZ" in refused(path)


@pytest.mark.parametrize("head", [OWN, HEAD])
def test_a_packed_file_named_in_capitals(tmp_path: Path, head: tuple[str, ...]) -> None:
    rows = table(",", (point,) * 3, head=head)
    holds(write(tmp_path / "RUN.CSV.GZ", *rows))
    assert line_of_row(tmp_path / "RUN.CSV.GZ", 6) == 8
