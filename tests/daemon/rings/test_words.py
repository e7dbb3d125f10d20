"""The description of the positioning: open loop, trimmed or learned, and by how much gauge and
model differ."""

import math
from types import SimpleNamespace
from typing import Any

import pytest

from dehyst.daemon.rings.status import positioning


def said(**given: Any) -> str:
    now = {
        "unit": "um", "trimmed": True, "trim": -0.2134, "trim_frozen": "", "learned": False,
        "differs": 0.2151,
    }  # fmt: skip
    return positioning(SimpleNamespace(**(now | given)))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({}, "trimmed by -0.213 um; the gauge is +0.215 um from the model"),
        ({"trim_frozen": "not_running"}, "trimmed by -0.213 um; the gauge is +0.215"),
        ({"learned": True}, "learned and trimmed by -0.213 um; the gauge"),
        ({"learned": True, "trimmed": False}, "learned; the gauge is"),
        ({"trimmed": False, "trim": 0.0}, "open loop; the gauge is +0.215 um from the model"),
        (
            {"trim_frozen": "jumped"},
            "open loop (trim frozen at -0.213 um: the reading has jumped; waiting until it is back",
        ),
        ({"trim_frozen": "stuck", "learned": True}, "learned (trim frozen at -0.213 um: the gauge"),
        ({"differs": math.nan}, "trimmed by -0.213 um; the gauge gives no reading"),
    ],
)
def test_each_way_has_its_words(given: dict[str, Any], words: str) -> None:
    assert said(**given).startswith(words)
