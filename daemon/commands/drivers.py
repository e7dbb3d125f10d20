"""List the drivers, the broken ones with their error; with a name, the settings of a driver."""

import argparse
import dataclasses
import json
from typing import Any

import msgspec
from rich.markup import escape
from rich.table import Table

from dehyst.daemon.terminal.stdout_console import StdoutConsole
from dehyst.drivers.registry import Plugin, find_plugins, list_plugins, list_settings
from dehyst.drivers.settings import SettingKey

EPILOG = """\
exit status: 0; 1 if a plugin is broken; 2 if there is no driver of this name.

example: dehyst drivers
         dehyst drivers mdt693b
         dehyst drivers --json | jq '.[] | select(.error != "")'
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `dehyst drivers`."""
    parser.epilog = EPILOG
    parser.add_argument(
        "name", nargs="?", metavar="NAME", help="a driver: list its settings, key by key"
    )
    parser.add_argument("--json", action="store_true", help="print the list as JSON")


def run(args: argparse.Namespace) -> int:
    """Print every plugin, or one driver's settings; return 1 if a plugin is broken."""
    plugins = list_plugins() if args.name is None else find_plugins(args.name)
    if args.json:
        with_settings = args.name is not None
        print(json.dumps([_to_json(plugin, with_settings) for plugin in plugins], indent=2))
    elif args.name is None:
        _print_plugins(plugins)
    else:
        for number, plugin in enumerate(plugins):
            print("\n" * (number > 0) + f"{plugin.kind} {plugin.name}: {_summary(plugin)}\n")
            _print_settings(plugin)
    return 1 if any(plugin.error for plugin in plugins) else 0


def _to_json(plugin: Plugin, with_settings: bool) -> dict[str, Any]:
    table = dataclasses.asdict(plugin)
    if with_settings:
        table["settings"] = msgspec.to_builtins(list_settings(plugin))
    return table


def _summary(plugin: Plugin) -> str:
    return f"BROKEN: {plugin.error}" if plugin.error else plugin.summary


def _print_plugins(plugins: list[Plugin]) -> None:
    table = _table("kind", "name", "from", "what it is")
    for plugin in plugins:
        style = "bold red" if plugin.error else ""
        row = (plugin.kind, plugin.name, plugin.package, escape(_summary(plugin)))
        table.add_row(*row, style=style)
    _print(table)


def _print_settings(plugin: Plugin) -> None:
    keys = list_settings(plugin)
    if keys is None:
        print("This driver does not declare its settings; see its own documentation.")
        return
    table = _table("setting", "allowed", "default", "unit", "meaning")
    for key in keys:
        cells = (key.name, key.type, _default(key), key.unit, key.meaning)
        table.add_row(*(escape(cell) for cell in cells))
    _print(table)


def _default(key: SettingKey) -> str:
    if key.required:
        return "(needed)"
    return "" if key.default is None else json.dumps(key.default)


def _table(*titles: str) -> Table:
    table = Table(box=None, pad_edge=False)
    for title in titles:
        table.add_column(title, overflow="fold")
    return table


def _print(table: Table) -> None:
    console = StdoutConsole()
    # a pipe has no width: print long lines unwrapped, for grep
    StdoutConsole(width=None if console.is_terminal else 240).print(table)
