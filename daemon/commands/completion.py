"""Print a script for tab completion."""

import argparse
import re
from typing import Any

SHELLS = ("bash", "zsh", "fish", "tcsh")
_FOLDER = re.compile(r"DIR|FOLDER")
_FILE = re.compile(r"FILE|REC|CSV|\.toml|\.csv|IN|OUT|PATH|PORT|TRAJECTORY")

EPILOG = """\
The script knows every command and option; print it again after an update of dehyst.

examples: dehyst completion bash > ~/.local/share/bash-completion/completions/dehyst
          dehyst completion zsh > "${fpath[1]}/_dehyst"
          dehyst completion fish > ~/.config/fish/completions/dehyst.fish
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `dehyst completion`."""
    parser.epilog = EPILOG
    parser.add_argument("shell", choices=SHELLS)


def run(args: argparse.Namespace) -> int:
    """Print the script; return 0. args.build_whole builds the parser of all commands."""
    import shtab

    parser = args.build_whole()
    for command in (parser, *parser.commands.values()):
        for action in command._actions:
            if action.choices is None and (completes := _completes(action)):
                action.complete = completes
    print(shtab.complete(parser, args.shell))
    return 0


def _completes(action: argparse.Action) -> dict[str, Any] | None:
    import shtab

    if action.nargs == 0:
        return None
    words = action.metavar if isinstance(action.metavar, str) else ""
    if _FOLDER.search(words):
        return dict(shtab.DIRECTORY)
    return dict(shtab.FILE) if _FILE.search(words) else None
