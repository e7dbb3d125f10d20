"""dehyst excite --separate: a drive within its limits, and what it is worth."""

import json

import numpy as np
import pytest

from dehyst.daemon.files.recordings import read_recording
from dehyst.daemon.main import main


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
    assert "tell slew from lag" in capsys.readouterr().out


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
