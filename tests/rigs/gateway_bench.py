"""A real gateway process between real zenoh sessions and the real loop's process."""

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

import numpy as np
import pytest
from tests.rigs.processes import one_cpu
from tests.rigs.stage_model import model_text

from dehyst.daemon.bus import messages
from dehyst.daemon.bus.session import BusError
from dehyst.daemon.client.client import Client
from dehyst.daemon.client.telemetry import StatusFeed, TelemetryStream
from dehyst.daemon.config import Config, load_config
from dehyst.daemon.gateway.core_rings import LAYOUTS
from dehyst.daemon.rings.records import State
from dehyst.daemon.rings.ring import Ring
from dehyst.models.errors import BadInput, DehystError

ROOT = Path(__file__).resolve().parents[2]
T = TypeVar("T")
STANDSTILL_S = 0.5
"""A process that stood still for longer may have missed a deadline of the bus: set-points expire
after 1 s, leases after 1.5 s."""
STARVES_S = 0.1
"""A stream of points that stood still for longer than what was sent ahead of it ends: the loop
glides to a stop after this time without a point."""


def free_port() -> int:
    """Return a TCP port on loopback that is free at present."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def wait_until(what: str, check: Callable[[], bool], timeout_s: float = 60.0) -> None:
    """Poll until true; the test fails after timeout_s, on a busy machine after twice as long."""
    end = time.monotonic() + 2.0 * timeout_s
    while not check():
        if time.monotonic() > end:
            pytest.fail(f"did not happen within {timeout_s:g} s: {what}")
        time.sleep(0.01)


def answering(port: int, what: str = "the gateway answers") -> Client:
    """Return a client of the controller `test` as soon as its gateway answers."""
    found: list[Client] = []

    def answers() -> bool:
        try:
            found.append(Client("test", f"tcp/127.0.0.1:{port}"))
        except DehystError:
            return False
        return True

    wait_until(what, answers, 120.0)
    return found[0]


class Core:
    """The loop's own process on the simulated stage, and its rings."""

    def __init__(self, config: Config, path: Path) -> None:
        self.config = config
        command = [sys.executable, "-m", "dehyst.daemon.main", "core", "--config", str(path)]
        self.process = subprocess.Popen(command, env=environment(), stdin=subprocess.DEVNULL)

    def running(self) -> bool:
        """Whether this process (not an earlier one) has written a sample and reported it."""
        if self.process.poll() is not None:
            pytest.fail(f"the loop ended with code {self.process.returncode}")
        try:
            said = self.ring("status").read(0)[0]
        except BadInput:
            return False
        return bool(said.size and said[-1]["pid"] == self.process.pid and said[-1]["samples"] > 0)

    def ring(self, name: str) -> Ring:
        """Return one of its rings, opened as another process does."""
        return Ring.attach(self.config.directory / f"{name}.ring", LAYOUTS[name])

    def samples(self, first: int = 0) -> np.ndarray:
        """Return the telemetry records from number `first` on."""
        return self.ring("telemetry").read(first)[0]

    @property
    def seq(self) -> int:
        """The number of samples so far."""
        return self.ring("telemetry").head

    @property
    def state(self) -> State:
        """The state of the newest sample."""
        return State(int(self.samples(self.seq - 1)[-1]["state"]))

    @property
    def commands(self) -> np.ndarray:
        """Return all commands that it received (as many as its ring holds)."""
        return self.ring("command").read(0)[0]

    def close(self, number: int = signal.SIGKILL) -> None:
        """End the process."""
        if self.process.poll() is None:
            self.process.send_signal(number)
        self.process.wait(20.0)


def longest_pause_s(samples: np.ndarray) -> float:
    """Return the longest time between two wake-ups of the loop [s], by its own record."""
    return float(np.diff(samples["actual_ns"]).max(initial=0)) * 1e-9


def skipped(samples: np.ndarray, rate_hz: float = 200.0) -> int:
    """Return how many points of its grid the loop skipped because it was late."""
    periods = np.rint(np.diff(samples["scheduled_ns"]) * 1e-9 * rate_hz).astype(int)
    return int((periods - 1).sum())


def may_lack(samples: np.ndarray) -> int:
    """Return how many samples of a trajectory may be missing: the loop holds the last target for
    1 s (200 samples) and makes up for skipped points then, but not for more of them."""
    return max(0, skipped(samples) - 100)


@contextmanager
def noted_pauses() -> Iterator[list[float]]:
    """Yield a list to which a thread adds every 10 ms how long it has waited [s]: whatever holds up
    this process is in it."""
    over, pauses = threading.Event(), [0.0]

    def note() -> None:
        before, ended = time.monotonic(), False
        while not ended:
            ended = over.wait(0.01)
            now = time.monotonic()
            pauses.append(now - before)
            before = now

    thread = threading.Thread(target=note)
    thread.start()
    try:
        yield pauses
    finally:
        over.set()
        thread.join()


def undisturbed(
    loop: Core, act: Callable[[], T], longest_s: float = STANDSTILL_S
) -> tuple[T, np.ndarray]:
    """Return the value of `act` and the loop's samples meanwhile, from the first of three attempts
    in which neither this process stood still nor the loop for longer than longest_s; if there is
    none, the test is skipped. An exception is raised where this process did not even stand still
    for long enough that a stream starves."""
    for _ in range(3):
        first = loop.seq
        failed: Exception | None = None
        with noted_pauses() as pauses:
            try:
                value = act()
            except Exception as error:  # whatever it is: raised below
                failed = error
        samples = loop.samples(first)
        own_s, pause_s = max(pauses), longest_pause_s(samples)
        if own_s <= (STARVES_S if failed else STANDSTILL_S) and pause_s <= longest_s:
            if failed is not None:
                raise failed
            return value, samples
    pytest.skip(
        f"nothing can be judged: in the last of three attempts the loop stood still for "
        f"{pause_s:.2g} s and the test for {own_s:.2g} s"
    )


def kept_targets(loop: Core, place: float, count: int) -> np.ndarray:
    """Return the targets of the next `count` samples. If they change while the loop stands still,
    the set-point may have gone stale: the next interval counts, once the target is `place` again;
    after three of them the test is skipped."""
    since = max(loop.seq - 200, 0)
    for _ in range(3):
        begun = loop.seq
        wait_until(f"{count} samples pass", lambda end=begun + count: loop.seq > end)
        samples = loop.samples(since)
        targets, pause_s = samples["target"][samples["seq"] >= begun], longest_pause_s(samples)
        if np.ptp(targets) == 0.0 or pause_s <= STANDSTILL_S:
            return targets
        back = lambda: abs(loop.samples(loop.seq - 1)[-1]["target"] - place) < 1e-6  # noqa: E731
        wait_until("the target is back", back)
        since = loop.seq
    pytest.skip(
        f"nothing can be judged: in each of three attempts the loop stood still, at last for "
        f"{pause_s:.2g} s"
    )


def environment() -> dict[str, str]:
    """Return the environment for processes of this source tree."""
    return {k: v for k, v in os.environ.items() if k != "NOTIFY_SOCKET"} | {
        "PYTHONPATH": str(ROOT / "src"), "DEHYST_SUPERVISED": "1",
        "PYTHONFAULTHANDLER": "1",
    }  # fmt: skip


CONFIG = """
name = "bench"
run_dir = "{run_dir}"
model = {{file = "model.toml"}}
actuator = {{driver = "simulated", settings = {{stage = "bench"}}}}
sensor = {{driver = "simulated", settings = {{stage = "bench"}}}}
limits = {{min_v = 0.0, max_v = 95.0, slew_v_per_s = 10000.0}}
trim = {{enabled = false}}
loop = {{rate_hz = 200.0, cpu = {cpu}}}
safe = {{voltage_v = 0.0, ramp_v_per_s = 1000.0}}
setpoint = {{stale_s = 1.0, hold_s = 0.2, approach_um_per_s = 200.0, queue_s = 10.0, lease_s = 1.5}}
bus = {{listen = ["tcp/127.0.0.1:{port}"]}}
"""


class Bench:
    """Loop and gateway of one test, each in a process; `client()` connects to the gateway. start:
    False leaves the rings to the caller; replaced: text in the configuration."""

    def __init__(self, folder: Path, start: bool = True, **replaced: str) -> None:
        self.port = free_port()
        self.path = folder / "bench.toml"
        (folder / "model.toml").write_text(model_text())
        text = CONFIG.format(run_dir=folder / "run", port=self.port, cpu=one_cpu())
        for old, new in replaced.items():
            text = text.replace(old, new)
        self.path.write_text(text)
        self.config = load_config(self.path)
        self.address = f"tcp/127.0.0.1:{self.port}"
        self.has_loop = start
        if start:
            self.start_loop()
        self.gateway: subprocess.Popen[bytes] | None = None
        self.clients: list[Client] = []

    def start_loop(self) -> None:
        """Start the loop's process; `start_gateway` and `client` wait for it."""
        self.loop = Core(self.config, self.path)

    def start_gateway(self) -> None:
        """Start the gateway process and wait until a client can ask it, and until the loop runs."""
        command = [sys.executable, "-m", "dehyst.daemon.main", "gateway", "--config"]
        self.gateway = subprocess.Popen([*command, str(self.path)], env=environment())
        wait_until("the gateway listens", self._listens)
        if self.has_loop:
            # the kernels may have to be compiled first
            wait_until("the loop runs", self.loop.running, 240.0)

    def _listens(self) -> bool:
        with socket.socket() as probe:
            return probe.connect_ex(("127.0.0.1", self.port)) == 0

    def client(self, label: str = "") -> Client:
        """Return a connected client; it is closed with the bench."""
        client = Client("bench", self.address, label=label)
        self.clients.append(client)

        wait_until("the gateway has seen the loop", lambda: follows(client))
        return client

    def rest(self) -> None:
        """Close the clients; return when nobody commands and nothing moves."""
        for client in self.clients:
            client.close()
        self.clients.clear()
        with Client("bench", self.address) as asking:
            wait_until("the gateway has seen the loop", lambda: follows(asking))
            asking.stop()

            def rests() -> bool:
                status = asking.status()
                return status.state == "ready" and status.gateway.lease_client == 0

            wait_until("it rests", rests)

    def kill_gateway(self, number: int = signal.SIGKILL) -> int:
        """Send a signal to the gateway and return its exit code."""
        assert self.gateway is not None
        self.gateway.send_signal(number)
        return self.gateway.wait(10.0)

    def close(self) -> None:
        """End everything."""
        for client in self.clients:
            client.close()
        if self.gateway is not None and self.gateway.poll() is None:
            self.gateway.kill()
            self.gateway.wait(10.0)
        if self.has_loop:
            self.loop.close()


@contextmanager
def started_bench(folder: Path, **replaced: str) -> Iterator[Bench]:
    """Yield a bench whose gateway has seen the loop; it ends with the block."""
    bench = Bench(folder, **replaced)
    try:
        bench.start_gateway()
        bench.client().close()
        yield bench
    finally:
        bench.close()


def wait_until_heard(feed: StatusFeed) -> None:
    """Wait until the daemon knows all subscriptions of the feed, which its second status proves:
    earlier one-time reports are lost."""
    wait_until("a status is heard", lambda: feed.status is not None)
    first_ns = feed.status_at_ns
    wait_until("another one", lambda: feed.status_at_ns > first_ns)


def follows(client: Client) -> bool:
    """Return whether the loop is seen and past its start, so that its state refuses no command."""
    status = client.status()
    return status.core_alive and status.state != "start"


def observer_only_hears(operator: Client, observer: Client) -> tuple[TelemetryStream, set[float]]:
    """Check that an observer receives the operator's motion and answers to queries, and that its
    commands are refused. Returns its stream and the targets received so far."""
    wait_until("the loop is seen", lambda: follows(operator))
    feed, stream = observer.feed(), observer.stream()
    assert observer.model().displacement_unit == "um"
    operator.send(3.0)
    operator.put(4.0)
    targets: set[float] = set()

    def reported() -> bool:
        targets.update(stream.read(0.1)["target"].tolist())
        return 4.0 in targets and feed.status is not None

    wait_until("the observer hears of it", reported)
    assert observer.history(0.2).size > 10
    assert observer.doctor() == ()
    observer.patience_s = 0.0
    accept = lambda: observer.decide_offer("accept", 1)  # noqa: E731
    for action in (lambda: observer.send(5.0), observer.stop, observer.take_over, accept):
        with pytest.raises(BusError, match="accept these credentials"):
            action()
    return stream, targets


def forged_setpoint(operator: Client) -> messages.Setpoint:
    """Return a set-point under the operator's lease, as if the lease had been overheard."""
    return messages.Setpoint(
        client=operator.client, lease=operator._lease, sequence=99, sent_ns=time.monotonic_ns(),
        value=9.0, unit="um",
    )  # fmt: skip


@contextmanager
def renewed(client: Client) -> Iterator[None]:
    """Keep a client's lease renewed, however long the block takes."""
    over = threading.Event()

    def renew() -> None:
        while not over.wait(0.2):
            client.renew()

    thread = threading.Thread(target=renew)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
