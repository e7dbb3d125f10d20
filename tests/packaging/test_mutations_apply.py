"""Every deliberate mistake can still be applied; `python -m tests.mutations` applies them."""

from pathlib import Path

import pytest
from tests.mutations.rooms import ROOMS

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("room", ROOMS)
def test_each_mistake_of_a_room_can_be_made(room: str) -> None:
    for change in ROOMS[room]:
        text = (ROOT / change.file).read_text()
        assert change.changed(text) != text, change.name
        for test in change.tests:
            path, _, name = test.partition("::")
            assert (ROOT / path).exists(), f"{change.name}: {path}"
            bare = name.split("[")[0].rpartition("::")[2]
            assert bare in (ROOT / path).read_text() if name else True, f"{change.name}: {test}"
