"""Every row of docs/attack-table.md names existing tests, and a deliberate mistake shows that they
fail when they should."""

import re
from pathlib import Path
from typing import NamedTuple

import pytest
from tests.mutations.rooms import ROOMS

ROOT = Path(__file__).resolve().parents[2]
TABLE = (ROOT / "docs" / "attack-table.md").read_text()


class Row(NamedTuple):
    """A row: its number, and the tests that cover it, as (file, name or "")."""

    number: str
    tests: tuple[tuple[str, str], ...]


def rows() -> list[Row]:
    found = []
    for number, shown in re.findall(
        r"^\| ([PF]?\d+) \|[^|]*\|[^|]*\|([^|]*)\|[^|]*\|$", TABLE, re.M
    ):
        tests, file = [], ""
        for quoted in re.findall(r"`([^`]*)`", shown):
            before, _, name = quoted.partition("::")
            if quoted.startswith("python "):
                continue  # a benchmark in addition to the tests
            file = before or file
            tests.append((file if file.startswith("tests/") else f"tests/daemon/{file}", name))
        found.append(Row(number, tuple(tests)))
    return found


ROWS = rows()


MISTAKEN = {test.split("[")[0] for room in ROOMS.values() for one in room for test in one.tests}
"""Tests that must notice some deliberate mistake."""


def has_mistake(file: str, name: str) -> bool:
    """Return whether a deliberate mistake names this test or its whole file; for a file without a
    test name, whether one names any test of it."""
    if name:
        return not MISTAKEN.isdisjoint({file, f"{file}::{name}"})
    return any(test.partition("::")[0] == file for test in MISTAKEN)


def test_no_row_is_left_out() -> None:
    assert len(ROWS) == len(re.findall(r"^\| [PF]?\d+ \|", TABLE, re.M))
    assert len({row.number for row in ROWS}) == len(ROWS)


@pytest.mark.parametrize("row", ROWS, ids=[row.number for row in ROWS])
def test_a_row_is_held(row: Row) -> None:
    assert row.tests
    for file, name in row.tests:
        assert (ROOT / file).exists(), file
        assert not name or f"def {name}(" in (ROOT / file).read_text(), f"{file}::{name}"
    assert any(has_mistake(*test) for test in row.tests)
    for file, name in row.tests:
        assert name or has_mistake(file, name), f"no mistake for {file}"
