"""A commented configuration means what was given, and its comments are the defaults."""

import re
import tomllib
from pathlib import Path
from typing import Any

import msgspec
import pytest

from dehyst.daemon.commands.config import parse_settings
from dehyst.daemon.config import BusConfig, TrimConfig, parse_config
from dehyst.daemon.config.keys import list_config
from dehyst.daemon.config.text import limits_within, write_commented
from dehyst.daemon.main import main
from dehyst.models.errors import BadInput

GIVEN: dict[str, dict[str, Any]] = {
    "": {"name": "stage-7"},
    "model": {"file": "m.toml"},
    "loop": {"rate_hz": 250.0},
    "actuator": {"driver": "mdt693b", "settings": {"port": '/dev/tty X\\"ä', "axis": "z"}},
    "sensor": {"driver": "ksg101", "settings": {"port": "p", "smoothed": True}},
    **limits_within(10.0, 90.0, 30.0),
}


def test_it_means_what_was_given() -> None:
    config = parse_config(write_commented(GIVEN))
    assert (config.name, config.model.file, config.loop.rate_hz) == ("stage-7", "m.toml", 250.0)
    assert config.actuator.settings == {"port": '/dev/tty X\\"ä', "axis": "z"}
    assert config.sensor.settings == {"port": "p", "smoothed": True}
    assert (config.limits.min_v, config.limits.max_v, config.limits.slew_v_per_s) == (10, 90, 30)
    assert (config.safe.voltage_v, config.safe.ramp_v_per_s) == (10.0, 30.0)  # within the limits
    assert (config.trim, config.bus, config.page) == (TrimConfig(), BusConfig(), None)


def test_every_comment_that_is_a_key_is_its_default() -> None:
    """With the comment signs removed, every section that has defaults is unchanged."""
    plain = parse_config(write_commented(GIVEN))
    text = re.sub(r"^# (\w+ = .*)$", r"\1", write_commented(GIVEN), flags=re.MULTILINE)
    text = text.replace("driver = ...\n", 'driver = "simulated"\n')
    reported = tomllib.loads(text)
    for name in ("loop", "safe", "setpoint", "inverse", "trim", "telemetry", "watch"):
        expected = msgspec.to_builtins(getattr(plain, name))
        shown = {k: v for k, v in expected.items() if v is not None}
        assert {k: reported[name][k] for k in shown} == shown, name


def test_every_key_has_a_row_and_most_have_a_sentence() -> None:
    sections = {section.title: section for section in list_config()}
    assert next(iter(sections)) == ""
    assert {"actuator", "channels.NAME", "bus.auth", "page"} <= sections.keys()
    origin = next(k for k in sections["setpoint"].keys if k.name == "origin")
    assert origin.type == '"auto", "mid-range" or "model", or a number'
    assert sections["limits"].needed
    assert not sections["bus.auth"].needed
    every = next(k for k in sections["channels.NAME"].keys if k.name == "every_s")
    assert (every.default, every.unit) == (1.0, "s")


def test_config_init_writes_it_and_refuses_what_run_would(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "stage.toml"
    line = ["config", "init", "--range", "0", "100", "--set", "port=/dev/x", "-o", str(path)]
    assert main(line) == 0
    assert parse_config(path.read_text()).actuator.settings == {"port": "/dev/x"}
    assert main(line) == 2
    assert "exists already" in capsys.readouterr().err
    for more, words in (
        (["--range", "0", "1000"], "wider than the unit's own"),
        (["--range", "0", "100", "--actuator", "nidaqmx"], "channel is missing"),
        (["--range", "0", "100", "--sensor", "thermo"], "no driver 'thermo'"),
        (["--range", "100", "0"], "give the lowest voltage first"),
        (["--range", "0", "100", "--set", "axis=w"], "axis"),
    ):
        assert main(["config", "init", *more]) == 2
        said = capsys.readouterr().err
        assert words in said
        assert said.count("\n") == 1


def test_settings_are_read_as_toml_else_as_text() -> None:
    assert parse_settings(["a=1.5", "b=true", "c=Dev1/ao0", 'd="7"', "e=x=y"]) == {
        "a": 1.5,
        "b": True,
        "c": "Dev1/ao0",
        "d": "7",
        "e": "x=y",
    }
    with pytest.raises(BadInput, match="KEY=VALUE"):
        parse_settings(["port"])
