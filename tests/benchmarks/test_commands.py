"""Each command that the documents show for a table of figures is one that the benchmark takes."""

import argparse
import importlib
import re
import shlex
import sys
from pathlib import Path
from typing import Any, NoReturn

import pytest

ROOT = Path(__file__).resolve().parents[2]
SHOWN = re.compile(r"python -m (tests\.benchmarks\.[^\n`|]+)")


def _file_of(module: str) -> Path:
    path = ROOT / module.replace(".", "/")
    return path / "__main__.py" if path.is_dir() else path.with_suffix(".py")


def _commands() -> list[str]:
    """Return the commands of the documents whose benchmark describes its arguments."""
    pages = [page.read_text(encoding="utf-8") for page in (ROOT / "docs").rglob("*.md")]
    shown = {command.strip() for page in pages for command in SHOWN.findall(page)}
    files = {command: _file_of(command.split()[0]) for command in shown}
    return sorted(command for command, file in files.items() if "parse_args" in file.read_text())


class _Taken(Exception):
    """The arguments were parsed."""


@pytest.mark.parametrize("command", _commands())
def test_a_command_of_the_documents_is_taken(command: str, monkeypatch: pytest.MonkeyPatch) -> None:
    parse = argparse.ArgumentParser.parse_args

    def stop(parser: argparse.ArgumentParser, *args: Any) -> NoReturn:
        parse(parser, *args)
        raise _Taken

    module, *arguments = shlex.split(command, comments=True)
    name = ".".join(_file_of(module).relative_to(ROOT).with_suffix("").parts)
    monkeypatch.setattr(argparse.ArgumentParser, "parse_args", stop)
    monkeypatch.setattr(sys, "argv", [module, *arguments])
    with pytest.raises(_Taken):
        importlib.import_module(name).main()
