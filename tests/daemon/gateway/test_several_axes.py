"""One gateway for three axes: real loops, real sessions, real clients."""

from collections.abc import Callable, Iterator

import numpy as np
import pytest
from tests.rigs.axes_bench import AxesBench
from tests.rigs.gateway_bench import wait_until

from dehyst.daemon.bus.session import BusError
from dehyst.daemon.client.client import Client, Refusal
from dehyst.daemon.client.group import Group
from dehyst.daemon.rings.records import Command
from dehyst.models.errors import BadInput

Kinds = Callable[[str, Command], int]


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
    """How many commands of a kind an axis was given since the test began."""
    before = {axis: loop.commands.size for axis, loop in stage.loops.items()}

    def count(axis: str, kind: Command) -> int:
        return int(np.count_nonzero(stage.loops[axis].commands["kind"][before[axis] :] == kind))

    yield count
    for one in stage.open:
        one.close()
    stage.open.clear()


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
    assert (kinds("x", Command.SETPOINT), kinds("y", Command.SETPOINT)) == (1, 0)
    assert np.isnan(group["y"].history(0.1)["target"]).all()


def test_who_asks_for_no_axis_is_told_which_there_are(stage: AxesBench, kinds: Kinds) -> None:
    with pytest.raises(BusError, match="stage-1-x, stage-1-y, stage-1-z; name one"):
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
    with pytest.raises(Refusal, match="stage-1-y: the first commands this daemon") as refused:
        group.acquire()
    assert refused.value.code == "lease-taken"
    assert other.status().gateway.lease_client == 0  # nothing is held back
    with pytest.raises(Refusal, match="stage-1-y: the first"):
        group.play([0.0, 0.1], {"x": [2.0, 3.0], "y": [2.0, 3.0]})
    assert kinds("x", Command.POINT) == kinds("y", Command.POINT) == 0
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
    assert kinds("x", Command.SETPOINT) == 0
    group.send({"x": 3.0, "y": 2.0})
    assert kinds("x", Command.SETPOINT) == kinds("y", Command.SETPOINT) == 1
    with pytest.raises(BadInput, match="there are: x, y"):
        group.send({"z": 3.0})


def test_one_stop_reaches_all_axes_of_a_group_and_no_other(stage: AxesBench, kinds: Kinds) -> None:
    group = stage.group("xz")
    group.stop()
    wait_until("x and z have it", lambda: kinds("x", Command.STOP_MOTION) == 1)
    assert [kinds(axis, Command.STOP_MOTION) for axis in "xyz"] == [1, 0, 1]
    group.release()
    assert [kinds(axis, Command.RELEASE) for axis in "xyz"] == [1, 0, 1]


def test_a_trajectory_is_played_by_all_axes(stage: AxesBench, kinds: Kinds) -> None:
    group = stage.group("xy")
    t_s = np.arange(0.0, 1.5, 0.005)
    x, y = 5.0 + 2.0 * np.sin(2 * np.pi * t_s), 4.0 - 2.0 * np.cos(2 * np.pi * t_s)
    played = group.play(t_s, {"x": x, "y": y})
    for axis, one in played.items():
        assert one.completed, one.reason
        assert one.tracking.samples == 300
        assert one.tracking.rms_error < 0.2, axis
    assert played["x"].trajectory == played["y"].trajectory
    assert (kinds("z", Command.POINT), kinds("x", Command.POINT)) == (0, 300)


def test_an_axis_that_cannot_play_it_keeps_the_others_still(stage: AxesBench, kinds: Kinds) -> None:
    group = stage.group("xy")
    with pytest.raises(BadInput, match="axis y: 2000 um"):
        group.play([0.0, 0.1], {"x": [2.0, 3.0], "y": [2.0, 2000.0]})
    assert kinds("x", Command.POINT) == 0
