"""list the driver plugins, the broken ones with their error"""

import argparse
import dataclasses
import json

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from dehyst.drivers.registry import Plugin, list_plugins

EPILOG = """\
exit status: 0; 1 when a plugin is broken.

example: dehyst drivers
         dehyst drivers --json | jq '.[] | select(.error != "")'
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Fill in the arguments."""
    parser.epilog = EPILOG
    parser.add_argument("--json", action="store_true", help="print the list as JSON")


def run(args: argparse.Namespace) -> int:
    """Print every plugin; 1 when one is broken."""
    plugins = list_plugins()
    if args.json:
        print(json.dumps([dataclasses.asdict(plugin) for plugin in plugins], indent=2))
    else:
        _print_table(plugins)
    return 1 if any(plugin.error for plugin in plugins) else 0


def _print_table(plugins: list[Plugin]) -> None:
    table = Table(box=None, pad_edge=False)
    for title in ("kind", "name", "from", "what it is"):
        table.add_column(title, overflow="fold")
    for plugin in plugins:
        text = f"BROKEN: {plugin.error}" if plugin.error else plugin.summary
        style = "bold red" if plugin.error else ""
        table.add_row(plugin.kind, plugin.name, plugin.package, escape(text), style=style)
    console = Console()
    # A pipe has no width: whole lines, for grep.
    Console(width=None if console.is_terminal else 240).print(table)
