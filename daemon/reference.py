"""Write the reference pages of docs/ from the code: commands, configuration, drivers, messages.

    python -m dehyst.daemon.reference docs

tests/daemon/test_reference.py fails if the pages differ from what this writes.
"""

import argparse
import inspect
import json
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin

import msgspec
from msgspec import structs

from dehyst.daemon.bus.contract import MESSAGES, meaning_of, name_of_message, schema_of
from dehyst.daemon.bus.messages import FoundEffect, GatewayStatus, ModelOffer
from dehyst.daemon.bus.refusal_codes import CODES
from dehyst.daemon.config.keys import list_config
from dehyst.daemon.main import COMMANDS, build_whole_parser
from dehyst.daemon.rings.records import Flag, MissCause, Mode, State
from dehyst.daemon.rings.status import Timing
from dehyst.drivers.registry import list_plugins, list_settings
from dehyst.drivers.settings import SettingKey

OWN = "dehyst."
MADE = "<!-- made by `make reference`; edit the code instead -->\n"
HEAD = "| {} | allowed | default | unit | meaning |\n|---|---|---|---|---|"


def write_references(folder: Path) -> list[Path]:
    """Write every page into the folder; return their paths."""
    written = []
    for name, text in pages().items():
        path = folder / name
        path.write_text(text, encoding="utf-8")
        written.append(path)
    return written


def pages() -> dict[str, str]:
    """Return each page's text by file name."""
    return {
        "reference-commands.md": refer_commands(),
        "reference-configuration.md": refer_configuration(),
        "reference-drivers.md": refer_drivers(),
        "reference-messages.md": refer_messages(),
    }


def refer_messages() -> str:
    """Describe every message of the bus: fields, flags, states and codes."""
    lines = [
        "# Messages on the bus",
        "",
        MADE,
        "[topics.md](topics.md) explains their use, with examples in bytes. `docs/schemas` "
        "contains a JSON Schema for each message. A field with a default may be omitted. A reader "
        "ignores unknown fields.",
    ]
    for kind in MESSAGES:
        lines += ["", f"## {name_of_message(kind)}", "", *_fields_of(kind)]
    for part in (GatewayStatus, Timing, FoundEffect, ModelOffer):
        lines += ["", f"## {part.__name__} (inside others)", "", *_fields_of(part)]
    for title, numbers in (
        ("Flags (bits of `flags`)", Flag),
        ("States", State),
        ("Modes of the inverse", Mode),
        ("Causes of a missed deadline", MissCause),
    ):
        lines += ["", f"## {title}", "", "| number | name | meaning |", "|---|---|---|"]
        said = comments_of(numbers)
        lines += [
            _table_row([str(int(number)), name.lower(), said[name]])
            for name, number in numbers.__members__.items()
        ]
    lines += [
        "",
        "## Codes of refusals",
        "",
        "| code | meaning | the same command may be admitted later |",
    ]
    lines += ["|---|---|---|"]
    for name, code in CODES.items():
        lines.append(_table_row([f"`{name}`", code.says, "yes: try again" if code.waits else ""]))
    return "\n".join(lines) + "\n"


def _fields_of(kind: type[msgspec.Struct]) -> list[str]:
    schema = schema_of(kind) if kind in MESSAGES else {}
    rows = [" ".join((kind.__doc__ or "").split()), "", "| field | type | default | meaning |"]
    rows.append("|---|---|---|---|")
    for field in structs.fields(kind):
        described = schema.get("properties", {}).get(field.name, {})
        form = described.get("$comment", "").removeprefix("msgpack ").partition(",")[0]
        default = "(needed)" if field.required else _default(field.default)
        rows.append(
            _table_row(
                [
                    f"`{field.name}`",
                    form or _type_words(field.type),
                    default,
                    meaning_of(kind, field.name),
                ]
            )
        )
    return rows


def _default(value: Any) -> str:
    if isinstance(value, float) and value != value:
        return "NaN"
    return "empty" if value in (b"", (), "") else _code(value)


def _type_words(kind: Any) -> str:
    """Describe a field's type for readers who do not know Python."""
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        return f"map ({kind.__name__})"
    origin, args = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return _type_words(args[0])
    if origin is tuple:
        return f"list of {_type_words(args[0])}"
    if origin is dict:
        return "map of names to numbers"
    if origin is Literal:
        return ", ".join(map(str, args))
    if type(None) in args:
        return f"{_type_words(args[0])} or nil"
    words = {bool: "bool", int: "int", float: "float", str: "string", bytes: "bin"}
    return words.get(kind, str(kind))


def comments_of(numbers: Any) -> dict[str, str]:
    """Return the comment after each value of an enumeration, by name."""
    found = {}
    for line in inspect.getsource(numbers).splitlines():
        name, _, rest = line.strip().partition(" = ")
        if rest and name in numbers.__members__:
            found[name] = rest.partition("# ")[2].strip()
    return {name: found.get(name, "") for name in numbers.__members__}


def refer_commands() -> str:
    """Describe every command with its arguments and the exit status that its help states."""
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
    """Describe every section and key of `stage.toml`."""
    lines = [
        "# Configuration",
        "",
        MADE,
        "The configuration is one TOML file. `dehyst config init` writes it with comments, and "
        "`dehyst run --check FILE` checks it. An unknown key, a missing key or a value that is "
        "not allowed is an error that names the key. "
        "[reference-drivers.md](reference-drivers.md) lists the settings of the drivers.",
    ]
    for section in list_config():
        title = f"[{section.title}]" if section.title else "Top of the file"
        said = section.meaning.partition("]")[2].lstrip(":,. ") if section.title else ""
        lines += ["", f"## {title}" + (" (needed)" if section.needed and section.title else ""), ""]
        lines += [said[:1].upper() + said[1:], ""] * bool(said)
        lines += [HEAD.format("key"), *map(_key_row, section.keys)]
    return "\n".join(lines) + "\n"


def refer_drivers() -> str:
    """Describe the settings of the drivers that come with dehyst."""
    lines = [
        "# Drivers",
        "",
        MADE,
        "`dehyst drivers` lists these and any other installed driver, `dehyst drivers NAME` its "
        "settings. The settings belong in `[actuator.settings]` and `[sensor.settings]`.",
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
    """Return the table row of one argument; "" for hidden arguments and --help."""
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
