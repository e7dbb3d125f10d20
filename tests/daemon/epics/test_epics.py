"""Public clients of Channel Access command a stage: caproto's command line, and ophyd-async's motor
under bluesky's RunEngine. Real loop, real gateway, real `dehyst epics`, all on the loopback."""

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from tests.rigs.gateway_bench import (
    Bench,
    environment,
    free_port,
    kept_targets,
    renewed,
    started_bench,
    wait_until,
)

from dehyst.daemon.client.client import Client
from dehyst.daemon.rings.records import State

pytest.importorskip("caproto", reason="caproto is not installed")
pytestmark = pytest.mark.processes
SCAN = Path(__file__).parent / "ophyd_scan.py"


class Served:
    """`dehyst epics` for a bench, and public clients of it. It runs a repeater of its own: one that
    a client starts by itself keeps the client's pipes open forever."""

    def __init__(self, bench: Bench, *arguments: str) -> None:
        self.port, self.repeater_port = free_port(), free_port()
        self.repeater = subprocess.Popen(
            [sys.executable, "-m", "caproto.commandline.repeater", "--quiet"],
            env=self.environment, stdin=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        command = [sys.executable, "-m", "dehyst.daemon.main", "epics", "--connect", bench.address]
        command += ["--prefix", "LAB:", "--port", str(self.port), "--name", "bench", *arguments]
        self.process = subprocess.Popen(
            command, env=environment(), stdin=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        )
        assert self.process.stderr is not None
        for line in self.process.stderr:
            if line.startswith("dehyst epics: LAB"):
                return
        raise AssertionError("it did not start")

    @property
    def environment(self) -> dict[str, str]:
        """The environment of clients that search on the loopback only."""
        return {
            **os.environ,
            "EPICS_CA_ADDR_LIST": "127.0.0.1",
            "EPICS_CA_AUTO_ADDR_LIST": "NO",
            "EPICS_CA_SERVER_PORT": str(self.port),
            "EPICS_CA_REPEATER_PORT": str(self.repeater_port),
            "CAPROTO_DEFAULT_TIMEOUT": "20",  # for each step of a tool [s]; its default is 2
        }

    def client(self, command: str, *arguments: str) -> "subprocess.CompletedProcess[str]":
        """Run caproto's own command line."""
        return subprocess.run(
            [sys.executable, "-m", f"caproto.commandline.{command}", *arguments],
            env=self.environment, text=True, capture_output=True, timeout=120,
        )  # fmt: skip

    def get(self, name: str) -> str:
        done = self.client("get", "--terse", name)
        assert done.returncode == 0, done.stderr
        return done.stdout.strip().strip("[]b'\"")

    def close(self) -> int:
        self.process.terminate()
        self.process.communicate(timeout=20)
        self.repeater.kill()
        self.repeater.wait()
        return self.process.returncode


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    with started_bench(tmp_path_factory.mktemp("bench")) as bench:
        yield bench


@pytest.fixture
def served(bench: Bench) -> Iterator[Served]:
    served = Served(bench)
    try:
        yield served
    finally:
        assert served.close() == 0


def test_caget_caput_and_what_is_refused(bench: Bench, served: Served) -> None:
    assert served.get("LAB.EGU") == "um"
    low, high = float(served.get("LAB.LLM")), float(served.get("LAB.HLM"))
    assert served.client("put", "-c", "LAB.VAL", "6.5").returncode == 0
    newest = bench.loop.samples(bench.loop.seq - 1)[-1]
    assert newest["target"] == 6.5
    assert abs(newest["predicted"] - 6.5) < 0.002 * (high - low)
    assert served.get("LAB.DMOV") == "1"
    assert abs(float(served.get("LAB.RBV")) - newest["measured"]) < 0.5
    assert float(served.get("LAB:VOLTS")) == pytest.approx(newest["volts"], abs=0.5)
    assert served.get("LAB:STATE") == "running"
    refused = served.client("put", "-c", "LAB.VAL", str(high + 5.0))
    assert refused.returncode != 0 or "fail" in (refused.stdout + refused.stderr).lower()
    assert bench.loop.samples(bench.loop.seq - 1)[-1]["target"] == 6.5
    assert "cannot be reached" in bytes.fromhex(_hex(served, "LAB:MSG")).decode()


def _hex(served: Served, name: str) -> str:
    done = served.client("get", "--format", "{response.data!r}", name)
    text = done.stdout
    if "b'" in text:
        return text.split("b'")[1].split("'")[0].encode().hex()
    numbers = text.split("[")[1].split("]")[0].replace(",", " ").split()
    return bytes(int(n) for n in numbers).hex()


@pytest.mark.parametrize(("field", "value"), [("STOP", "1"), ("SPMG", "0")])
def test_a_stop_ends_the_move_and_holds(
    bench: Bench, served: Served, field: str, value: str
) -> None:
    assert served.client("put", "-c", "LAB.VAL", "3.0").returncode == 0
    assert served.client("put", "LAB.VELO", "0.25").returncode == 0
    assert served.client("put", "LAB.VAL", "8.0").returncode == 0
    wait_until("it moves", lambda: bench.loop.samples(bench.loop.seq - 1)[-1]["target"] > 4.0)
    assert served.client("put", f"LAB.{field}", value).returncode == 0
    wait_until("it stands", lambda: np.ptp(bench.loop.samples(bench.loop.seq - 100)["target"]) == 0)
    place = bench.loop.samples(bench.loop.seq - 1)[-1]["target"]
    assert 4.0 < place < 8.0
    assert (kept_targets(bench.loop, place, 400) == place).all()


@pytest.mark.parametrize("value", ["-1", "0", "nan"])
def test_what_is_no_velocity_is_refused(served: Served, value: str) -> None:
    before = served.get("LAB.VELO")
    refused = served.client("put", "-c", "LAB.VELO", value)
    assert refused.returncode != 0 or "fail" in (refused.stdout + refused.stderr).lower()
    assert served.get("LAB.VELO") == before
    assert "a velocity is greater than 0" in bytes.fromhex(_hex(served, "LAB:MSG")).decode()


def test_a_slow_move_begins_at_the_edge_of_the_reach_where_the_stage_rests_outside(
    bench: Bench, served: Served
) -> None:
    low = float(served.get("LAB.LLM"))
    assert served.client("put", "LAB:HELD", "0").returncode == 0

    def rests_outside() -> bool:
        newest = bench.loop.samples(bench.loop.seq - 1)[-1]
        return newest["state"] == State.READY and newest["predicted"] < low

    wait_until("it rests below the reach", rests_outside)
    assert served.client("put", "LAB.VELO", "2").returncode == 0
    assert served.client("put", "-c", "LAB.VAL", f"{low + 1.0}").returncode == 0
    newest = bench.loop.samples(bench.loop.seq - 1)[-1]
    assert newest["target"] == pytest.approx(low + 1.0)


def test_camonitor_sees_ten_updates_a_second(bench: Bench, served: Served) -> None:
    monitor = subprocess.Popen(
        [sys.executable, "-m", "caproto.commandline.monitor", "LAB.RBV"],
        env=served.environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip
    assert monitor.stdout is not None
    try:
        first = monitor.stdout.readline()
        assert first.startswith("LAB.RBV")
        begun = time.monotonic()
        lines = [monitor.stdout.readline() for _ in range(10)]  # readings always vary by noise
        assert all(line.startswith("LAB.RBV") for line in lines)
        assert time.monotonic() - begun < 10.0
    finally:
        monitor.terminate()
        monitor.communicate(timeout=20)


def test_bluesky_scans_and_flies_an_ophyd_async_motor(bench: Bench, served: Served) -> None:
    begun = bench.loop.seq
    done = subprocess.run(
        [sys.executable, "-W", "ignore", str(SCAN), "LAB"],
        env=served.environment, text=True, capture_output=True, timeout=120,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    targets = bench.loop.samples(begun)["target"]
    for place in (3.0, 4.0, 5.0):
        assert (targets == place).any()
    flown = targets[np.flatnonzero(targets == 5.0)[-1] :]
    assert np.isfinite(flown).all()


def test_an_observer_moves_nothing(bench: Bench) -> None:
    served = Served(bench, "--observe")
    try:
        before = bench.loop.samples(bench.loop.seq - 1)[-1]["target"]
        refused = served.client("put", "-c", "LAB.VAL", "5.0")
        assert refused.returncode != 0 or "fail" in (refused.stdout + refused.stderr).lower()
        after = bench.loop.samples(bench.loop.seq - 1)[-1]["target"]
        assert after == before or np.isnan(after)
    finally:
        served.close()


def test_killed_in_motion_the_stage_ends_as_after_any_client(bench: Bench) -> None:
    served = Served(bench)
    assert served.client("put", "LAB.VAL", "7.0").returncode == 0
    wait_until("it moves", lambda: bench.loop.samples(bench.loop.seq - 1)[-1]["target"] == 7.0)
    served.process.kill()
    served.close()
    wait_until("it lets go", lambda: bench.loop.state == State.READY, 30.0)
    assert bench.loop.samples(bench.loop.seq - 1)[-1]["volts"] == pytest.approx(0.0, abs=0.1)


def test_another_client_is_seen_and_respected(bench: Bench, served: Served) -> None:
    assert served.client("put", "-c", "LAB.VAL", "5.0").returncode == 0
    with Client("bench", bench.address, label="another") as other:
        other.take_over()
        first = bench.loop.seq
        other.send(6.0)
        with renewed(other):
            wait_until("the lease is lost", lambda: served.get("LAB:HELD") == "0", 20.0)
            refused = served.client("put", "-c", "LAB.VAL", "4.0")
        assert refused.returncode != 0 or "fail" in (refused.stdout + refused.stderr).lower()
        targets = bench.loop.samples(first)["target"]  # the set-point may have gone stale since
        assert 6.0 in targets
        assert 4.0 not in targets


def test_beacons_that_nobody_hears_are_not_on_the_screen(bench: Bench, tmp_path: Path) -> None:
    """Without a repeater the kernel refuses every beacon but the first; these refusals are not
    printed."""
    log = tmp_path / "epics.txt"
    command = [sys.executable, "-m", "dehyst.daemon.main", "epics", "--connect", bench.address]
    with open(log, "wb") as words:
        process = subprocess.Popen(
            [*command, "--port", str(free_port())],
            env=environment() | {"EPICS_CAS_BEACON_PORT": str(free_port())},
            stdin=subprocess.DEVNULL, stderr=words,
        )  # fmt: skip
    try:
        wait_until("it serves", lambda: "dehyst epics: dehyst:bench" in log.read_text())
        time.sleep(1.0)  # six beacons, at 0.02, 0.04, ... 0.64 s
    finally:
        process.terminate()
        assert process.wait(20.0) == 0
    assert len(log.read_text().splitlines()) == 1, log.read_text()
