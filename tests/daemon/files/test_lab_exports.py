"""Files as the programs and instruments of a laboratory write them: dates, clocks over two columns,
words for no value, units and factors that are stated elsewhere. What a reader understands without
doubt is read; numbers of another scale are never read in silence."""

import json
from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from tests.rigs.foreign_files import asked, read

from dehyst.models.recording import Recording

N = 400
T = np.round(0.005 * np.arange(N), 3)
U = np.round(75 + 70 * np.sin(2 * np.pi * 1.5 * T), 3)
Y = np.round(3 + 0.1 * U + 0.9 * np.cos(2 * np.pi * 1.5 * T), 4)
BEGIN = datetime(2025, 3, 14, 14, 7, 58, 900000)
HEAD = "Time (s);Voltage (V);Position (um)"


def is_it(found: Recording) -> None:
    assert found.displacement is not None
    assert found.drive_unit == "v"
    assert found.displacement_unit in ("um", "nm")
    um = 1e3 if found.displacement_unit == "nm" else 1.0
    np.testing.assert_allclose(found.t_s - found.t_s[0], T, atol=2e-5)
    np.testing.assert_allclose(found.drive, U, atol=1e-6)
    np.testing.assert_allclose(found.displacement / um, Y, atol=1e-6)


def write(path: Path, head: str, row: Callable[[int], str], end: str = "") -> Path:
    text = "".join(f"{line}\n" for line in (head, *map(row, range(N))))
    path.write_bytes((text + end).encode())
    return path


def plain(i: int) -> str:
    return f"{T[i]};{U[i]};{Y[i]}"


def point(ms: str) -> Callable[[datetime], str]:
    return lambda m: m.strftime(ms).replace("{ms}", f"{m.microsecond // 1000:03d}")


DATES = {
    "two digits of the year": point("%m/%d/%y %H:%M:%S.{ms}"),
    "a comma behind the date": point("%m/%d/%Y, %I:%M:%S.{ms} %p"),
    "German with a comma": point("%d.%m.%Y, %H:%M:%S.{ms}"),
    "Dewesoft": lambda m: f"{m.day}.{m.month}.{m.year} {m:%H:%M:%S.%f}",
    "points, the year first": point("%Y.%m.%d %H:%M:%S.{ms}"),
    "dashes, the day first": point("%d-%m-%Y %H:%M:%S.{ms}"),
    "C": point("%a %b %d %H:%M:%S.{ms} %Y"),
    "American": point("%b %d, %Y %H:%M:%S.{ms}"),
    "American in full": point("%A, %B %d, %Y %H:%M:%S.{ms}"),
    "capitals": lambda m: f"{m:%d %b %Y %H:%M:%S.%f}".upper(),
    "the command date": point("%a %b %d %H:%M:%S.{ms} UTC %Y"),
    "in full": point("%d %B %Y %H:%M:%S.{ms}"),
    "ISO without marks": point("%Y%m%dT%H%M%S.{ms}Z"),
    "a zone apart": point("%Y-%m-%d %H:%M:%S.{ms} +0100"),
    "a named zone": point("%Y-%m-%d %H:%M:%S.{ms} CET"),
    "an e-mail": point("%a, %d %b %Y %H:%M:%S.{ms} +0000"),
}


@pytest.mark.parametrize("kind", DATES)
def test_dates_of_many_programs(tmp_path: Path, kind: str) -> None:
    def row(i: int) -> str:
        moment = BEGIN + timedelta(milliseconds=5 * i)
        return f'"{DATES[kind](moment)}";{U[i]};{Y[i]}'

    is_it(read(write(tmp_path / "a.csv", "Timestamp;Voltage (V);Position (um)", row)))


def test_two_digits_at_both_ends_of_a_date_with_dashes_are_no_date(tmp_path: Path) -> None:
    """Of "25-03-14" either end may be the year: read as the other, midnight would be a year."""

    def row(i: int) -> str:
        return f"{BEGIN + timedelta(milliseconds=5 * i):%y-%m-%d %H:%M:%S.%f};{U[i]};{Y[i]}"

    asked(write(tmp_path / "a.csv", "Timestamp;Voltage (V);Position (um)", row))


@pytest.mark.parametrize(
    "names", ["header.stamp.sec;header.stamp.nanosec", "tv_sec;tv_nsec", "stamp_secs;stamp_nsecs"]
)
def test_seconds_and_their_digits_of_one_name_are_joined(tmp_path: Path, names: str) -> None:
    def row(i: int) -> str:
        ms = 900 + 5 * i
        return f"{1741961278 + ms // 1000};{ms % 1000 * 10**6};{U[i]};{Y[i]}"

    is_it(read(write(tmp_path / "a.csv", f"{names};Voltage (V);Position (um)", row)))


def test_a_latency_of_another_name_is_not_joined(tmp_path: Path) -> None:
    head = "stamp_sec;delay_nsec;Voltage (V);Position (um)"
    path = write(tmp_path / "a.csv", head, lambda i: f"{i};{5 * i};{U[i]};{Y[i]}")
    assert "which is the time" in asked(path)


def test_a_date_next_to_the_elapsed_time_is_one_time(tmp_path: Path) -> None:
    def row(i: int, faster: float = 1.0) -> str:
        moment = BEGIN + timedelta(milliseconds=5 * i * faster)
        return f"{moment.isoformat(timespec='milliseconds')};{plain(i)}"

    path = write(tmp_path / "a.csv", f"Timestamp;Elapsed (s);{HEAD.partition(';')[2]}", row)
    found = read(path)
    is_it(found)
    assert "one time in 'Timestamp' and 'Elapsed (s)'" in found.read
    write(path, f"Timestamp;Elapsed (s);{HEAD.partition(';')[2]}", lambda i: row(i, 2.0))
    assert "which is the time" in asked(path)
    head = "Time U (s);Voltage (V);Time Y (s);Position (um)"
    write(path, head, lambda i: f"{T[i]};{U[i]};{T[i] + 1.7e9:.3f};{Y[i]}")
    assert "which is the time" in asked(path)  # each may have its own


@pytest.mark.parametrize("scale", [1.0, 1e3])
@pytest.mark.parametrize("heading", ["unix_time", "Epoch", "time since unix epoch"])
def test_times_since_1970_are_in_the_unit_of_their_size(
    tmp_path: Path, heading: str, scale: float
) -> None:
    def row(i: int) -> str:
        return f"{scale * (1741961278.9 + T[i]):.3f};{U[i]};{Y[i]}"

    is_it(read(write(tmp_path / "a.csv", f"{heading};Voltage (V);Position (um)", row)))
    other = write(tmp_path / "b.csv", "timestamp;Voltage (V);Position (um)", row)
    if scale > 1.0:  # a counter of microseconds since the start may be as large
        assert "add --time-unit s, ms or us" in asked(other)


@pytest.mark.parametrize("clock", ["14:07:{}.{}", "{}.{}"])
def test_fractions_without_their_zeros_are_asked_for(tmp_path: Path, clock: str) -> None:
    def row(i: int) -> str:
        return f"{clock.format(10 + 5 * i // 1000, 5 * i % 1000)};{U[i]};{Y[i]}"

    path = write(tmp_path / "a.csv", "Time;Voltage (V);Position (um)", row)
    assert "fractions without their zeros" in asked(path)
    is_it(read(path, rate_hz=200.0))


@pytest.mark.parametrize(
    "word",
    [
        "missing",
        "OVRFLW",
        "+OVER",
        "-Overload",
        "UnderRange",
        "OFL",
        "No Data",
        "UNDEF",
        "\\N",
        ".",
    ],
)
def test_words_of_instruments_for_no_value(tmp_path: Path, word: str) -> None:
    path = write(
        tmp_path / "a.csv", HEAD, lambda i: plain(i) if i % 99 else f"{T[i]};{U[i]};{word}"
    )
    found = read(path)
    assert found.displacement is not None
    assert np.isnan(found.displacement).sum() == 5


FACTORS = [
    "Name;Time;Voltage;Position\nFactor;1;20;1",
    "# channel 1: Voltage, slope 20, offset 0",
    "HV divider 1:1000",
    "Verstärkung;10",
    "Amplification: 20x",
    "# Attenuation: 20 dB",
    "# Monitor output: V/20",
]


@pytest.mark.parametrize("above", FACTORS)
def test_a_factor_above_the_numbers_is_asked_for_in_any_words(tmp_path: Path, above: str) -> None:
    path = write(tmp_path / "a.csv", f"{above}\n{HEAD}", plain)
    assert "which is not applied" in asked(path)
    is_it(read(path, drive_unit="v", unit="um"))


@pytest.mark.parametrize("above", ["Quality factor: 30", "Slope: 1", "# Fill factor 2"])
def test_other_factors_are_notes(tmp_path: Path, above: str) -> None:
    is_it(read(write(tmp_path / "a.csv", f"{above}\n{HEAD}", plain)))


@pytest.mark.parametrize("above", ["Times unit: ms", "X unit;us", "# times in milliseconds"])
def test_a_unit_of_time_elsewhere_is_asked_for(tmp_path: Path, above: str) -> None:
    names = f"{above}\nTime;Voltage;Position (um)"
    path = write(tmp_path / "a.csv", names, plain)
    assert "the unit of 'Time' is not given" in asked(path)
    is_it(read(path, time_unit="s"))
    is_it(read(write(path, f"Pause: 5 ms\n{names.partition(chr(10))[2]}", plain)))
    is_it(read(write(path, f"{above}\n{HEAD}", plain)))  # its heading gives the unit


def test_one_unit_in_words_is_that_of_no_column(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", "Unit: nm\nTime;Voltage;Displacement", plain)
    assert "'Time' (nm)" not in asked(path)


@pytest.mark.parametrize(
    "drive", ["dac_code", "Drive raw", "Voltage_norm", "U_rel", "Drive_pct", "Voltage bits"]
)
def test_a_drive_of_codes_or_parts_is_not_taken_as_volts(tmp_path: Path, drive: str) -> None:
    path = write(tmp_path / "a.csv", f"Time (s);{drive};Position (um)", plain)
    assert "add --drive-unit v, mv or kv, or counts" in asked(path)
    is_it(read(path, drive_unit="v"))
    is_it(read(write(path, f"Time (s);{drive} (V);Position (um)", plain)))


def test_millivolts_in_words_are_asked_for(tmp_path: Path) -> None:
    above = "voltages are in millivolts\nTime (s);Voltage;Position (um)"
    assert "--drive-unit" in asked(write(tmp_path / "a.csv", above, plain))


def test_times_of_day_of_a_spreadsheet_are_not_taken_as_seconds(tmp_path: Path) -> None:
    def row(i: int) -> str:
        return f"{0.588 + 20 * T[i] / 86400:.12f};{U[i]};{Y[i]}"

    path = write(tmp_path / "a.csv", "Time;Voltage (V);Position (um)", row)
    assert "if these are days" in asked(path)
    found = read(write(path, "Time (days);Voltage (V);Position (um)", row))
    assert found.t_s[-1] - found.t_s[0] == pytest.approx(20 * T[-1], rel=1e-6)


@pytest.mark.parametrize(
    "heading",
    [
        "Displacement field, Z component (um), Point: 5",
        "Position (um), Channel 2",
        "Position (unit: um)",
        "Position [Unit=um]",
    ],
)
def test_a_number_or_a_label_next_to_the_unit(tmp_path: Path, heading: str) -> None:
    is_it(read(write(tmp_path / "a.csv", f"Time (s);Voltage (V);{heading}", plain)))


@pytest.mark.parametrize("heading", ["Position (um), scale: 5", "Position (um): 5"])
def test_a_factor_behind_the_unit_is_asked_for(tmp_path: Path, heading: str) -> None:
    path = write(tmp_path / "a.csv", f"Time (s);Voltage (V);{heading}", plain)
    assert "add --unit" in asked(path)


@pytest.mark.parametrize("heading", ["Position_um_per_V", "Position (um per V)"])
def test_a_quotient_in_words_is_asked_for(tmp_path: Path, heading: str) -> None:
    path = write(tmp_path / "a.csv", f"Time (s);Voltage (V);{heading}", plain)
    assert "per_V'" in asked(path).replace(" ", "_")


@pytest.mark.parametrize("heading", ["millis", "millis()", "Time (msec.)", "time_millisecs"])
def test_milliseconds_as_programs_call_them(tmp_path: Path, heading: str) -> None:
    def row(i: int) -> str:
        return f"{5 * i};{U[i]};{Y[i]}"

    is_it(read(write(tmp_path / "a.csv", f"{heading};Voltage (V);Position (um)", row)))


@pytest.mark.parametrize(
    "names",
    [
        "Tijd;Spanning;Verplaatsing",
        "Tid;Spänning;Förskjutning",
        "Tempo;Tensione;Spostamento",
        "Tiempo;Voltaje;Desplazamiento",
        "Tempo;Tensão;Deslocamento",
        "Aika;Jännite;Siirtymä",
        "Temps;Tension;Déplacement",
        "Time;Control Voltage of OutputSignal1;Actual Position of Axis1",
    ],
)
def test_names_in_further_languages(tmp_path: Path, names: str) -> None:
    path = write(tmp_path / "a.csv", names, plain)
    assert asked(path).endswith("add --unit um, nm, m, v, counts, mrad or urad")
    is_it(read(path, unit="um"))


def test_points_that_another_column_shows_to_be_of_thousands(tmp_path: Path) -> None:
    def row(i: int) -> str:
        volts, nm = f"{1e3 * (U[i]):,.0f}", f"{1e3 * Y[i]:,.1f}"
        return f"{5 * i};{volts.replace(',', '.')};{nm.translate({44: '.', 46: ','})}"

    found = read(write(tmp_path / "a.csv", "Zeit (ms);Spannung (mV);Position (nm)", row))
    is_it(found)
    assert "decimal commas" in found.read


@pytest.mark.processes
def test_numbers_that_are_kept_as_texts(tmp_path: Path) -> None:
    def table(mark: str) -> str:
        fields = [
            (f"{t}", f"{u}".replace(".", mark), f"{y}") for t, u, y in zip(T, U, Y, strict=True)
        ]
        names = ("Time (s)", "Voltage (V)", "Position (um)")
        return json.dumps([dict(zip(names, row, strict=True)) for row in fields])

    path = tmp_path / "a.json"
    path.write_text(table("."))
    is_it(read(path))
    path.write_text(table(","))
    assert "without numbers and left out: Voltage (V)" in asked(path)


def test_joined_files_and_fields_kept_as_text(tmp_path: Path) -> None:
    """The mark of UTF-8 is inside a file that was joined of two; ="..." keeps a field as text."""
    lines = [HEAD, *map(plain, range(200)), HEAD, *map(plain, range(200, N))]
    path = tmp_path / "a.csv"
    path.write_text(
        "\n".join(f"\ufeff{ln}" if ln == HEAD else ln for ln in lines), encoding="utf-8"
    )
    is_it(read(path))
    kept = HEAD.replace(";", ",")
    is_it(read(write(path, kept, lambda i: f'="{T[i]}",="{U[i]}",="{Y[i]}"')))
