"""Leases and stops of several axes at once, on a simulated clock: all or none, with the reason."""

import itertools

import numpy as np
import pytest
from tests.rigs.gate import ROOM, Gate

from dehyst.daemon.bus.messages import Reply, Request
from dehyst.daemon.gateway.together import handle_together
from dehyst.daemon.rings.records import LoopCommand

AXES = ("x", "y", "z")


class Gates:
    """Three gates, and requests for several of them by clients 1 and 2."""

    def __init__(self) -> None:
        self.gates = {axis: Gate() for axis in AXES}
        self.lease = {1: 0, 2: 0}

    def ask(self, client: int, action: str, axes: str, asked: str = "") -> Reply:
        gate = self.gates[asked or axes[0]]
        request = Request(
            client=client, lease=self.lease[client], sent_ns=gate.sent(client), label=f"c{client}",
            action=action, axes=tuple(axes),  # type: ignore[arg-type]
        )  # fmt: skip
        doors = {axis: (one.gate, ROOM) for axis, one in self.gates.items()}
        reply, self.records = handle_together(gate.now, request, doors, asked or axes[0])
        if reply.ok and action in ("acquire", "take-over"):
            self.lease[client] = reply.lease
        return reply

    def holders(self) -> list[int]:
        return [
            g.gate.lease.client if g.gate.lease.is_held(g.now) else 0 for g in self.gates.values()
        ]

    def pass_s(self, seconds: float) -> None:
        for gate in self.gates.values():
            gate.now += round(seconds * 1e9)


@pytest.fixture
def gates() -> Gates:
    return Gates()


@pytest.mark.parametrize(
    ("mine", "theirs"),
    [
        (mine, theirs)
        for n, m in itertools.product((1, 2, 3), repeat=2)
        for mine in map("".join, itertools.combinations("xyz", n))
        for theirs in map("".join, itertools.combinations("xyz", m))
    ],
)
def test_a_lease_is_for_all_or_none_whatever_the_other_holds(mine: str, theirs: str) -> None:
    """A lease is granted for all requested axes or for none, for every pair of sets that two
    clients can request; a take-over always succeeds."""
    gates = Gates()
    assert gates.ask(1, "acquire", mine).ok
    before = gates.holders()
    assert before == [1 if axis in mine else 0 for axis in AXES]
    reply = gates.ask(2, "acquire", theirs)
    free = not set(mine) & set(theirs)
    assert reply.ok == free
    if free:
        assert gates.holders() == [1 if a in mine else 2 if a in theirs else 0 for a in AXES]
    else:
        first = next(axis for axis in theirs if axis in mine)
        assert reply.code == "lease-taken"
        assert reply.text.startswith(f"{first}: c1 commands this daemon")
        assert gates.holders() == before
        assert gates.gates[mine[0]].gate.lease.lease == gates.lease[1]  # the old number stays valid
    assert gates.ask(2, "take-over", theirs).ok
    assert gates.holders() == [2 if a in theirs else 1 if a in mine else 0 for a in AXES]


def test_one_number_is_good_at_every_axis_and_ends_with_the_silence(gates: Gates) -> None:
    assert gates.ask(1, "acquire", "xyz").ok
    for gate in gates.gates.values():
        gate.leases[1] = gates.lease[1]
        assert gate.setpoint(1, 2.0).ok
    gates.pass_s(2.0)
    assert gates.ask(1, "renew", "xyz").ok
    gates.pass_s(2.0)
    assert gates.holders() == [1, 1, 1]
    gates.pass_s(2.0)
    assert gates.holders() == [0, 0, 0]
    assert gates.ask(2, "acquire", "yx").ok


def test_a_stop_reaches_all_it_can_and_tells_where_it_cannot(gates: Gates) -> None:
    gates.gates["y"].gate.core.alive = False
    reply = gates.ask(2, "stop", "xyz")
    assert (reply.ok, reply.code) == (False, "no-core")
    assert reply.text.startswith("y: ")
    assert {a: r["kind"].tolist() for a, r in gates.records.items()} == {
        "x": [LoopCommand.STOP_MOTION], "y": [], "z": [LoopCommand.STOP_MOTION],
    }  # fmt: skip
    gates.gates["y"].gate.core.alive = True
    assert gates.ask(2, "release", "zy").ok
    assert {a: r["kind"].tolist() for a, r in gates.records.items()} == {
        "z": [LoopCommand.RELEASE], "y": [LoopCommand.RELEASE],
    }  # fmt: skip


def test_a_take_over_ends_the_trajectories_of_all_axes(gates: Gates) -> None:
    assert gates.ask(1, "acquire", "xy").ok
    times = np.array([0.0, 0.01])
    for axis in "xy":
        gates.gates[axis].leases[1] = gates.lease[1]
        assert gates.gates[axis].chunk(0, times).ok
    assert gates.ask(2, "take-over", "xy").ok
    assert gates.ask(1, "take-over", "xy").ok
    for axis in "xy":
        gates.gates[axis].leases[1] = gates.lease[1]
        assert gates.gates[axis].chunk(1, times + 0.02).code == "over"


@pytest.mark.parametrize(
    ("action", "axes", "asked"),
    [("acquire", "xw", "x"), ("acquire", "xx", "x"), ("acquire", "yz", "x"), ("zero", "xy", "x")],
)
def test_what_makes_no_sense_for_several_is_refused(
    gates: Gates, action: str, axes: str, asked: str
) -> None:
    reply = gates.ask(1, action, axes, asked)
    assert (reply.ok, reply.code) == (False, "bad-message")
    assert gates.holders() == [0, 0, 0]
    assert not any(records.size for records in gates.records.values())


def test_the_points_of_a_group_say_whose_they_are_and_how_many(gates: Gates) -> None:
    assert gates.ask(1, "acquire", "xy").ok
    times = np.array([0.0, 0.01])
    for axis in "xy":
        gate = gates.gates[axis]
        gate.leases[1] = gates.lease[1]
        assert gate.chunk(0, times, axes=("x", "y")).ok
        assert gate.records["group"].tolist() == [9, 9]  # the trajectory's own number
        assert gate.records["members"].tolist() == [2, 2]
    assert gates.gates["x"].chunk(0, times, trajectory=10).ok
    assert gates.gates["x"].records["group"].tolist() == [0, 0]
