"""`dehyst run --check` finds what `dehyst run` would refuse, before a device is touched, and
reports it in one line; it summarises a good configuration on one screen."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from tests.rigs.processes import CONFIG

from dehyst.daemon.main import main

SERIAL = {
    "run": "/nonexistent/run", "model": "paper-eq11", "rate": 100.0, "loop": "",
    "actuator": "mdt693b", "sensor": "ksg101",
    "actuator_settings": '{port = "/dev/ttyACM9", axis = "x"}',
    "sensor_settings": '{port = "/dev/ttyUSB9"}', "trim": "true",
}  # fmt: skip
GOOD = CONFIG.format(**SERIAL).replace('driver = "mdt693b"', 'driver = "mdt693b"\ngain = 15.0')


def test_a_good_one_is_ok_with_no_device_there(tmp_path: Path) -> None:
    path = tmp_path / "config.toml"
    path.write_text(GOOD)
    done = subprocess.run(
        [sys.executable, "-m", "dehyst.daemon.main", "run", "--check", str(path)],
        capture_output=True, text=True, check=False, timeout=120,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(f"{path}: ok.")
    for words in (
        "mdt693b at /dev/ttyACM9, sensor ksg101 at /dev/ttyUSB9", "paper-eq11: ",
        "set-points from ", "100 Hz", "to 150 V", "by the gauge: time constant", "/nonexistent/run",
    ):  # fmt: skip
        assert words in done.stdout
    assert len(done.stdout.splitlines()) < 20


def test_a_model_for_a_small_part_of_the_limits_is_warned_of(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The model of the paper is valid from 0 to 10 V, as the input of an amplifier of gain 15."""
    path = tmp_path / "config.toml"
    for gain, says in ((15.0, ""), (8.0, ""), (7.0, "47 %"), (1.0, "6.7 %")):
        path.write_text(GOOD.replace("gain = 15.0", f"gain = {gain}"))
        assert main(["run", "--check", str(path)]) == 0
        said = capsys.readouterr().out
        assert ("may be another stage's" in said) == bool(says)
        assert says in said
    assert "the model is valid only from 0 to 10 V, 6.7 % of the limits, 0 to 150 V" in said


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        (("gain = 15.0", "gain = 31.0"), "the limits use only 48 % of the model's valid range"),
        (("gain = 15.0", "gain = 29.0"), ""),
        (("[setpoint]", "[setpoint]\norigin = 8000"), "setpoint.origin = 8000 um is farther"),
        (("[setpoint]", "[setpoint]\norigin = -3"), ""),
    ],
)
def test_limits_gain_and_origin_in_another_unit_are_warned_of(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], changed: tuple[str, str], says: str
) -> None:
    path = tmp_path / "config.toml"
    path.write_text(GOOD.replace(*changed))
    assert main(["run", "--check", str(path)]) == 0
    said = capsys.readouterr().out
    assert ("warning" in said) == bool(says)
    assert says in said


def test_a_trim_that_is_not_bounded_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "config.toml"
    for limit, status in ((0.5, 0), (900.0, 2)):
        path.write_text(GOOD.replace("[trim]", f"[trim]\nlimit_um = {limit}"))
        assert main(["run", "--check", str(path)]) == status
    assert "trim.limit_um = 900: the stage's whole reach is " in capsys.readouterr().err


def test_a_missing_model_is_named_with_the_folder_that_was_searched(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "config.toml"
    path.write_text(GOOD.replace('"paper-eq11"', '"no.toml"'))
    monkeypatch.chdir("/")
    assert main(["run", "--check", str(path)]) == 2
    assert f"{tmp_path / 'no.toml'}: cannot be read" in capsys.readouterr().err


def test_the_whole_is_json_on_request(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "config.toml"
    path.write_text(GOOD)
    assert main(["run", "--check", str(path), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["actuator"]["gain"] == 15.0
    assert said["setpoint"]["stale_s"] > 0  # defaults are included
    assert main(["run", "--json"]) == 2
    assert "--check" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('driver = "mdt693b"', 'driver = "mdt693c"', "no actuator driver 'mdt693c'"),
        ('driver = "ksg101"', 'driver = "mdt693b"', "no sensor driver 'mdt693b'"),
        ('axis = "x"', 'axis = "w"', "axis"),
        ('axis = "x"', 'axsi = "x"', "axsi"),
        ("max_v = 150.0", "max_v = 100000.0", "wider than the unit's own"),
        ("rate_hz = 100.0", "rate_hz = 5000.0", "known to sustain"),
        ("[limits]", '[channels.t]\ndriver = "thermo"\n[limits]', "no sensor driver 'thermo'"),
        ('"paper-eq11"', '"missing.toml"', "missing.toml"),
        ("[limits]", 'bus = {listen = ["tcp/0.0.0.0:7447"]}\n[limits]', "bus"),
        ("min_v = 0.0", "min_v = 6.0", "safe.voltage_v"),
        ("enabled = true", "time_constant_s = 0.002", "use 0.1 s or more"),
    ],
)
def test_what_would_be_refused_is_found(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], old: str, new: str, words: str
) -> None:
    assert old in GOOD
    path = tmp_path / "config.toml"
    path.write_text(GOOD.replace(old, new))
    assert main(["run", "--check", str(path)]) == 2
    said = capsys.readouterr().err
    assert words in said
    assert len(said.strip().splitlines()) == 1
