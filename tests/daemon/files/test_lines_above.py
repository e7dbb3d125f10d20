"""The lines that programs and instruments write above the numbers, or in front of them: metadata
next to the names, channels with labels, ticks of Windows, a boot message, the time of a monitor."""

from collections.abc import Sequence
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from tests.rigs.foreign_files import asked, read

from dehyst.models.recording import Recording

N = 400
T = np.round(0.005 * np.arange(N), 3)
U = np.round(50 + 40 * np.sin(2 * np.pi * 1.5 * T), 3)
Y = np.round(3 + 0.06 * U + 0.3 * np.cos(2 * np.pi * 1.5 * T), 4)
WANTED = np.round(3 + 0.06 * U, 4)
BEGIN = datetime(2024, 5, 2, 10, 11, 12)


def is_it(found: Recording, least: float = 1e-9) -> None:
    assert found.displacement is not None
    assert (found.drive_unit, found.displacement_unit) == ("v", "um")
    np.testing.assert_allclose(found.t_s - found.t_s[0], T, atol=least)
    np.testing.assert_allclose(found.drive, U, rtol=1e-9)
    np.testing.assert_allclose(found.displacement, Y, rtol=1e-9)


def write(path: Path, head: Sequence[str], *columns: Sequence[object], mark: str = ",") -> Path:
    rows = (mark.join(map(str, row)) for row in zip(*columns, strict=True))
    path.write_text("".join(f"{line}\n" for line in (*head, *rows)), encoding="utf-8")
    return path


@pytest.mark.parametrize("blocks", [("Displacement", "Gain", "ADC"), ("Weg", "Volt", "Sensor")])
def test_metadata_below_the_names_is_not_taken_for_them(
    tmp_path: Path, blocks: Sequence[str]
) -> None:
    """As Simulink's data inspector writes it. The block of the reference is called displacement."""
    head = [
        "time,Reference,Drive,Position", ",".join(["Type: double"] * 4),
        "Unit: s,Unit: um,Unit: V,Unit: um", ",Interp: zoh,Interp: zoh,Interp: linear",
        "," + ",".join(f"BlockPath: stage/{block}" for block in blocks),
        ",PortIndex: 1,PortIndex: 1,PortIndex: 1",
    ]  # fmt: skip
    found = read(write(tmp_path / "a.csv", head, T, WANTED, U, Y))
    is_it(found)
    np.testing.assert_allclose(found.channels["target_um"], WANTED)


def test_names_that_begin_with_their_device_are_names(tmp_path: Path) -> None:
    head = ["Rig: Time (s),Rig: Voltage (V),Rig: Position (um)"]
    is_it(read(write(tmp_path / "a.csv", head, T, U, Y)))


def test_a_line_that_is_labelled_as_the_names_goes_before_other_words(tmp_path: Path) -> None:
    head = [
        "Kanalname\tZeit\tSollwert\tPiezospannung\tWeg", "Datum" + 4 * "\t02.05.2024",
        "Einheit\ts\tum\tV\tum",
        "Sensortyp\t\tWeg\tSpannung\tSpannung", "Abtastrate\t200 Hz\t200 Hz\t200 Hz\t200 Hz",
    ]  # fmt: skip
    is_it(read(write(tmp_path / "a.asc", head, [""] * N, T, WANTED, U, Y, mark="\t")))


@pytest.mark.parametrize("ticks", [False, True])
@pytest.mark.parametrize("mark", [",", "\t"])
def test_twincat_channels_with_one_column_of_times(tmp_path: Path, mark: str, ticks: bool) -> None:
    """ticks: of 100 ns since 1601, as Windows counts. An IndexOffset is an address."""
    rows = {
        "Name": ("fDrive", "fGauge"), "Data-Type": ("REAL64", "REAL64"),
        "SampleTime[ms]": ("5", "5"), "IndexOffset": ("385040", "385048"), "Offset": ("0", "0"),
        "ScaleFactor": ("1", "1"), "Unit": ("V (Voltage)", "um (Length)"), "Unit Offset": "00",
    }  # fmt: skip
    above = [mark.join(["Name", "Scope"]), "", *(mark.join([k, *v]) for k, v in rows.items()), ""]
    times = [132959733843760000 + 50_000 * i if ticks else 5 * i for i in range(N)]
    is_it(read(write(tmp_path / "a.csv", above, times, U, Y, mark=mark)))
    other = [line.replace(f"ScaleFactor{mark}1", f"ScaleFactor{mark}10") for line in above]
    assert "Scale factor (ScaleFactor)" in asked(
        write(tmp_path / "b.csv", other, times, U, Y, mark=mark)
    )


@pytest.mark.parametrize("volts", ["Voltage of output chan1", "Control Voltage of Output Chan 1"])
@pytest.mark.parametrize("position", ["Current Position of axis1", "Actual Position of Axis 1"])
def test_the_voltage_of_an_output_is_the_drive(tmp_path: Path, volts: str, position: str) -> None:
    head = ["# VERSION = 1", "# SAMPLE_TIME = 0.005", f"# NAME0 = {volts}", f"# NAME1 = {position}"]
    is_it(read(write(tmp_path / "a.dat", [*head, "# END_HEADER"], U, Y, mark=" "), unit="um"))


@pytest.mark.parametrize("named", [False, True])
def test_the_time_that_a_monitor_writes_in_front_is_that_of_the_row(
    tmp_path: Path, named: bool
) -> None:
    stamps = [f"{BEGIN + timedelta(milliseconds=5 * i):%H:%M:%S.%f}"[:-3] for i in range(N)]
    rows = [f"{stamp} -> {u},{y}" for stamp, u, y in zip(stamps, U, Y, strict=True)]
    path = write(tmp_path / "a.txt", [f"{stamps[0]} -> voltage,position"] * named, rows)
    is_it(read(path, "" if named else "u=1,y=2", drive_unit="v", unit="um"), 1e-6)


def test_a_boot_message_is_no_row(tmp_path: Path) -> None:
    boot = ["ets Jun  8 2016 00:22:57", "rst:0x1 (POWERON_RESET),boot:0x13", "logger v1.2 ready"]
    rows = [f"t_ms={1e3 * t:.0f} U={u}V z={y}um" for t, u, y in zip(T, U, Y, strict=True)]
    is_it(read(write(tmp_path / "a.log", boot, rows), "u=U,y=z"))


def test_channels_with_their_unit_and_the_period_next_to_them(tmp_path: Path) -> None:
    head = ["CH1V,CH2V,t0 =-1.000000e+00,tInc = 5.000000e-03,"]
    found = read(write(tmp_path / "a.csv", head, U, Y, [""] * N, [""] * N), "u=CH1V,y=CH2V")
    assert (found.drive_unit, found.displacement_unit) == ("v", "v")
    np.testing.assert_allclose(found.t_s - found.t_s[0], T, atol=1e-9)


def test_the_offset_of_a_channel_is_no_part_of_its_name(tmp_path: Path) -> None:
    head = ["Vertical Scale,CH1: 20.0,CH2: 2.0", "Vertical Offset,CH1:-50.0,CH2:-4.0"]
    path = write(tmp_path / "a.csv", [*head, "Second,Volt,Volt"], T, U, Y)
    assert "--columns u=CH1,y=CH2" in asked(path)
    np.testing.assert_allclose(read(path, "u=CH1,y=CH2").drive, U)


def test_the_converter_of_a_scope_counts(tmp_path: Path) -> None:
    """GW Instek writes whole numbers of the converter in its fast mode, and volts above them."""
    of = {"Memory Length": "400", "Source": "CH1", "Vertical Units": "V", "Mode": "Fast"}
    of |= {"Sampling Period": "5.0E-03"}
    head = [f"{k},{v},{k},{v.replace('CH1', 'CH2')}," for k, v in of.items()]
    counts = [np.round(3 * U).astype(int), np.round(10 * Y).astype(int)]
    path = write(tmp_path / "a.csv", head, counts[0], [""] * N, counts[1], [""] * N)
    assert 'u="CH1 [counts]"' in asked(path)
    found = read(path, "u=CH1,y=CH2")
    assert (found.drive_unit, found.displacement_unit) == ("counts", "counts")


def test_counts_of_a_channel_are_not_advised_next_to_it(tmp_path: Path) -> None:
    in_counts = [np.round(25 * x - 100).astype(int) for x in (U, Y)]
    path = write(tmp_path / "a.csv", ["time,ch1,ch2,ch1s,ch2s"], T, U, Y, *in_counts)
    said = asked(path)
    assert "add --columns u=ch1;" in said
    assert said.endswith("add --columns y=ch2")


def test_a_clock_next_to_milliseconds_since_1970_is_the_same_time(tmp_path: Path) -> None:
    clock = [f"{BEGIN + timedelta(hours=2, seconds=float(t)):%H:%M:%S}" for t in T]
    ms = [i * 5 % 1000 for i in range(N)]
    since = [round(BEGIN.timestamp() * 1000) + 5 * i for i in range(N)]
    head = ["Nummer;Zeitcode;Uhrzeit;ms;Spannung;Weg", ";ms;;ms;V;um"]
    found = read(write(tmp_path / "a.csv", head, range(N), since, clock, ms, U, Y, mark=";"))
    is_it(found, 1e-6)
    assert "one time in 'Zeitcode' (ms) and 'Uhrzeit + ms'" in found.read


def test_drive_and_displacement_in_rows_of_their_own_are_refused_as_such(tmp_path: Path) -> None:
    u, y = ([f"{x}" if i % 2 == k else "" for i, x in enumerate(v)] for k, v in enumerate((U, Y)))
    said = asked(write(tmp_path / "a.csv", ["time (s),drive (V),position (um)"], T, u, y))
    assert "no row has both 'drive (V)' and 'position (um)'" in said
    assert "bring them to one column of times first" in said


def test_variables_that_a_monitor_writes_in_turn_are_refused_as_such(tmp_path: Path) -> None:
    """As EPICS' camonitor writes them."""
    stamps = [f"{BEGIN + timedelta(milliseconds=5 * i):%Y-%m-%d %H:%M:%S.%f}" for i in range(N)]
    both = [
        f"STAGE:{name} {stamp} {x}"
        for stamp, *pair in zip(stamps, U, Y, strict=True)
        for name, x in zip(("DRV", "POS"), pair, strict=True)
    ]
    said = asked(write(tmp_path / "a.txt", [], both))
    assert "names the channel of each row in turn ('STAGE:DRV', 'STAGE:POS')" in said


def test_an_envelope_is_refused_and_samples_with_rounded_times_are_not(tmp_path: Path) -> None:
    """At twice the rate of its times a real signal falls in half of the pairs."""
    head = ["time (s),drive (V),position (um)"]
    pairs = np.repeat(np.arange(N // 2) * 0.01, 2)
    upper = np.tile([0.0, 0.4], N // 2)
    low = [np.repeat(x[::2], 2) for x in (U, Y)]
    path = write(tmp_path / "a.csv", head, pairs, low[0] + upper, low[1] + 0.1 * upper)
    assert "minimum and maximum of an interval" in asked(path)
    read(path, rate_hz=200.0)
    is_it(read(write(tmp_path / "b.csv", head, pairs, U, Y)), 0.0101)
