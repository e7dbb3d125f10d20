"""Axes that are kept for programs that serve others: real loop, gateway and sessions; positions are
judged by the loop's own samples."""

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest
from tests.rigs.gateway_bench import Bench, kept_targets, started_bench, wait_until

from dehyst.daemon.client import held_axes
from dehyst.daemon.client.client import Refusal
from dehyst.daemon.client.group import Group
from dehyst.daemon.client.held_axes import HeldAxes
from dehyst.daemon.rings.records import State
from dehyst.models.errors import DehystError, NotNow

pytestmark = pytest.mark.processes
T_S = np.arange(0.0, 20.0, 0.01)
WAVE = 5.0 + np.sin(2.0 * np.pi * 0.5 * T_S)


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    with started_bench(tmp_path_factory.mktemp("held")) as bench:
        yield bench


@pytest.fixture
def held(rig: Bench) -> Iterator[HeldAxes]:
    with HeldAxes(lambda: Group("bench", connect=rig.address)) as axes:
        yield axes
    wait_until("it is at rest", lambda: rig.loop.state == State.READY)


def axis_of(held: HeldAxes) -> str:
    (axis,) = held.look()
    return axis


def target(rig: Bench) -> float:
    return float(rig.loop.samples(rig.loop.seq - 1)[-1]["target"])


@contextmanager
def busy(held: HeldAxes) -> Iterator[None]:
    """Occupy the thread that uses the bus until the block ends, so that what is asked for waits for
    its turn."""
    begun, over = threading.Event(), threading.Event()

    def wait(_: Group) -> None:
        begun.set()
        over.wait(60.0)

    held._jobs.put(wait)
    begun.wait()
    try:
        yield
    finally:
        over.set()


def test_a_stop_ends_a_wave_that_waits_for_its_turn(rig: Bench, held: HeldAxes) -> None:
    axis = axis_of(held)

    def fly() -> None:
        with pytest.raises(NotNow, match="it was stopped"):
            held.fly(T_S, {axis: WAVE}, repeat=0)

    flying, stopping = threading.Thread(target=fly), threading.Thread(target=held.stop)
    with busy(held):
        flying.start()
        wait_until("it waits", lambda: held._jobs.qsize() == 1)
        begun = rig.loop.seq
        stopping.start()
        wait_until("the stop waits after it", lambda: held._jobs.qsize() == 2)
    for thread in (flying, stopping):
        thread.join(60.0)
        assert not thread.is_alive()
    assert np.isnan(rig.loop.samples(begun)["target"]).all()


def test_a_stop_ends_a_wave_without_end_where_it_is(rig: Bench, held: HeldAxes) -> None:
    axis = axis_of(held)
    held.fly(T_S, {axis: WAVE}, repeat=0)
    wait_until("it moves", lambda: target(rig) > 5.5)
    held.stop()
    assert held.look()[axis].lost == ""
    wait_until("it stands", lambda: np.ptp(rig.loop.samples(rig.loop.seq - 100)["target"]) == 0)


def test_the_end_of_the_program_ends_a_wave_without_end(rig: Bench) -> None:
    axes = HeldAxes(lambda: Group("bench", connect=rig.address))
    axes.fly(T_S, {axis_of(axes): WAVE}, repeat=0)
    wait_until("it moves", lambda: target(rig) > 5.5)
    begun = time.monotonic()
    axes.close()
    assert time.monotonic() - begun < 10.0  # one pass of the wave lasts 20 s
    wait_until("it lets go", lambda: rig.loop.state == State.READY)


def test_what_was_answered_with_an_error_is_not_done_later(
    rig: Bench, held: HeldAxes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(held_axes, "ANSWER_S", 0.3)
    axis, begun = axis_of(held), rig.loop.seq
    with busy(held):
        for ask in (
            lambda: held.go({axis: 7.0}),
            lambda: held.fly(T_S, {axis: WAVE}),
        ):
            with pytest.raises(NotNow, match="it was not done"):
                ask()
    monkeypatch.undo()
    held.take()  # its answer comes after the turns of both
    assert np.isnan(rig.loop.samples(begun)["target"]).all()


def test_after_a_release_the_present_place_counts_and_not_the_last_target(
    rig: Bench, held: HeldAxes
) -> None:
    axis = axis_of(held)
    held.go({axis: 6.0})
    held.let_go()
    assert np.isnan(held.look()[axis].asked)


def test_a_lease_without_a_target_is_kept(rig: Bench, held: HeldAxes) -> None:
    held.take()
    begun = rig.loop.seq
    wait_until("two leases pass", lambda: rig.loop.seq > begun + 2 * 300)  # of 1.5 s, at 200 Hz
    with Group("bench", connect=rig.address) as other, pytest.raises(DehystError, match="commands"):
        other.acquire()


def test_a_stop_that_is_not_answered_gives_the_axis_up(rig: Bench, held: HeldAxes) -> None:
    axis = axis_of(held)
    held.go({axis: 6.0})
    rig.kill_gateway(signal.SIGKILL)
    try:
        with pytest.raises(DehystError):
            held.stop()
        wait_until("it is given up", lambda: "a stop was not answered" in held.look()[axis].lost)
    finally:
        rig.start_gateway()
        rig.client().close()
    begun = rig.loop.seq
    wait_until("a second passes", lambda: rig.loop.seq > begun + 200)
    assert np.isnan(target(rig))


def test_a_repetition_that_was_late_is_sent_again(
    rig: Bench, held: HeldAxes, monkeypatch: pytest.MonkeyPatch
) -> None:
    axis, send, refused = axis_of(held), Group.send, list[object]()
    held.go({axis: 6.0})
    wait_until("it is there", lambda: held.look()[axis].on_target)

    def refusing(group: Group, values: dict[str, float], **more: bool) -> None:
        if len(refused) < 3:
            refused.append(values)
            raise Refusal("late", "made up")
        send(group, values, **more)

    monkeypatch.setattr(Group, "send", refusing)
    wait_until("it was refused three times", lambda: len(refused) == 3)
    assert (kept_targets(rig.loop, 6.0, 500) == 6.0).all()
