"""One gateway for three axes, with real loops, real sessions and real clients."""

import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import zenoh
from tests.rigs.axes_bench import AxesBench
from tests.rigs.gateway_bench import (
    forged_setpoint,
    observer_only_hears,
    renewed,
    undisturbed,
    wait_until,
)

from dehyst.daemon.bus import encoding, topics
from dehyst.daemon.bus.session import BusError
from dehyst.daemon.client.client import Client, Refusal
from dehyst.daemon.client.group import Group
from dehyst.daemon.client.player import Played
from dehyst.daemon.rings.records import Flag, LoopCommand, State
from dehyst.models.errors import BadInput

Kinds = Callable[[str, LoopCommand], int]


@pytest.fixture(scope="module")
def stage(tmp_path_factory: pytest.TempPathFactory) -> Iterator[AxesBench]:
    bench = AxesBench(tmp_path_factory.mktemp("stage"))
    try:
        bench.start_gateway()
        yield bench
    finally:
        bench.close()


@pytest.fixture
def kinds(stage: AxesBench) -> Iterator[Kinds]:
    """Count the commands of a kind that an axis has received since the test began."""
    before = {axis: loop.commands.size for axis, loop in stage.loops.items()}

    def count(axis: str, kind: LoopCommand) -> int:
        return int(np.count_nonzero(stage.loops[axis].commands["kind"][before[axis] :] == kind))

    yield count
    for one in stage.open:
        one.close()
    stage.open.clear()


def followed(stage: AxesBench, axis: str, first: int) -> np.ndarray:
    """Return the samples of the first trajectory since sample `first`, without its approach. A loop
    that stood still glides back to its target in mid-trajectory, which is flagged as well."""
    samples = stage.loops[axis].samples(first)
    approach = (samples["flags"] & Flag.APPROACH) != 0
    begun = np.flatnonzero(approach)[0]
    there = ~approach[begun:] & (samples["state"][begun:] == State.RUNNING)
    return samples[begun + np.flatnonzero(there)[0] :]


def test_each_axis_has_its_own_name_and_says_whose_it_is(stage: AxesBench, kinds: Kinds) -> None:
    group = stage.group()
    assert (group.name, list(group)) == ("stage-1", ["x", "y", "z"])
    for axis, status in group.status().items():
        assert status.name == f"stage-1-{axis}"
        assert status.gateway.controller == "stage-1"
        assert status.gateway.axes == ("stage-1-x", "stage-1-y", "stage-1-z")
        assert group[axis].config().axis == axis
        assert group[axis].model().displacement_unit == "um"
    x = stage.client("x")
    x.send(4.0)
    wait_until("x goes there", lambda: x.history(0.1)["target"][-1] == 4.0)
    assert (kinds("x", LoopCommand.SETPOINT), kinds("y", LoopCommand.SETPOINT)) == (1, 0)
    assert np.isnan(group["y"].history(0.1)["target"]).all()


def test_who_asks_for_no_axis_is_reported_which_there_are(stage: AxesBench, kinds: Kinds) -> None:
    with pytest.raises(BusError, match="stage-1-z; choose one: --name stage-1-x"):
        Client(None, stage.address)
    with pytest.raises(BusError, match="no axis w; it has: x, y, z"):
        Group("stage-1", ["x", "w"], stage.address)
    with pytest.raises(BusError, match="no daemon stage-2"):
        Group("stage-2", None, stage.address)
    with Group("stage-1-y", None, stage.address) as one, Group(None, None, stage.address) as all_:
        assert (list(one), list(all_)) == (["y"], ["x", "y", "z"])


def test_a_lease_is_for_all_that_are_asked_for_or_for_none(stage: AxesBench, kinds: Kinds) -> None:
    holder, other = stage.client("y", "the first"), stage.client("x", "the other")
    holder.acquire()
    group = stage.group("xy", "the group")
    with renewed(holder):
        with pytest.raises(Refusal, match="stage-1-y: the first commands this daemon") as refused:
            group.acquire()
        assert refused.value.code == "lease-taken"
        assert other.status().gateway.lease_client == 0  # x was not leased either
        with pytest.raises(Refusal, match="stage-1-y: the first"):
            group.play([0.0, 0.1], {"x": [2.0, 3.0], "y": [2.0, 3.0]})
    assert kinds("x", LoopCommand.POINT) == kinds("y", LoopCommand.POINT) == 0
    group.take_over()
    assert group["x"]._lease == group["y"]._lease != 0
    with pytest.raises(Refusal, match="the group commands this daemon"):
        other.send(3.0)
    with pytest.raises(Refusal, match="the group commands"):
        holder.send(3.0)


def test_a_set_point_out_of_reach_at_one_axis_moves_none(stage: AxesBench, kinds: Kinds) -> None:
    group = stage.group("xy")
    with pytest.raises(BadInput, match="axis y: 1000 um cannot be reached"):
        group.send({"x": 3.0, "y": 1000.0})
    assert kinds("x", LoopCommand.SETPOINT) == 0
    group.send({"x": 3.0, "y": 2.0})
    assert kinds("x", LoopCommand.SETPOINT) == kinds("y", LoopCommand.SETPOINT) == 1
    with pytest.raises(BadInput, match="the axes are: x, y"):
        group.send({"z": 3.0})


def test_one_stop_reaches_all_axes_of_a_group_and_no_other(stage: AxesBench, kinds: Kinds) -> None:
    group = stage.group("xz")
    group.stop()
    wait_until("x and z have it", lambda: kinds("x", LoopCommand.STOP_MOTION) == 1)
    assert [kinds(axis, LoopCommand.STOP_MOTION) for axis in "xyz"] == [1, 0, 1]
    group.release()
    assert [kinds(axis, LoopCommand.RELEASE) for axis in "xyz"] == [1, 0, 1]


def test_a_trajectory_is_played_by_all_axes(stage: AxesBench, kinds: Kinds) -> None:
    group = stage.group("xy")
    t_s = np.arange(0.0, 1.5, 0.005)
    x, y = 5.0 + 2.0 * np.sin(2 * np.pi * t_s), 4.0 - 2.0 * np.cos(2 * np.pi * t_s)

    def points(axis: str) -> int:
        return kinds(axis, LoopCommand.POINT)

    def play() -> dict[str, Played]:
        before = points("x")
        played = group.play(t_s, {"x": x, "y": y})
        for one in played.values():
            assert one.completed, one.reason
        assert played["x"].trajectory == played["y"].trajectory
        assert (points("z"), points("x") - before) == (0, 300)
        return played

    played, _ = undisturbed(stage.loops["x"], play, 0.05)  # after 0.1 s the loop glides
    for axis, one in played.items():
        assert one.tracking.samples == 300
        assert one.tracking.rms_error < 0.2, axis


def test_they_start_on_the_same_sample_however_far_each_comes(
    stage: AxesBench, kinds: Kinds
) -> None:
    group = stage.group("xyz")
    places = {"x": 2.0, "y": 6.0, "z": 9.0}
    group.send(places)

    def arrived(axis: str) -> bool:
        newest = group[axis].history(0.1)[-1]
        return newest["target"] == places[axis] and not newest["flags"] & Flag.APPROACH

    wait_until("they are there", lambda: all(map(arrived, places)))
    t_s = np.arange(0.0, 0.5, 0.005)
    way = 2.0 + 4.0 * np.sin(np.pi * t_s) ** 2
    first = stage.loops["x"].seq
    group.play(t_s, {"x": way, "y": way, "z": way})
    begun = set()
    for axis in "xyz":
        samples = followed(stage, axis, first)[:100]
        begun.add(int(samples["scheduled_ns"][0]))
        time_s = 1e-9 * (samples["scheduled_ns"] - samples["scheduled_ns"][0])
        assert np.allclose(samples["target"], np.interp(time_s, t_s, way), atol=1e-9)
    assert len(begun) == 1


def test_what_one_axis_refuses_moves_none(stage: AxesBench, kinds: Kinds) -> None:
    """The gateway refuses for all axes, whatever the client has checked: x, whose points are valid,
    does not move either."""
    wait_until(
        "earlier motions have ended",
        lambda: all(loop.state is State.READY for loop in stage.loops.values()),
    )
    group = stage.group("xy")
    group.acquire()
    names, offsets = ["stage-1-x", "stage-1-y"], np.array([0, 5_000_000])
    before = stage.loops["x"].seq
    assert group["x"].chunk(31, 0, offsets, np.array([6.0, 6.1]), True, False, None, names).ok
    with pytest.raises(Refusal, match=r"900.* um cannot be reached.*no axis has started"):
        group["y"].chunk(31, 0, offsets, np.array([900.0, 900.1]), True, False, None, names)
    with pytest.raises(
        Refusal,
        match=r"stage-1-y: 900.* um cannot be reached.*no axis "
        r"has started",
    ):
        group["x"].chunk(31, 0, offsets, np.array([6.0, 6.1]), True, False, None, names)
    wait_until("a few samples", lambda: stage.loops["x"].seq > before + 40)
    volts = group["x"].history(0.2)["volts"]
    assert np.ptp(volts) < 1e-12
    assert kinds("x", LoopCommand.POINT) == kinds("y", LoopCommand.POINT) == 0
    played = group.play([0.0, 0.1], {"x": [4.0, 4.1], "y": [4.0, 4.1]})  # the next one can begin
    assert {axis: one.reason for axis, one in played.items()} == {"x": "", "y": ""}


def test_where_one_starves_all_stand_still_together(stage: AxesBench, kinds: Kinds) -> None:
    """When the chunks of y come late, x stops, waits and continues together with y, without a
    jump."""
    group = stage.group("xy")
    group.acquire()
    names, number = ["stage-1-x", "stage-1-y"], 4711
    offsets = np.arange(0, 800) * 5_000_000
    x, y = 3.0 + 2.0 * offsets * 1e-9, 7.0 - offsets * 1e-9
    first = stage.loops["x"].seq

    def send(axis: str, index: int, values: np.ndarray, part: slice, last: bool) -> None:
        group[axis].chunk(number, index, offsets[part], values[part], last, False, None, names)

    send("x", 0, x, slice(0, 400), True)
    send("y", 0, y, slice(0, 200), False)
    time.sleep(1.6)  # y has points for one second, then none
    send("y", 1, y, slice(200, 400), True)
    done = lambda: all(c.status().trajectory_done for c in group.clients.values())  # noqa: E731
    wait_until("they are through", done)
    ways = {}
    for axis in "xy":
        samples = followed(stage, axis, first)
        ways[axis] = samples[samples["state"] == State.RUNNING]
    low = max(int(way["seq"][0]) for way in ways.values())
    high = min(int(way["seq"][-1]) for way in ways.values())
    at = {a: w["target"][(w["seq"] >= low) & (w["seq"] <= high)] for a, w in ways.items()}
    assert np.abs(2.0 * (7.0 - at["y"]) - (at["x"] - 3.0)).max() < 1e-6  # one path in the plane
    x_way = ways["x"]
    steps, periods = np.diff(x_way["target"]), np.diff(x_way["scheduled_ns"]) / 5e6
    assert (np.abs(steps) < 1e-9).sum() > 50  # it stood still
    assert np.all(steps < 0.01 * periods + 1e-9)  # it never jumped
    assert at["x"].max() > 6.9  # it was played to the end


def test_where_one_is_stopped_by_another_client_the_other_holds(
    stage: AxesBench, kinds: Kinds
) -> None:
    group, other = stage.group("xy"), stage.client("y", "the other")
    t_s = np.arange(0.0, 8.0, 0.005)
    begun = stage.loops["x"].seq

    def stop(at_s: float, _total_s: float) -> None:
        if at_s > 0.3 and kinds("y", LoopCommand.STOP_MOTION) == 0:
            other.stop()

    played = group.play(t_s, {"x": 4.0 + 0.2 * t_s, "y": 4.0 + 0.2 * t_s}, progress=stop)
    assert not any(one.completed for one in played.values())
    assert all(one.reason for one in played.values())
    for axis in "xy":
        loop = stage.loops[axis]
        wait_until(f"{axis} is at rest", lambda loop=loop: loop.state is State.READY)
        assert np.nanmax(followed(stage, axis, begun)["target"]) < 4.0 + 0.2 * 4.0


def test_a_group_with_an_axis_that_is_not_there_is_refused(stage: AxesBench, kinds: Kinds) -> None:
    x = stage.client("x")
    offsets, values = np.array([0, 5_000_000]), np.array([4.0, 4.1])
    with pytest.raises(Refusal, match="there are stage-1-x, stage-1-y, stage-1-z"):
        x.chunk(9, 0, offsets, values, True, False, None, ["stage-1-x", "stage-1-w"])
    assert kinds("x", LoopCommand.POINT) == 0


def test_the_gateway_may_be_killed_while_a_group_plays(stage: AxesBench, kinds: Kinds) -> None:
    group = stage.group("xyz")
    t_s = np.arange(0.0, 5.0, 0.005)
    killed: list[float] = []

    def kill(at_s: float, _total_s: float) -> None:
        if at_s > 0.5 and not killed:
            killed.append(at_s)
            stage.kill_gateway()
            stage.start_gateway()

    way = 5.0 + np.sin(2 * np.pi * 0.4 * t_s)
    first = stage.loops["x"].seq
    played = group.play(t_s, {"x": way, "y": way, "z": way}, progress=kill)
    assert killed
    for one in played.values():
        assert one.completed, one.reason
    # if the new gateway came late, the axes stood still together
    ways = {axis: followed(stage, axis, first)[:1000] for axis in "xyz"}
    for samples in ways.values():
        assert np.array_equal(samples["scheduled_ns"], ways["x"]["scheduled_ns"])
        assert np.allclose(samples["target"], ways["x"]["target"], atol=1e-9)


def test_an_axis_that_cannot_play_it_keeps_the_others_still(stage: AxesBench, kinds: Kinds) -> None:
    group = stage.group("xy")
    with pytest.raises(BadInput, match="axis y: 2000 um"):
        group.play([0.0, 0.1], {"x": [2.0, 3.0], "y": [2.0, 2000.0]})
    assert kinds("x", LoopCommand.POINT) == 0


def test_the_roles_hold_at_every_axis(tmp_path: Path) -> None:
    """A role is the same on every axis: the observer receives everything and commands nothing,
    neither one axis nor several together."""
    passwords = tmp_path / "passwords"
    passwords.write_text("alice:correct horse\nbob:battery staple\n")
    for name, line in (("passwords", ""), ("alice", "correct horse"), ("bob", "battery staple")):
        if line:
            (tmp_path / name).write_text(f"{name}:{line}")
        (tmp_path / name).chmod(0o600)
    auth = 'auth = {passwords = "passwords", operators = ["alice"], observers = ["bob"]}, '
    bench = AxesBench(tmp_path, "xy", auth)
    alice, bob = (str(tmp_path / name) for name in ("alice", "bob"))
    try:
        bench.start_gateway()
        for axis in "xy":
            operator = bench.client(axis, credentials=alice)
            _, targets = observer_only_hears(operator, bench.client(axis, credentials=bob))
            assert 4.0 in targets
            operator.give_up()
        group = bench.group(credentials=bob)
        for client in group.clients.values():
            client.patience_s = 0.0
        for command in (group.acquire, group.take_over, group.stop, group.release):
            with pytest.raises(BusError, match="accept these credentials"):
                command()
        before = {axis: loop.commands.size for axis, loop in bench.loops.items()}
        for axis in "xy":
            forged = forged_setpoint(group[axis])
            group.bus.sender(group[axis].keys.pubsub("setpoint_um", "1"), topics.SETPOINT).put(
                encoding.encode(forged)
            )
        with bench.group(credentials=alice) as operators:
            operators.send({"x": 3.0, "y": 3.0})
            wait_until("it arrives", lambda: bench.loops["y"].commands.size > before["y"])
            newest = {axis: loop.commands["value"] for axis, loop in bench.loops.items()}
        assert all(values[before[axis] :].tolist() == [3.0] for axis, values in newest.items())
        with pytest.raises(BusError):
            Group("stage-1", None, bench.address, credentials="")
    finally:
        bench.close()


@pytest.mark.parametrize("method", ["status", "configuration"])
def test_one_query_for_all_axes_is_answered_by_each_under_its_own_key(
    stage: AxesBench, method: str
) -> None:
    """By another program, which keeps zenoh's default: the newest answer of each key."""
    settings = zenoh.Config()
    settings.insert_json5("mode", '"client"')
    settings.insert_json5("connect/endpoints", json.dumps([stage.address]))
    settings.insert_json5("scouting/multicast/enabled", "false")
    keys = {stage.client(axis).keys.rpc(method) for axis in "xyz"}
    with zenoh.open(settings) as session:
        replies = session.get(f"dehyst/@v1/*/rpc/{method}", timeout=10.0)
        assert {str(reply.ok.key_expr) for reply in replies if reply.ok is not None} == keys
