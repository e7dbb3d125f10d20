"""PI's own Python library, unmodified, drives an open-loop stage through `dehyst serve --as gcs`:
real loop, real gateway, real sockets; positions are judged by the loop's own samples."""

import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.rigs.axes_bench import AxesBench
from tests.rigs.gateway_bench import (
    Bench,
    environment,
    kept_targets,
    renewed,
    skipped,
    wait_until,
)

pipython = pytest.importorskip("pipython", reason="PIPython is not installed")
from pipython import GCSDevice, GCSError, pitools  # noqa: E402
from pipython.pidevice.interfaces.pisocket import PISocket  # noqa: E402

from dehyst.daemon.client.client import Client  # noqa: E402
from dehyst.daemon.rings.records import State  # noqa: E402

pytestmark = pytest.mark.processes


class Served:
    """A `dehyst serve --as gcs` for a bench."""

    def __init__(self, *arguments: str) -> None:
        command = [sys.executable, "-m", "dehyst.daemon.main", "serve", "--as", "gcs"]
        self.process = subprocess.Popen(
            [*command, "--listen", "127.0.0.1:0", *arguments],
            env=environment(), stdin=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        assert self.process.stderr is not None
        for line in self.process.stderr:
            if "controller at" in line:
                self.port = int(line.rsplit(":", 1)[1])
                return
        raise AssertionError("it did not start")

    def raw(self) -> socket.socket:
        """Open a connection without a library."""
        return socket.create_connection(("127.0.0.1", self.port), timeout=10)

    def close(self) -> int:
        self.process.terminate()
        _, _ = self.process.communicate(timeout=20)
        return self.process.returncode


@contextmanager
def device(served: Served) -> Iterator[Any]:
    """Yield PIPython's device over its own socket gateway."""
    gateway = PISocket("127.0.0.1", served.port)
    with GCSDevice(gateway=gateway) as found:
        yield found
    found.__dict__["_cleanup"] = lambda: None  # it would close its socket again when collected


def ask(connection: socket.socket, text: str) -> str:
    """Send a text and return one answer, up to an LF without a blank before it."""
    connection.sendall(text.encode("cp1252"))
    answer = b""
    while not answer.endswith(b"\n") or answer.endswith(b" \n"):
        answer += connection.recv(4096)
    return answer.decode("cp1252")


@pytest.fixture(scope="module")
def one(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Bench, Served]]:
    bench = Bench(tmp_path_factory.mktemp("bench"))
    served = None
    try:
        bench.start_gateway()
        bench.client().close()
        served = Served("--connect", bench.address, "--name", "bench")
        yield bench, served
    finally:
        if served is not None:
            assert served.close() == 0
        bench.close()


def test_pipython_connects_moves_and_waits(one: tuple[Bench, Served]) -> None:
    bench, served = one
    with device(served) as stage:
        assert "dehyst, bench" in stage.qIDN()
        assert stage.axes == ["1"]
        with pytest.raises(GCSError) as error:
            stage.MOV("1", 4.0)
        assert error.value == 5  # the servo is off
        pitools.startup(stage, servostates=True)
        assert stage.qSVO()["1"]
        low, high = stage.qTMN()["1"], stage.qTMX()["1"]
        for place in (4.0, 7.5, 5.0):
            stage.MOV("1", place)
            pitools.waitontarget(stage, timeout=20)
            newest = bench.loop.samples(bench.loop.seq - 1)[-1]
            assert newest["target"] == place
            assert abs(newest["predicted"] - place) < 0.002 * (high - low)
            assert stage.qMOV()["1"] == place
            assert abs(stage.qPOS()["1"] - newest["measured"]) < 0.5
        stage.MVR("1", 0.5)
        pitools.waitontarget(stage, timeout=20)
        assert bench.loop.samples(bench.loop.seq - 1)[-1]["target"] == 5.5
        with pytest.raises(GCSError) as error:
            stage.MOV("1", high + 1.0)
        assert error.value == 7
        assert bench.loop.samples(bench.loop.seq - 1)[-1]["target"] == 5.5
        pitools.moveandwait(stage, "1", 6.0)
        assert pitools.ontarget(stage, "1") == {"1": True}
        assert stage.qSPA("1", 0x0E000200)["1"][0x0E000200] == pytest.approx(0.005)


def test_it_stays_where_it_was_sent_until_its_client_leaves(one: tuple[Bench, Served]) -> None:
    bench, served = one
    with device(served) as stage:
        pitools.startup(stage)
        pitools.moveandwait(stage, "1", 6.0)
        assert (kept_targets(bench.loop, 6.0, 600) == 6.0).all()
    # as after any client that leaves, the stage holds, then ramps to the safe voltage
    wait_until("it lets go", lambda: bench.loop.state == State.READY, 30.0)
    assert bench.loop.samples(bench.loop.seq - 1)[-1]["volts"] == pytest.approx(0.0, abs=0.1)


def test_a_scan_by_the_wave_generator(one: tuple[Bench, Served]) -> None:
    bench, served = one
    with device(served) as stage:
        pitools.startup(stage)
        stage.WAV_SIN_P(1, 0, 200, "X", 100, 3.0, 4.0, 200)
        assert stage.qWAV(1, 1)[1][1] == 200
        stage.WSL(1, 1)
        stage.WGC(1, 3)
        stage.WTR(0, 1, 1)
        begun = bench.loop.seq
        stage.WGO(1, 1)
        assert stage.qWGO()[1] == 1
        with pytest.raises(GCSError) as error:
            stage.MOV("1", 4.0)
        assert error.value == 73
        pitools.waitonwavegen(stage, timeout=30)
        samples = bench.loop.samples(begun)
        n = np.arange(200)
        wave = np.tile(4.0 + 1.5 * (1 - np.cos(2 * np.pi * n / 200)), 3)
        target, at_ns = samples["target"], samples["scheduled_ns"]
        peak = int(np.flatnonzero(np.isclose(target, wave.max(), rtol=0, atol=1e-9))[0])
        fits = []
        for first in (100, 300, 500):  # the samples of the earlier peaks may have been skipped
            point = first + np.round((at_ns - at_ns[peak]) / 5e6).astype(int)
            played = (point >= 0) & (point < 600)
            enough = np.count_nonzero(played) > 550 - skipped(samples)
            same = np.allclose(target[played], wave[point[played]], rtol=0, atol=1e-9)
            fits.append(bool(enough and same))
        assert any(fits)
        pitools.waitontarget(stage, timeout=20)  # and it stays at the last point
        assert stage.qMOV()["1"] == pytest.approx(wave[-1])
        header = stage.qGWD(1, 1, 50)
        assert header["NDATA"] == 50
        while stage.bufstate is not True:
            time.sleep(0.05)
        assert np.allclose(stage.bufdata[0], wave[:50], atol=1e-6)


def test_a_stop_ends_a_wave_and_the_stage_stays(one: tuple[Bench, Served]) -> None:
    bench, served = one
    with device(served) as stage:
        pitools.startup(stage)
        points = [4.0 + 2.0 * np.sin(2 * np.pi * k / 100) for k in range(100)]
        pitools.writewavepoints(stage, 2, points, bunchsize=30)
        stage.WSL(1, 2)
        stage.WGC(1, 0)
        stage.WGO(1, 1)
        wait_until("it moves", lambda: bench.loop.samples(bench.loop.seq - 1)[-1]["target"] > 5.0)
        with pytest.raises(GCSError) as error:
            stage.StopAll()
        assert error.value == 10
        stage.StopAll(noraise=True)
        pitools.waitontarget(stage, timeout=20)
        place = stage.qMOV()["1"]
        kept = kept_targets(bench.loop, place, 400)
        assert np.ptp(kept) == 0.0
        assert abs(kept[0] - place) < 1e-6
        assert not stage.IsGeneratorRunning()[1]


def test_what_is_not_spoken_sets_the_standards_error(one: tuple[Bench, Served]) -> None:
    _, served = one
    with served.raw() as connection:
        for text, code in (
            ("XYZ 1\n", 2), ("DRR?\n", 2), ("MOV 9 1\n", 15), ("MOV 1\n", 24), ("MOV 1 abc\n", 25),
            ("MOV 1 nan\n", 25), ("SVO 1 2\n", 17), ("MOV 1 3\n", 5), ("A" * 70_000 + "\n", 3),
            ("SPA? 1 0x123\n", 54), ("WSL 9 1\n", 17), ("STP\n", 10), ("\xff\xfe \x00\n", 2),
        ):  # fmt: skip
            assert ask(connection, text + "ERR?\n") == f"{code}\n", text
            assert ask(connection, "ERR?\n") == "0\n"
        assert ask(connection, "\x07") == "\xb1\n"
        assert ask(connection, "svo?\n") == "1=0\n"


def test_another_client_takes_over_and_the_servo_goes_off(one: tuple[Bench, Served]) -> None:
    bench, served = one
    with device(served) as stage:
        pitools.startup(stage)
        pitools.moveandwait(stage, "1", 5.0)
        with Client("bench", bench.address, label="another") as other:
            other.take_over()
            first = bench.loop.seq
            other.send(6.0)
            with renewed(other):
                wait_until("the servo goes off", lambda: not stage.qSVO()["1"], 20.0)
                with pytest.raises(GCSError) as error:
                    stage.MOV("1", 4.0)
                assert error.value == 5
            targets = bench.loop.samples(first)["target"]  # the set-point may be stale by now
            assert 6.0 in targets
            assert 4.0 not in targets


def test_killed_in_motion_the_stage_ends_as_after_any_client(one: tuple[Bench, Served]) -> None:
    bench, _ = one
    served = Served("--connect", bench.address, "--name", "bench")
    connection = served.raw()
    assert ask(connection, "SVO 1 1\nERR?\n") == "0\n"
    assert ask(connection, "MOV 1 7\nERR?\n") == "0\n"
    wait_until("it moves", lambda: bench.loop.samples(bench.loop.seq - 1)[-1]["target"] == 7.0)
    served.process.kill()
    served.process.communicate()
    connection.close()
    wait_until("it lets go", lambda: bench.loop.state == State.READY, 30.0)
    assert bench.loop.samples(bench.loop.seq - 1)[-1]["volts"] == pytest.approx(0.0, abs=0.1)


def test_silent_connections_are_bounded_and_cost_nobody_else_anything(
    one: tuple[Bench, Served],
) -> None:
    _, served = one
    silent = [served.raw() for _ in range(20)]
    try:
        with silent[0] as first:
            assert ask(first, "ERR?\n") == "0\n"
    finally:
        for connection in silent:
            connection.close()

    def answers() -> bool:
        try:
            with served.raw() as again:
                return ask(again, "CSV?\n") == "2.0\n"
        except (OSError, TimeoutError):
            return False

    wait_until("places are free again", answers, 20.0)


@contextmanager
def two_axes(folder: Path) -> Iterator[tuple[AxesBench, Served]]:
    """Yield a bench of the axes x and y, and the program that serves it."""
    bench = AxesBench(folder, "xy")
    served = None
    try:
        bench.start_gateway()
        served = Served("--connect", bench.address)
        yield bench, served
    finally:
        if served is not None:
            served.close()
        bench.close()


def test_three_axes_move_and_scan_together(tmp_path: Path) -> None:
    with two_axes(tmp_path) as (bench, served), device(served) as stage:
        assert stage.axes == ["X", "Y"]
        pitools.startup(stage)
        pitools.moveandwait(stage, ["X", "Y"], [4.0, 6.0])
        assert bench.loops["x"].samples(bench.loops["x"].seq - 1)[-1]["target"] == 4.0
        assert bench.loops["y"].samples(bench.loops["y"].seq - 1)[-1]["target"] == 6.0
        stage.WAV_RAMP(1, 0, 100, "X", 50, 5, 2.0, 4.0, 100)
        stage.WAV_LIN(2, 0, 100, "X", 5, 1.0, 5.0, 100)
        stage.WSL([1, 2], [1, 2])
        stage.WGC([1, 2], [2, 2])
        stage.WGO([1, 2], [1, 1])
        pitools.waitonwavegen(stage, timeout=30)
        x, y = (bench.loops[axis].samples() for axis in "xy")
        x, y = x[np.isfinite(x["target"])], y[np.isfinite(y["target"])]
        assert np.isclose(x["target"].max(), 6.0, atol=0.01)
        assert np.isclose(y["target"][-1], 6.0, atol=0.03)
        peak = x["scheduled_ns"][np.argmax(x["target"])]
        middle = y["target"][np.searchsorted(y["scheduled_ns"], peak)]
        assert middle == pytest.approx(5.5, abs=0.05)  # on the same samples


def test_a_connection_that_ends_leaves_the_axes_of_another_where_they_are(tmp_path: Path) -> None:
    with two_axes(tmp_path) as (bench, served):
        with served.raw() as first:
            with served.raw() as second:
                first.sendall(b"SVO X 1\nMOV X 4\n")
                assert ask(first, "ERR?\n") == "0\n"
                second.sendall(b"SVO Y 1\nMOV Y 6\nMOV X 5\n")  # X is now the second one's, too
                assert ask(second, "ERR?\n") == "0\n"
                first.sendall(b"MOV X 4\n")  # and the first one's again
                assert ask(first, "ERR?\n") == "0\n"
            wait_until("the second has gone", lambda: ask(first, "SVO? Y\n") == "Y=0\n")
            assert ask(first, "SVO? X\n") == "X=1\n"
            begun = bench.loops["x"].seq
            wait_until("a second passes", lambda: bench.loops["x"].seq > begun + 200)
            assert (bench.loops["x"].samples(begun)["target"] == 4.0).all()
            first.sendall(b"MOV X 4.5\n")
            assert ask(first, "ERR?\n") == "0\n"
        wait_until("it lets go", lambda: bench.loops["x"].state == State.READY, 30.0)
