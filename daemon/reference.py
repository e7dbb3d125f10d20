"""The reference pages of docs/, written from the code: commands, configuration, drivers.

    python -m dehyst.daemon.reference docs

tests/daemon/test_reference.py fails where the pages are not what this writes.
"""

import argparse
import json
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from dehyst.daemon.main import COMMANDS, build_whole_parser
from dehyst.daemon.tools.config_keys import list_config
from dehyst.drivers.registry import list_plugins, list_settings
from dehyst.drivers.settings import SettingKey

OWN = "dehyst."
MADE = "<!-- made by `make reference`; edit the code instead -->\n"
HEAD = "| {} | allowed | default | unit | meaning |\n|---|---|---|---|---|"


def write_references(folder: Path) -> list[Path]:
    """Write every page into the folder; their paths."""
    written = []
    for name, text in pages().items():
        path = folder / name
        path.write_text(text, encoding="utf-8")
        written.append(path)
    return written


def pages() -> dict[str, str]:
    """Each page's text by its file name."""
    return {
        "reference-commands.md": refer_commands(),
        "reference-configuration.md": refer_configuration(),
        "reference-drivers.md": refer_drivers(),
    }


def refer_commands() -> str:
    """Every command with its arguments, and the exit status that its help states."""
    parsers = build_whole_parser().commands
    lines = [
        "# Commands",
        "",
        MADE,
        "Exit status, unless said otherwise: 0 success, 1 a finding or not possible now, 2 bad "
        "usage or input, with one line on stderr.",
        "",
        *(f"- [`dehyst {name}`](#dehyst-{name}): {text}" for name, text in COMMANDS.items()),
    ]
    for name in COMMANDS:
        parser = parsers[name]
        lines += ["", f"## dehyst {name}", "", _paragraphs(parser.description or "")]
        rows = [row for action in parser._actions if (row := _row(parser, action))]
        if rows:
            lines += ["", "| argument | meaning |", "|---|---|", *rows]
        if parser.epilog:
            lines += ["", "```text", parser.epilog.strip(), "```"]
    return "\n".join(lines) + "\n"


def refer_configuration() -> str:
    """Every section and key of `stage.toml`."""
    lines = [
        "# Configuration",
        "",
        MADE,
        "One TOML file; `dehyst config init` writes one with comments, `dehyst run --check FILE` "
        "says what it means. An unknown key, a missing key or a value that is not allowed is an "
        "error that names the key. Settings of the drivers: "
        "[reference-drivers.md](reference-drivers.md).",
    ]
    for section in list_config():
        title = f"[{section.title}]" if section.title else "Top of the file"
        said = section.meaning.partition("]")[2].lstrip(":,. ") if section.title else ""
        lines += ["", f"## {title}" + (" (needed)" if section.needed and section.title else ""), ""]
        lines += [said[:1].upper() + said[1:], ""] * bool(said)
        lines += [HEAD.format("key"), *map(_key_row, section.keys)]
    return "\n".join(lines) + "\n"


def refer_drivers() -> str:
    """The settings of the drivers that come with dehyst."""
    lines = [
        "# Drivers",
        "",
        MADE,
        "`dehyst drivers` lists these and any other that is installed, `dehyst drivers NAME` their "
        "settings. They stand in `[actuator.settings]` and `[sensor.settings]`.",
    ]
    for plugin in list_plugins():
        if not plugin.where.startswith(OWN):
            continue
        lines += ["", f"## {plugin.name} ({plugin.kind})", "", plugin.summary, ""]
        lines += [HEAD.format("setting"), *map(_key_row, list_settings(plugin) or [])]
    return "\n".join(lines) + "\n"


def _key_row(key: SettingKey) -> str:
    default = "(needed)" if key.required else "" if key.default is None else _code(key.default)
    return _table_row([f"`{key.name}`", key.type, default, key.unit, key.meaning])


def _row(parser: argparse.ArgumentParser, action: argparse.Action) -> str:
    """One argument; "" for those that are hidden, and --help."""
    if action.help is argparse.SUPPRESS or "--help" in action.option_strings:
        return ""
    takes = _takes(action)
    names = ", ".join(f"`{name}`" for name in action.option_strings)
    shown = f"{names} {takes}".strip() + (" (needed)" if action.required and names else "")
    values = {**vars(action), "prog": parser.prog}
    return _table_row([shown, (action.help or "") % values])


def _takes(action: argparse.Action) -> str:
    if action.nargs == 0:
        return ""
    words: Any = action.metavar
    if words is None and action.choices is not None:
        words = "\\|".join(map(str, action.choices))
    words = words if words is not None else action.dest.upper()
    text = " ".join(words) if isinstance(words, tuple) else str(words)
    return f"`{text}`" + ("..." if action.nargs in ("+", "*") else "")


def _table_row(cells: Iterable[str]) -> str:
    return "| " + " | ".join(" ".join(cell.split()) for cell in cells) + " |"


def _code(value: Any) -> str:
    return f"`{json.dumps(value)}`"


def _paragraphs(text: str) -> str:
    return "\n\n".join(" ".join(part.split()) for part in text.split("\n\n"))


if __name__ == "__main__":
    for one in write_references(Path(sys.argv[1] if len(sys.argv) > 1 else "docs")):
        print(one)
