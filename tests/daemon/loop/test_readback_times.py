"""The figures of the amplifier's slow check, written out: 3 reports, 1 to 2 s, then 1, 5 and 0.25
s."""

from itertools import pairwise

import pytest

from dehyst.daemon.loop.readback import ReadbackCheck

MS = 1_000_000


def written(*steps: tuple[int, float]) -> ReadbackCheck:
    """Return the check of a unit that was at 0 V; steps: (end [ms], volts), written every 10 ms."""
    check, now = ReadbackCheck(2.0, 0.0), 0
    for end, volts in steps:
        while now < end:
            now += 10
            check.wrote(now * MS, volts)
    return check


def test_doubt_begins_with_the_third_report_in_a_row() -> None:
    check = written((100, 10.0))
    assert [check.judge(30.0) for _ in range(2)] == ["", ""]
    assert not check.doubtful
    assert check.judge(30.0) == "disagrees"
    assert check.doubtful


def test_doubt_ends_with_the_third_report_in_a_row() -> None:
    check = written((100, 10.0))
    assert [check.judge(30.0) for _ in range(3)][-1] == "disagrees"
    assert [check.judge(10.0) for _ in range(2)] == ["", ""]
    assert check.doubtful
    assert check.judge(10.0) == "agrees"
    assert not check.doubtful


def test_reports_that_disagree_now_and_then_never_add_up_to_doubt() -> None:
    check = written((100, 10.0))
    for _ in range(20):
        assert [check.judge(v) for v in (30.0, 30.0, 10.0)] == ["", "", ""]
    assert not check.doubtful


def test_reports_that_agree_now_and_then_never_end_the_doubt() -> None:
    check = written((100, 10.0))
    assert [check.judge(30.0) for _ in range(3)][-1] == "disagrees"
    for _ in range(20):
        assert [check.judge(v) for v in (10.0, 10.0, 30.0)] == ["", "", ""]
    assert check.doubtful


@pytest.mark.parametrize(("before_v", "now_v"), [(10.0, 60.0), (60.0, 10.0)])
@pytest.mark.parametrize(("wait_ms", "agrees"), [(200, True), (990, True), (2100, False)])
def test_a_report_may_be_as_old_as_one_to_two_seconds(
    wait_ms: int, agrees: bool, before_v: float, now_v: float
) -> None:
    """The output has moved from one voltage to another and the unit still reports the first: this
    agrees while the second was written less than 1 to 2 s ago."""
    check = written((3000, before_v), (3000 + wait_ms, now_v))
    verdicts = [check.judge(before_v) for _ in range(3)]
    assert verdicts[-1] == ("" if agrees else "disagrees")


def test_what_was_written_in_between_counts_though_the_output_came_back() -> None:
    check = written((3000, 10.0), (3100, 60.0), (3400, 10.0))
    assert [check.judge(59.0) for _ in range(3)] == ["", "", ""]
    assert [check.judge(65.0) for _ in range(3)][-1] == "disagrees"


@pytest.mark.parametrize("tolerance_v", [0.5, 2.0])
def test_the_tolerance_is_the_one_given(tolerance_v: float) -> None:
    for sign in (-1.0, 1.0):
        check = ReadbackCheck(tolerance_v, 10.0)
        assert [check.judge(10.0 + sign * (tolerance_v - 0.01)) for _ in range(3)][-1] == ""
        assert [check.judge(10.0 + sign * (tolerance_v + 0.01)) for _ in range(3)][-1] != ""


@pytest.mark.parametrize(("moving", "doubt", "every_ms"),
    [(False, False, 1000), (True, False, 5000), (True, True, 250), (False, True, 250)],
)  # fmt: skip
def test_the_unit_is_asked_each_second_at_rest_each_five_in_motion_and_four_times_in_doubt(
    moving: bool, doubt: bool, every_ms: int
) -> None:
    check = ReadbackCheck(2.0, 10.0)
    if doubt:
        check.judge(30.0)
    asked = [ms for ms in range(10, 60_000, 10) if check.due(ms * MS, moving)]
    assert asked[0] == every_ms
    assert {b - a for a, b in pairwise(asked)} == {every_ms}


def test_a_link_made_again_begins_without_doubt_and_from_its_own_output() -> None:
    check = written((100, 10.0))
    assert [check.judge(30.0) for _ in range(3)][-1] == "disagrees"
    check.begin(30.0)
    assert not check.doubtful
    assert [check.judge(30.0) for _ in range(3)] == ["", "", ""]
    assert [check.judge(10.0) for _ in range(3)][-1] == "disagrees"
