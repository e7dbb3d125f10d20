"""A wrong key is reported in the user's words: the key, what was written, and what is allowed."""

import json
from pathlib import Path
from typing import Any

import pytest

from dehyst.daemon.config import load_controller
from dehyst.daemon.config.keys import ConfigSection, list_config
from dehyst.drivers.settings import SettingKey
from dehyst.models.errors import BadInput

TOP = """\
name = "stage-1"
"""
REST = """\
[model]
file = "paper-eq11"
[actuator]
driver = "simulated"
[sensor]
driver = "simulated"
[limits]
min_v = 0.0
max_v = 100.0
slew_v_per_s = 2000.0
"""
LIBRARY_WORDS = ("Expected", "Object", "`$", "float`", "array")
WRONG: tuple[Any, ...] = ("\t", -1e14, 3.5, True, [1])
"""For every key, at least one of these is wrong."""


def said_of(tmp_path: Path, text: str) -> str:
    path = tmp_path / "stage.toml"
    path.write_text(text)
    with pytest.raises(BadInput) as refused:
        load_controller(path)
    said = str(refused.value)
    assert said.startswith(f"{path}: ")
    assert "\n" not in said
    assert not any(word in said for word in LIBRARY_WORDS), said
    return said.removeprefix(f"{path}: ")


def with_key(section: ConfigSection, key: SettingKey, value: str) -> tuple[str, str]:
    """Return a file with one key of this value, and the name of the key."""
    title = section.title.replace("NAME", "temp_c")
    if not title:
        head = "" if key.name == "name" else TOP
        return f"{key.name} = {value}\n{head}{REST}", key.name
    table = f"[{title}]\n"
    line = f"{key.name} = {value}\n"
    kept = REST
    if table in kept:
        here = [f"{one}\n" for one in kept.splitlines() if not one.startswith(f"{key.name} =")]
        kept = "".join(here).replace(table, table + line)
        if key.name == "driver":  # both devices have one
            other = "sensor" if title == "actuator" else "actuator"
            kept = kept.replace(f"[{other}]\n", f'[{other}]\ndriver = "simulated"\n')
        return TOP + kept, f"{title}.{key.name}"
    return TOP + kept + table + line, f"{title}.{key.name}"


ALL = [(section, key) for section in list_config() for key in section.keys]


@pytest.mark.parametrize(
    ("section", "key"), ALL, ids=[f"{section.title}.{key.name}" for section, key in ALL]
)
def test_a_wrong_value_of_any_key_is_named_with_what_is_allowed(
    tmp_path: Path, section: ConfigSection, key: SettingKey
) -> None:
    named = 0
    for wrong in WRONG:
        value = json.dumps(wrong)
        text, name = with_key(section, key, value)
        try:
            said = said_of(tmp_path, text)
        except pytest.fail.Exception:  # this one is allowed
            continue
        if said.startswith(f"{name} = {value} must be {key.type}"):
            named += 1
            assert not key.unit or said.endswith(f"({key.unit})")
    assert named


@pytest.mark.parametrize("title", [section.title for section in list_config()])
def test_an_unknown_key_is_named_with_the_known_ones(tmp_path: Path, title: str) -> None:
    section = next(one for one in list_config() if one.title == title)
    strange = SettingKey("ratte", "", False, None, "", "")
    text, name = with_key(section, strange, "1")
    said = said_of(tmp_path, text)
    assert said.startswith(f"unknown key {name}; known keys ")
    assert all(key.name in said for key in section.keys)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("min_v = 0.0\n", "", "the key limits.min_v is missing; it must be a number (V)"),
        (
            REST[REST.index("[limits]") :],
            "",
            "the section [limits] is missing; it needs min_v, max_v, slew_v_per_s",
        ),
        (TOP, "", "the key name is missing; it must be a name of a-z"),
        (TOP, TOP + "loop = 3\n", "loop = 3 must be a table: [loop]"),
        (TOP, TOP + "channels = 3\n", "channels = 3 must be a table: [channels.NAME]"),
        (TOP, TOP + "channels.t = 3\n", "channels.t = 3 must be a table: [channels.NAME]"),
        (TOP, TOP + 'axis = "x"\n', "axis must have a table for each axis: [axis.x]"),
    ],
)
def test_what_is_missing_or_no_table_is_named(
    tmp_path: Path, old: str, new: str, words: str
) -> None:
    assert old in TOP + REST
    assert said_of(tmp_path, (TOP + REST).replace(old, new)).startswith(words)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ("[loop]\nrate_hz = 'fast'\n", 'loop.rate_hz = "fast" must be a number, above 0'),
        ("[axis.x.limits]\nmin_v = 'low'\n", 'axis.x.limits.min_v = "low" must be a number (V)'),
        ("[trim]\nlimit_um = 0\n", "trim.limit_um = 0 must be a number, above 0 (um)"),
        ("[axis.x]\naxis = 'y'\n", "unknown key axis.x.axis; known keys of [axis.x]: model"),
    ],
)
def test_with_several_axes_a_key_is_named_where_it_stands(
    tmp_path: Path, more: str, words: str
) -> None:
    text = TOP + REST + ("" if "[axis.x" in more else "[axis.x]\n") + more
    assert said_of(tmp_path, text).startswith(words)


def test_a_long_value_is_quoted_shortly(tmp_path: Path) -> None:
    said = said_of(tmp_path, TOP + REST + f'[loop]\nrate_hz = "{"9" * 1000}"\n')
    assert len(said) < 200
