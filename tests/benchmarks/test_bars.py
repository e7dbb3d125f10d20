"""How a benchmark ends: 0, 1 and 77 have their defined meanings, in words too."""

import math

import pytest
from tests.benchmarks.bars import Bars, too_busy


def test_all_held_is_0() -> None:
    bars = Bars()
    bars.most("time", 1.0, 1.0, "s")
    bars.least("rate", 2.0, 1.0)
    bars.none("lost", 0)
    assert (bars.code, bars.table().splitlines()[-1]) == (0, "all 3 bars held")


@pytest.mark.parametrize(
    "miss",
    [
        lambda bars: bars.most("time", 1.01, 1.0),
        lambda bars: bars.most("time", math.nan, 1.0),
        lambda bars: bars.least("rate", 0.99, 1.0),
        lambda bars: bars.least("rate", math.nan, 1.0),
        lambda bars: bars.none("lost", 1),
    ],
)
def test_one_missed_is_1_whatever_could_not_be_judged(miss) -> None:  # type: ignore[no-untyped-def]
    bars = Bars()
    bars.none("lost", 0)
    bars.cannot("ratio", "no cyclictest")
    miss(bars)
    assert bars.code == 1
    assert bars.table().splitlines()[-1] == "1 of 3 bars missed"
    assert "MISSED" in bars.table()


def test_not_judged_is_77_and_never_all_held() -> None:
    bars = Bars()
    assert bars.code == 77
    bars.none("lost", 0)
    bars.cannot("ratio", "no cyclictest")
    assert bars.code == 77
    assert bars.table().splitlines()[-1] == "1 of 2 bars could not be judged, the others held"
    assert "not judged  no cyclictest" in bars.table()


def test_a_busy_machine_is_reported_by_its_load(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.sched_getaffinity", lambda _: {0, 1})
    monkeypatch.setattr("os.getloadavg", lambda: (0.9, 0.0, 0.0))
    assert too_busy() == ""
    monkeypatch.setattr("os.getloadavg", lambda: (1.1, 0.0, 0.0))
    assert "load average 1.1 on 2 processors" in too_busy()
