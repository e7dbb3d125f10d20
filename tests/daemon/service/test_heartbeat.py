"""When a process is reported as hanging: never while it starts, and never because of another one's
ring."""

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from dehyst.daemon.rings.records import TELEMETRY
from dehyst.daemon.rings.ring import Ring
from dehyst.daemon.service.heartbeat import Heartbeat, Heartbeats

SAMPLE = np.zeros(1, TELEMETRY)[0]


class Watch:
    """A heartbeat with limits of 10 and 20 s, checked twice a second."""

    def __init__(self, folder: Path) -> None:
        self.heartbeat, self.now_s = Heartbeat(folder, 10.0, 20.0), 0.0
        self.heartbeat.core_started(os.getpid())

    def look(self, seconds: float, act: Callable[[], None] | None = None) -> list[bool]:
        """Return [whether the core was found hanging, whether the gateway was] within `seconds`."""
        found = [False, False]
        for _ in range(round(2 * seconds)):
            self.now_s += 0.5
            if act is not None:
                act()
            self.heartbeat.look(round(self.now_s * 1e9))
            found[0] |= self.heartbeat.core.hangs
            found[1] |= self.heartbeat.gateway.hangs
        return found


@pytest.fixture
def watch(tmp_path: Path) -> Watch:
    return Watch(tmp_path)


def new_ring(folder: Path) -> Ring:
    return Ring.create(folder / "telemetry.ring", TELEMETRY, 64)


def test_one_that_moved_and_stands_still_hangs(tmp_path: Path, watch: Watch) -> None:
    ring = new_ring(tmp_path)

    def both() -> None:
        ring.push(SAMPLE)
        ring.taken(ring.head)

    assert watch.look(30.0, both) == [False, False]
    assert watch.heartbeat.core.moves
    assert watch.look(9.5) == [False, False]
    assert watch.look(1.5) == [True, False]
    assert watch.look(1.0, both) == [False, False]
    assert watch.look(19.0, lambda: ring.push(SAMPLE)) == [False, False]
    assert watch.look(2.0, lambda: ring.push(SAMPLE)) == [False, True]


def test_a_start_is_no_hang_with_no_ring_an_empty_one_or_that_of_the_run_before(
    tmp_path: Path, watch: Watch
) -> None:
    assert watch.look(200.0) == [False, False]  # kernels are being compiled
    ring = new_ring(tmp_path)
    for _ in range(8):
        ring.push(SAMPLE)
    watch.heartbeat.core_started(os.getpid() + 1)  # the core has died; this ring is the old one's
    watch.heartbeat.gateway_started()
    assert watch.look(200.0, lambda: ring.push(SAMPLE)) == [False, False]
    assert not watch.heartbeat.core.moves
    assert watch.look(101.0) == [True, False]  # 300 s are enough for any start


def test_a_gateway_that_starts_beside_a_running_core_is_given_its_time(
    tmp_path: Path, watch: Watch
) -> None:
    ring = new_ring(tmp_path)
    assert watch.look(200.0, lambda: ring.push(SAMPLE)) == [False, False]


def test_a_machine_that_stood_still_is_no_hanging_process(tmp_path: Path, watch: Watch) -> None:
    ring = new_ring(tmp_path)
    watch.look(1.0, lambda: ring.push(SAMPLE))
    watch.now_s += 3600.0
    assert watch.look(0.5) == [False, False]
    watch.now_s += 3600.0
    assert watch.look(0.5) == [False, False]


def test_a_damaged_ring_neither_moves_nor_raises(tmp_path: Path, watch: Watch) -> None:
    ring = new_ring(tmp_path)
    watch.look(2.0, lambda: ring.push(SAMPLE))
    os.truncate(tmp_path / "telemetry.ring", 64)
    assert watch.look(9.0) == [False, False]
    assert watch.look(2.0) == [True, False]


def test_of_several_axes_the_slowest_counts(tmp_path: Path) -> None:
    folders = [tmp_path / axis for axis in "xy"]
    for folder in folders:
        folder.mkdir()
    rings = [new_ring(folder) for folder in folders]
    beats = Heartbeats(folders)
    beats.core_started(os.getpid())
    beats.gateway_started()
    now_s = 0.0

    def look(seconds: float, write: str, take: str) -> None:
        nonlocal now_s
        for _ in range(round(2 * seconds)):
            now_s += 0.5
            for axis, ring in zip("xy", rings, strict=True):
                if axis in write:
                    ring.push(SAMPLE)
                if axis in take:
                    ring.taken(ring.head)
            beats.look(round(now_s * 1e9))

    look(2.0, "x", "x")
    assert not beats.core_moves
    assert not beats.gateway_moves
    look(2.0, "xy", "xy")
    assert beats.core_moves
    assert beats.gateway_moves
    look(11.0, "x", "x")
    assert beats.core_hangs  # y is no longer written
    assert not beats.gateway_hangs  # y has nothing to take
    beats.core_started(os.getpid())
    look(22.0, "xy", "y")
    assert not beats.core_hangs
    assert beats.gateway_hangs
