"""dehyst excite --separate: a drive within its limits, and how well it distinguishes the
effects."""

import json
import re
import shlex
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from tests.rigs.command_line import exit_status

from dehyst.daemon.files.recordings import read_recording
from dehyst.daemon.main import main
from dehyst.models.diagnosis.data.prepare import prepare
from dehyst.models.diagnosis.findings.decide import next_experiment
from dehyst.models.diagnosis.result import Finding
from dehyst.models.recording import Recording


def test_writes_a_drive_within_range_and_slew(tmp_path, capsys):
    out = tmp_path / "drive.csv"
    status = main(
        ["excite", "--separate", "slew", "lag", "--range", "0", "75", "--slew", "9000",
         "--duration", "4", "-o", str(out)]
    )  # fmt: skip
    assert status == 0
    drive = read_recording(out)
    assert drive.drive_unit == "v"
    assert drive.drive.min() >= 0
    assert drive.drive.max() <= 75
    assert np.max(np.abs(np.diff(drive.drive))) <= 9.0
    assert "distinguish slew from lag" in capsys.readouterr().out


def test_model_gives_range_and_units(tmp_path, capsys):
    out = tmp_path / "drive.csv"
    arguments = ["excite", "--separate", "creep", "drift", "--model", "paper-eq11"]
    assert main([*arguments, "--duration", "4", "-o", str(out), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["separate"] == ["creep", "drift"]
    assert said["tried"][0]["waveform"] == said["waveform"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["gremlins", "lag", "--range", "0", "10", "-o", "x.csv"], "known are"),
        (["delay", "lag", "-o", "x.csv"], "--range"),
        (["delay", "lag", "--range", "0", "10"], "--output"),
        (["delay", "lag", "--range", "5", "5", "-o", "x.csv"], "range"),
        (["delay", "lag", "--range", "0", "9", "-o", "x.csv", "--sampling", "0"], "--sampling"),
    ],
)
def test_bad_usage_is_one_line(arguments, words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["excite", "--separate", *arguments]) == 2
    shown = capsys.readouterr().err
    assert words in shown
    assert shown.count("\n") == 1


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("excite --range 0 1e7 --band 5 --duration 9", "beyond 10000 V"),
        ("excite --range 0 1e300 --band 5 --duration 9", "--range: 1e300"),
        ("excite --range -2e6 0 --unit um --band 5 --duration 9", "beyond 1e+06 "),
        (
            "excite --range 0 100 --band 5 --duration 1e9",
            "at most 5000000 are written, so at most 5e+03 s",
        ),
        ("excite --separate lag delay --range 0 1e5", "beyond 10000 V"),
        ("excite --separate lag delay --range 0 9 --duration 1e9", "--duration 1e+09"),
        ("excite --separate lag delay --range 0 9 --duration 3000", "at most 2000000 are"),
        ("excite --separate lag delay --range 0 9 --duration .05", "--duration 0.05: 50 samples"),
        ("config init --range 0 1e5", "beyond 10000 V"),
        ("setup folder --yes --range 0 1e5", "beyond 10000 V"),
        ("scan raster --size 1e7 10", "beyond 1e+06 "),
        ("scan spiral --radius 1e7", "beyond 1e+06 "),
        ("scan raster --size 9 9 --center 0 -1e9", "beyond 1e+06 "),
    ],
)
def test_what_no_stage_can_do_is_refused_and_nothing_is_written(
    line, words, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    out = [] if line.startswith("setup") else ["-o", "out.csv"]
    assert exit_status([*line.split(), *out]) == 2
    shown = capsys.readouterr().err
    assert words in shown
    assert shown.count("\n") == 1
    assert not list(tmp_path.iterdir())


@pytest.mark.filterwarnings("error")
def test_the_largest_range_makes_no_warning(tmp_path):
    out = str(tmp_path / "drive.csv")
    arguments = ["excite", "--range", "-10e3", "10e3", "--band", "5", "--duration", "9"]
    assert main([*arguments, "-o", out]) == 0


CONFIG = """
name = "s"
model = {file = "m.toml"}
loop = {rate_hz = 200.0}
actuator = {driver = "simulated", gain = 10.0}
sensor = {driver = "simulated"}
limits = {min_v = 0.0, max_v = 100.0, slew_v_per_s = 2000.0}
"""


@pytest.mark.parametrize(
    "more", [["--band", "4", "--duration", "10"], ["--separate", "lag", "delay"]]
)
def test_with_a_configuration_the_drive_is_one_that_the_stage_can_take(
    tmp_path: Path, more: list[str]
) -> None:
    """A drive for a configuration keeps its range, slew and rate in the model's drive unit, here a
    tenth of the actuator's volts."""
    config, out = tmp_path / "stage.toml", tmp_path / "drive.csv"
    config.write_text(CONFIG)
    assert main(["excite", "--config", str(config), *more, "-o", str(out)]) == 0
    drive = read_recording(out)
    assert drive.period_s == pytest.approx(0.005)
    assert drive.drive.min() >= 0.0
    assert 9.0 < drive.drive.max() <= 10.0
    assert np.abs(np.diff(drive.drive)).max() <= 200.0 * 0.005 * (1 + 1e-9)


def test_what_is_given_beside_a_configuration_must_lie_within_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = tmp_path / "stage.toml"
    config.write_text(CONFIG)
    for more in (["--range", "0", "11"], ["--slew", "201"]):
        line = ["excite", "--config", str(config), "--band", "4", "--duration", "10", *more]
        assert main([*line, "-o", str(tmp_path / "drive.csv")]) == 2
        assert "allows 0 to 10 V at 200 V/s" in capsys.readouterr().err
    assert not (tmp_path / "drive.csv").exists()


@pytest.mark.parametrize(
    ("unit", "low", "high", "period_s", "samples"),
    [("v", 0.0, 75.0, 1e-3, 20_000), ("um", -3.2, 11.7, 0.02, 400), ("counts", 0.0, 6e4, 0.1, 400)],
)
def test_the_line_that_a_diagnosis_prints_runs_and_keeps_to_what_was_recorded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, unit: str, low: float, high: float,
    period_s: float, samples: int,
) -> None:  # fmt: skip
    t_s = np.arange(samples) * period_s
    u = low + (high - low) * 0.5 * (1.0 - np.cos(2 * np.pi * 4 * np.arange(samples) / samples))
    data = prepare([Recording(t_s, u, 0.1 * u, drive_unit=unit)])
    blank = {field.name: "" for field in fields(Finding)}
    found = Finding(**{**blank, "name": "delay", "ambiguous_with": ("lag",)})
    said = next_experiment("partly", [found], [], data)
    (line,) = re.findall("`dehyst (.*)`", said)
    monkeypatch.chdir(tmp_path)
    assert main(shlex.split(line)) == 0
    drive = read_recording(tmp_path / "separate.csv")
    assert drive.drive_unit == unit
    assert drive.drive.min() >= low - 1e-3 * (high - low)
    assert drive.drive.max() <= high + 1e-3 * (high - low)
    assert np.median(np.diff(drive.t_s)) == pytest.approx(period_s, rel=1e-3)
