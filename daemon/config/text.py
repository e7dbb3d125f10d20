"""Write a configuration with comments: given values as keys, every other key commented out with its
default, so that the file shows every key there is."""

import json
import math
import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

from dehyst.daemon.config import SafeConfig
from dehyst.daemon.config.keys import ConfigSection, list_config
from dehyst.daemon.config.plausible import check_plausible
from dehyst.drivers.registry import find_plugins, list_settings
from dehyst.drivers.settings import SettingKey
from dehyst.models.errors import BadInput

WIDTH = 100  # columns of a comment
SLEW_SPANS = 20.0
"""Default slew limit, in voltage ranges per second: 60 mA, the current of an MDT693B, drive 20 uF
through 150 V at this rate, more than the capacity of most stacks."""
DEFAULTS = SafeConfig()
PLAIN = ("a number", "a string", "a string that is not empty", "a list of strings", "true or false")
"""Types that are omitted from the comment, because the default shows them well enough."""
HEAD = """\
# The configuration of one controller. Lines that begin with # show the defaults.
# `dehyst run --check FILE` prints what the file means; an unknown key is an error.
"""
Given = Mapping[str, Mapping[str, Any]]
"""Values by section and key. "" is the top of the file; a device's `settings` is a table."""


def check_range(low: float, high: float, slew: float | None) -> None:
    """Raise BadInput if the range is empty, not finite or reversed, or the slew rate not
    positive."""
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise BadInput(
            f"--range {low:g} {high:g}: give the lowest voltage first, then the highest, in V"
        )
    check_plausible("--range", (low, high), "v")
    if slew is not None and not 0.0 < slew < math.inf:
        raise BadInput(f"--slew {slew:g}: a rate in V/s, greater than 0")


def limits_within(low: float, high: float, slew: float) -> dict[str, dict[str, float]]:
    """Return the sections [limits] and [safe]; the defaults of [safe], 0 V at 50 V/s, are clipped
    to the limits."""
    return {
        "limits": {"min_v": low, "max_v": high, "slew_v_per_s": slew},
        "safe": {
            "voltage_v": min(max(DEFAULTS.voltage_v, low), high),
            "ramp_v_per_s": min(DEFAULTS.ramp_v_per_s, slew),
        },
    }


def write_commented(given: Given) -> str:
    """Return the text of the file. Raises DriverConfigError if a driver does not exist."""
    top, *sections = list_config()
    text = [HEAD, *_keys(top, given.get("", {}))]
    for section in sections:
        text += ["", *_section(section, given)]
    return "\n".join(text) + "\n"


def _section(section: ConfigSection, given: Given) -> list[str]:
    values = given.get(section.title, {})
    shown = section.needed or bool(values)
    absent = any(key.required for key in section.keys) or "." in section.title
    head = f"[{section.title}]"
    if not shown and (absent or section.title == "page"):
        head = f"# {head}"
    said = section.meaning.partition("]")[2].lstrip(":,. ") if section.meaning else ""
    lines = [*_comment(said), head, *_keys(section, values)]
    if section.title in ("actuator", "sensor") and "driver" in values:
        lines += ["", f"[{section.title}.settings]", *_driver_keys(section.title, values)]
    return lines


def _keys(section: ConfigSection, values: Mapping[str, Any]) -> list[str]:
    return [line for key in section.keys if key.name != "settings" for line in _key(key, values)]


def _driver_keys(kind: str, values: Mapping[str, Any]) -> list[str]:
    settings = values.get("settings", {})
    plugins = [p for p in find_plugins(values["driver"]) if p.kind == kind]
    keys: Sequence[SettingKey] = (list_settings(plugins[0]) if plugins else None) or []
    known = {key.name for key in keys}
    lines = [line for key in keys for line in _key(key, settings)]
    return lines + [_pair(name, v) for name, v in settings.items() if name not in known]


def _key(key: SettingKey, values: Mapping[str, Any]) -> list[str]:
    allowed = "" if key.type in PLAIN else f"({key.type})"
    lines = _comment(" ".join(filter(None, (key.meaning, allowed))))
    if key.name in values:
        return [*lines, _pair(key.name, values[key.name])]
    if key.default is None:
        return [*lines, f"# {key.name} =" + (" ..." if key.required else "")]
    return [*lines, f"# {_pair(key.name, key.default)}"]


def _pair(name: str, value: Any) -> str:
    return f"{name} = {json.dumps(value, ensure_ascii=False)}"  # valid TOML for these values


def _comment(text: str) -> list[str]:
    return [f"# {line}" for line in textwrap.wrap(text, WIDTH - 2)]
