"""A trajectory of several axes starts on all axes or on none; on a simulated clock."""

from collections.abc import Callable

import numpy as np
import pytest
from tests.rigs.gate import ROOM, Gate, S, grid

from dehyst.daemon.bus.messages import Chunk, Reply, Request, Setpoint
from dehyst.daemon.gateway.group_start import GroupStarts
from dehyst.daemon.gateway.together import handle_together
from dehyst.daemon.rings.records import State

AXES = ("x", "y", "z")


class Start:
    """Three gates, all leased by client 1, and the number of points that reached each loop."""

    def __init__(self) -> None:
        self.gates = {axis: Gate() for axis in AXES}
        self.reports: dict[str, list[str]] = {axis: [] for axis in AXES}
        self.starts = GroupStarts(lambda axis, text: self.reports[axis].append(text))
        self.passed = dict.fromkeys(AXES, 0)
        self.lease = self.together("acquire").lease

    @property
    def now(self) -> int:
        return self.gates["x"].now

    def pass_s(self, seconds: float) -> None:
        for gate in self.gates.values():
            gate.now += round(seconds * S)

    def doors(self) -> dict:
        return {axis: (one.gate, ROOM) for axis, one in self.gates.items()}

    def take(self, records: dict) -> None:
        for axis, of_axis in records.items():
            self.passed[axis] += of_axis.size

    def together(self, action: str, axes: str = "xyz") -> Reply:
        request = Request(
            client=1, lease=getattr(self, "lease", 0), sent_ns=self.gates["x"].sent(1), label="c1",
            action=action, axes=tuple(axes),  # type: ignore[arg-type]
        )  # fmt: skip
        reply, records = handle_together(self.now, request, self.doors(), axes[0])
        self.starts.withdraw(records)
        return reply

    def chunk(self, axis: str, index: int = 0, axes: str = "xyz", **more: object) -> Reply:
        times = grid(0.1 * index, 0.1)
        values = np.full(times.size, more.pop("value", 1.0))
        fields: dict = {
            "client": 1, "lease": self.lease, "trajectory": 9, "index": index,
            "sent_ns": self.gates[axis].sent(1), "unit": "um", "axes": tuple(axes),
            "offset_ns": np.round(times * 1e9).astype("<i8").tobytes(),
            "value": values.astype("<f8").tobytes(),
        }  # fmt: skip
        chunk = Chunk(**(fields | more))
        reply, records = self.starts.handle(self.now, chunk, self.doors(), axis)
        self.take(records)
        return reply


@pytest.fixture
def start() -> Start:
    return Start()


def test_nothing_is_passed_on_until_all_are_here_and_then_all_is(start: Start) -> None:
    assert start.chunk("x").ok
    assert start.chunk("z").ok
    assert start.passed == {"x": 0, "y": 0, "z": 0}
    assert start.chunk("y").ok
    assert start.passed == {"x": 100, "y": 100, "z": 100}
    assert start.chunk("x").code == "duplicate"  # sent again, because the answer was lost
    assert start.chunk("x", 1).ok
    assert start.passed == {"x": 200, "y": 100, "z": 100}


def test_the_answer_that_was_lost_while_it_waits_changes_nothing(start: Start) -> None:
    start.chunk("x")
    assert start.chunk("x").ok
    for axis in "yz":
        start.chunk(axis)
    assert start.passed == {"x": 100, "y": 100, "z": 100}


@pytest.mark.parametrize(
    ("more", "code"),
    [
        ({"value": 5.1}, "unreachable"),
        ({"value": float("nan")}, "not-finite"),
        ({"unit": "nm"}, "unit"),
        ({"lease": 77}, "no-lease"),
        ({"index": 3}, "over"),
    ],
)
def test_what_one_axis_refuses_is_played_by_none(start: Start, more: dict, code: str) -> None:
    start.chunk("x")
    refused = start.chunk("y", **more)
    assert refused.code == code
    assert "no axis has started" in refused.text
    for axis in "xyz":
        again = start.chunk(axis)  # even points that are valid by themselves
        assert again.code == "over"
        assert "y: " in again.text
    assert start.passed == {"x": 0, "y": 0, "z": 0}
    assert all(start.chunk(axis, trajectory=10).ok for axis in "xyz")  # a new one may begin
    assert start.passed == {"x": 100, "y": 100, "z": 100}


def test_what_has_become_impossible_meanwhile_is_seen_at_the_start(start: Start) -> None:
    start.chunk("x")
    start.chunk("y")
    start.gates["x"].gate.core.state = State.FAULT
    refused = start.chunk("z")
    assert (refused.code, refused.ok) == ("state", False)
    assert refused.text.startswith("x: in the state fault")
    assert start.passed == {"x": 0, "y": 0, "z": 0}


def test_whose_first_points_do_not_come_is_reported(start: Start) -> None:
    start.chunk("x")
    start.chunk("y")
    start.pass_s(2.1)
    late = start.chunk("z")
    assert late.code == "over"
    assert "first points of z did not arrive within 2 s; no axis has started" in late.text
    assert "first points of z" in start.chunk("x", 1).text
    assert start.passed == {"x": 0, "y": 0, "z": 0}


def test_further_points_wait_until_all_have_begun(start: Start) -> None:
    start.chunk("x")
    assert start.chunk("x", 1).code == "queue-full"  # the client sends it again
    start.chunk("y")
    start.chunk("z")
    assert start.chunk("x", 1).ok


@pytest.mark.parametrize("action", ["stop", "release"])
def test_a_stop_of_one_ends_the_start_of_all(start: Start, action: str) -> None:
    start.chunk("x")
    start.together(action, "x")
    for axis in "yzx":
        refused = start.chunk(axis)
        assert refused.code == "over"
        assert "x: another command arrived before" in refused.text
    assert start.passed == {"x": 0, "y": 0, "z": 0}


def test_a_set_point_between_ends_it_too(start: Start) -> None:
    start.chunk("x")
    setpoint = Setpoint(
        client=1, lease=start.lease, sequence=0, sent_ns=start.gates["x"].sent(1), value=1.0,
        unit="um",
    )  # fmt: skip
    reply, records = start.gates["x"].gate.handle(start.now, setpoint, ROOM)
    assert reply.ok
    start.starts.withdraw({"x": records})
    assert start.chunk("y").code == start.chunk("z").code == "over"


def test_the_newer_of_two_starts_is_played(start: Start) -> None:
    start.chunk("x")
    for axis in "xy":
        assert start.chunk(axis, axes="xy", trajectory=10).ok
    assert start.passed == {"x": 100, "y": 100, "z": 0}
    assert start.chunk("y").code == "over"


def test_many_starts_that_never_come_leave_no_trace(start: Start) -> None:
    for number in range(100, 200):
        start.chunk("x", trajectory=number)
    assert len(start.starts._starts) <= 16
    assert all(start.chunk(axis).ok for axis in "xyz")
    assert start.passed == {"x": 100, "y": 100, "z": 100}


def late(start: Start) -> str:
    start.pass_s(2.1)
    start.starts.drop_late(start.now)  # the gateway does so by itself: no client sends anything
    start.starts.drop_late(start.now)
    return "y, z did not arrive"


def refused(start: Start) -> str:
    assert start.chunk("y", value=99.0).code == "unreachable"
    return "y: 99 um cannot be reached"


def stopped(start: Start) -> str:
    assert start.together("stop").ok
    return "another command arrived"


def contradicted(start: Start) -> str:
    reply = start.chunk("y", axes="xy")
    assert (reply.ok, reply.code) == (False, "over")
    return "y: its points are for x, y together, those before for x, y, z"


@pytest.mark.parametrize("ends", [late, refused, stopped, contradicted])
def test_every_axis_reports_once_why_none_has_started(
    start: Start, ends: Callable[[Start], str]
) -> None:
    assert start.chunk("x").ok
    why = ends(start)
    assert all(why in said for [said] in start.reports.values())
    assert all(said.endswith("no axis has started") for [said] in start.reports.values())
    assert start.chunk("z").code == "over"
    assert start.passed == {"x": 0, "y": 0, "z": 0}
