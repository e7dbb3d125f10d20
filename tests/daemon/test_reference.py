"""The reference pages match the code."""

from pathlib import Path

import pytest

from dehyst.daemon.main import COMMANDS, build_whole_parser
from dehyst.daemon.reference import pages

DOCS = Path(__file__).resolve().parents[2] / "docs"


@pytest.mark.parametrize("name", sorted(pages()))
def test_it_is_current(name: str) -> None:
    assert (DOCS / name).read_text(encoding="utf-8") == pages()[name], "run `make reference`"


def test_every_command_has_an_example() -> None:
    without = {
        name
        for name, parser in build_whole_parser().commands.items()
        if "example" not in (parser.epilog or "")
    }
    assert without == set()
    assert set(COMMANDS) == set(build_whole_parser().commands)
