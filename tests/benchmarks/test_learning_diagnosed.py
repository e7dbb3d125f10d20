"""A recording with trim must show what the one without it shows, and nothing more is required."""

from tests.benchmarks.bars import Bars
from tests.benchmarks.daemon.learning_diagnosed import CHOSEN, WAYS, judge

CREEP = next(one for one in CHOSEN if one.name == "creep")
SEEN, BEHIND, NOTHING = ["creep", "drift"], ["drift", "creep"], []


def ended(*cases: tuple[list[str], list[str], list[str]]) -> tuple[int, str]:
    bars = Bars()
    named = {seed: dict(zip(WAYS, of, strict=True)) for seed, of in enumerate(cases, 1)}
    row = judge(CREEP, named, bars)
    return bars.code, row


def test_named_first_in_as_many_is_held() -> None:
    code, row = ended((SEEN, SEEN, SEEN), (SEEN, SEEN, SEEN))
    assert (code, row.split()) == (0, ["creep", *["2", "of", "2"] * 3])


def test_one_fewer_is_missed() -> None:
    assert ended((SEEN, SEEN, BEHIND), (SEEN, SEEN, SEEN))[0] == 1
    assert ended((SEEN, NOTHING, SEEN), (SEEN, SEEN, SEEN))[0] == 1


def test_what_the_recording_without_does_not_show_is_said_and_not_asked() -> None:
    code, row = ended((SEEN, SEEN, SEEN), (BEHIND, NOTHING, SEEN))
    assert code == 0
    assert row.endswith("1 of 2          2 of 2   not shown without: [2]")
    assert ended((NOTHING, NOTHING, NOTHING))[0] == 77
