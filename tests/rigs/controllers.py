"""Many controllers and many subscribers on one router: what is lost, and the cost.

It runs a router (docs/examples/router.py with docs/examples/router.json5), `dehyst run` for each
controller (simulated stage, compiled loop; core, gateway and supervisor are processes), and
subscribers in a few processes, each with a session: most receive all topics of one controller,
every tenth receives all controllers. Another client sends every controller set-points in turn.

Counted, on the wire and without the history that could fill a gap: telemetry samples by their
sequence numbers; statuses and events that one subscriber of a controller received and another did
not; set-points put compared with those that the gateways count; queries that were not answered.
"""

import math
import multiprocessing
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import defaultdict, deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from tests.rigs.gateway_bench import ROOT, free_port
from tests.rigs.stage_model import kept_model

from dehyst.daemon.bus import encoding
from dehyst.daemon.bus.keys import Keys
from dehyst.daemon.bus.messages import Command, Event, Reply, Status, TelemetryBatch
from dehyst.daemon.bus.session import Bus, BusError
from dehyst.daemon.client.client import Client
from dehyst.daemon.client.finding import daemons
from dehyst.daemon.files.models import save_model
from dehyst.daemon.loop.timing import realtime

EXAMPLES = ROOT / "docs" / "examples"
EVERYTHING = 10  # every tenth subscriber receives all controllers
SESSIONS = 17  # per process
LATEST_S = 3.0  # how much later than the first subscriber the others may receive a message
START_S = 600.0
COUNTED_S = 10.0  # for the gateways to count the last set-points that were put
CONFIG = """
name = "{name}"
run_dir = "{run}"
model = {{file = "{model}"}}
loop = {{rate_hz = {rate}, cpu = {cpu}}}
telemetry = {{batch_s = {batch}}}
actuator = {{driver = "simulated", settings = {{stage = "s"}}}}
sensor = {{driver = "simulated", settings = {{stage = "s"}}}}
limits = {{min_v = 0.0, max_v = 150.0, slew_v_per_s = 4000.0}}
bus = {{listen = [], connect = ["{address}"]}}
"""


@dataclass
class Heard:
    """What one subscriber received from one controller."""

    subscriber: int
    samples: int = 0
    lost: int = 0
    next_seq: int = -1
    run: int = 0
    bad: int = 0
    ages_ms: list[float] = field(default_factory=list)
    reported: dict[tuple[str, int], int] = field(default_factory=dict)
    """Arrival time of each status (by the samples published before it) and event (by its time)."""

    def take(self, arrived_ns: int, subject: str, payload: bytes) -> None:
        """Count one message."""
        try:
            if subject == "telemetry":
                self._samples(arrived_ns, encoding.decode(TelemetryBatch, payload))
            elif subject == "status":
                published = encoding.decode(Status, payload).gateway.samples_published
                self.reported.setdefault((subject, published), arrived_ns)
            elif subject == "event":
                self.reported.setdefault(
                    (subject, encoding.decode(Event, payload).time_ns), arrived_ns
                )
        except encoding.BadMessage:
            self.bad += 1

    def _samples(self, arrived_ns: int, batch: TelemetryBatch) -> None:
        if batch.run != self.run:
            self.run, self.next_seq = batch.run, batch.first_seq
        self.lost += batch.first_seq - self.next_seq
        self.next_seq = batch.first_seq + batch.count
        self.samples += batch.count
        actual_ns = np.frombuffer(batch.actual_ns, "<i8")
        self.ages_ms.extend(((arrived_ns - actual_ns) * 1e-6).tolist())


def subscribers(address: str, hears: dict[int, str], begin: Any, stop: Any, results: Any) -> None:
    """A process with several sessions. hears: subscriber's number -> controller's name or "*"."""
    realtime.die_with_parent(signal.SIGKILL)
    waiting: deque[tuple[int, int, str, bytes]] = deque()
    heard: dict[tuple[int, str], Heard] = {}
    buses = []
    for number, name in hears.items():
        bus = Bus.connect([address], timeout_s=20.0)
        keys = Keys("dehyst", name)

        def store(key: str, payload: bytes, number: int = number) -> None:
            waiting.append((time.monotonic_ns(), number, key, payload))

        for subject in ("telemetry", "status", "event", "rejection"):
            bus.listen(keys.pubsub(subject), store)
        buses.append(bus)
    results.put(os.getpid())
    begin.wait()
    end_s = math.inf
    while time.monotonic() < end_s:
        if end_s == math.inf and stop.is_set():
            end_s = time.monotonic() + LATEST_S
        while waiting:
            arrived_ns, number, key, payload = waiting.popleft()
            parsed = keys.parse(key)
            mine = heard.setdefault((number, parsed.name), Heard(number))
            mine.take(arrived_ns, parsed.subject, payload)
        time.sleep(0.01)
    results.put(heard)
    for bus in buses:
        bus.close()


def children(pid: int) -> list[int]:
    """Return the processes that this one has started."""
    return [int(p) for p in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def cpu_s(pids: Iterable[int]) -> float:
    """Return user and system time."""
    total = 0
    for pid in pids:
        fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
        total += int(fields[11]) + int(fields[12])
    return total / os.sysconf("SC_CLK_TCK")


def memory_mb(pids: Iterable[int]) -> float:
    """Return the proportional set size."""
    total = 0
    for pid in pids:
        for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines():
            if line.startswith("Pss:"):
                total += int(line.split()[1])
    return total / 1024


class Counted(Client):
    """A client that counts the commands that it asks."""

    asked = 0

    def _ask(self, command: Command, timeout_s: float = 3.0) -> Reply:
        self.asked += 1
        return super()._ask(command, timeout_s)


class Mover:
    """Sends every controller set-points in turn, some asked and some put, and counts them."""

    def __init__(self, address: str, names: list[str]) -> None:
        self.clients = [Counted(name, address, label="mover") for name in names]
        self.put = self.asked = self.unanswered = 0
        self._stop = threading.Event()
        self._before = {c.name: 0 for c in self.clients}
        self._put = {c.name: 0 for c in self.clients}
        self._thread = threading.Thread(target=self._run, daemon=True)

    def start(self) -> None:
        """Start moving."""
        for client in self.clients:
            client.acquire()
            self._before[client.name] = client.status().gateway.commands - client.asked
        self._thread.start()

    def _run(self) -> None:
        turn = 0
        while not self._stop.is_set():
            begun = time.monotonic()
            for i, client in enumerate(self.clients):
                value = 7.0 + 3.0 * np.sin(0.2 * turn + i)
                try:
                    if turn % 5 == 0:
                        client.send(value)
                        self.asked += 1
                    else:
                        client.put(value)
                        self.put += 1
                        self._put[client.name] += 1
                except BusError:
                    self.unanswered += 1
            turn += 1
            self._stop.wait(max(0.0, 0.2 - (time.monotonic() - begun)))

    def end(self) -> int:
        """Stop; return how many set-points did not arrive."""
        self._stop.set()
        self._thread.join(10.0)
        until_s = time.monotonic() + COUNTED_S
        while self._lost() and time.monotonic() < until_s:  # the last ones are still on their way
            time.sleep(0.1)
        lost = self._lost()
        for client in self.clients:
            client.close()
        return lost

    def _lost(self) -> int:
        """Return how many set-points the gateways have not counted."""
        lost = 0
        for client in self.clients:
            now = client.status().gateway.commands
            sent = client.asked + self._put[client.name]
            lost += sent - (now - self._before[client.name])
        return lost


@dataclass
class Result:
    """The result of one run."""

    samples: int
    """Number expected by all subscribers together."""
    lost: int
    reported: int
    """Number of statuses and events expected by all subscribers together."""
    untold: int
    """Number of those that a subscriber missed."""
    put: int
    asked: int
    lost_commands: int
    unanswered: int
    overwritten: int
    """Number of samples that a gateway found overwritten in the ring."""
    missed: int
    """Deadlines missed by all loops."""
    bad: int
    age_ms: tuple[float, float, float]
    cpu: dict[str, float]
    memory: dict[str, float]
    seconds: float
    start_s: float


def end_with_us() -> None:
    """Make a child process end when this process does, however that ends."""
    realtime.die_with_parent(signal.SIGTERM)


class Lab:
    """Router, controllers and subscribers of one run, as processes."""

    def __init__(self, folder: Path, count: int, rate: float, batch_s: float, address: str) -> None:
        self.folder, self.address = folder, address
        self.names = [f"stage-{i + 1:02d}" for i in range(count)]
        endpoints = f'listen/endpoints=["{address}"]'
        self.router = subprocess.Popen(
            [sys.executable, EXAMPLES / "router.py", EXAMPLES / "router.json5", endpoints],
            stdout=subprocess.DEVNULL,
            preexec_fn=end_with_us,
        )
        self.daemons: list[subprocess.Popen[bytes]] = []
        save_model(kept_model(), folder / "model.toml")
        begun = time.monotonic()
        with Bus.connect([address], timeout_s=20.0) as bus:
            for i, name in enumerate(self.names):
                self._start(name, rate, batch_s)
                self._wait(bus, i)  # at most three start at the same time: numba needs time
            self._wait(bus, count + 2)
        self.start_s = time.monotonic() - begun

    def _start(self, name: str, rate: float, batch_s: float) -> None:
        cpus = sorted(os.sched_getaffinity(0))  # pinned: one witness instead of one on each CPU
        config = self.folder / f"{name}.toml"
        config.write_text(
            CONFIG.format(
                name=name, run=self.folder / name, model=self.folder / "model.toml", rate=rate,
                batch=batch_s, cpu=cpus[len(self.daemons) % len(cpus)], address=self.address,
            )
        )  # fmt: skip
        command = [sys.executable, "-P", "-m", "dehyst.daemon.main", "run", "--config", config]
        with open(self.folder / f"{name}.log", "wb") as log:
            self.daemons.append(
                subprocess.Popen(
                    command, stdin=subprocess.DEVNULL, stdout=log, stderr=log,
                    preexec_fn=end_with_us,
                )
            )  # fmt: skip

    def _wait(self, bus: Bus, started: int) -> None:
        """Wait until all but two of the started controllers run."""
        end = time.monotonic() + START_S
        while True:
            there = daemons(bus)
            if len(there) >= started - 2 and all(self._runs(bus, name) for name in there):
                return
            if time.monotonic() > end:
                raise TimeoutError(f"only {there} of {self.names} came up within {START_S:g} s")
            time.sleep(0.1)

    def _runs(self, bus: Bus, name: str) -> bool:
        try:
            answer = next(bus.ask(Keys("dehyst", name).rpc("status"), timeout_s=2.0))
        except BusError:
            return False
        return encoding.decode(Status, answer).core_alive

    def parts(self) -> dict[str, list[int]]:
        """Return the processes by function."""
        found: dict[str, list[int]] = defaultdict(list)
        found["router"] = [self.router.pid]
        for process in self.daemons:
            found["supervisors"].append(process.pid)
            for child in children(process.pid):
                arguments = Path(f"/proc/{child}/cmdline").read_bytes().split(b"\0")
                found["loops" if b"core" in arguments else "gateways"].append(child)
        return found

    def close(self) -> None:
        """End everything that was started."""
        for process in self.daemons:
            process.send_signal(signal.SIGTERM)
        for process in self.daemons:
            process.wait(90.0)
        self.router.terminate()
        self.router.wait(10.0)


def run(
    count: int, listeners: int, seconds: float, rate: float = 50.0, batch_s: float = 0.05
) -> Result:
    """Do one run: controllers, subscribers, duration, loop rate [Hz], length of a batch.

    Raises TimeoutError if the daemons do not come up.
    """
    context = multiprocessing.get_context("spawn")
    begin, stop, results = context.Event(), context.Event(), context.Queue()
    workers = []
    with tempfile.TemporaryDirectory(prefix="dehyst-scale-") as folder:
        lab = Lab(Path(folder), count, rate, batch_s, f"tcp/127.0.0.1:{free_port()}")
        try:
            hears = {
                i: "*" if i % EVERYTHING == EVERYTHING - 1 else lab.names[i % count]
                for i in range(listeners)
            }
            for start in range(0, listeners, SESSIONS):
                part = {i: hears[i] for i in range(start, min(start + SESSIONS, listeners))}
                arguments = (lab.address, part, begin, stop, results)
                workers.append(context.Process(target=subscribers, args=arguments))
                workers[-1].start()
            parts = lab.parts()
            parts["subscribers"] = [results.get(timeout=START_S) for _ in workers]
            mover = Mover(lab.address, lab.names)
            mover.start()
            time.sleep(1.0)
            before = {name: cpu_s(pids) for name, pids in parts.items()}
            begin.set()
            begun, begun_ns = time.monotonic(), time.monotonic_ns()
            time.sleep(seconds)
            spent = time.monotonic() - begun
            cpu = {name: (cpu_s(p) - before[name]) / spent for name, p in parts.items()}
            memory = {name: memory_mb(pids) for name, pids in parts.items()}
            lost_commands = mover.end()
            ended_ns = time.monotonic_ns()
            stop.set()
            accounts: dict[tuple[int, str], Heard] = {}
            for _ in workers:
                accounts |= results.get(timeout=START_S)
            statuses = [last_word(lab.address, name) for name in lab.names]
        finally:
            for worker in workers:
                worker.join(10.0)
                worker.kill()
            lab.close()
    expected = listeners + sum(count - 1 for name in hears.values() if name == "*")
    reported, untold = compare(accounts, begun_ns, ended_ns)
    ages = np.concatenate([np.asarray(h.ages_ms) for h in accounts.values()])
    return Result(
        samples=sum(h.samples + h.lost for h in accounts.values()),
        lost=sum(h.lost for h in accounts.values()) + 10**9 * (expected - len(accounts)),
        reported=reported, untold=untold, put=mover.put, asked=mover.asked,
        lost_commands=lost_commands,
        unanswered=mover.unanswered, overwritten=sum(s.gateway.samples_lost for s in statuses),
        missed=sum(s.missed for s in statuses), bad=sum(h.bad for h in accounts.values()),
        age_ms=tuple(np.percentile(ages, [50, 99, 100]).tolist()), cpu=cpu, memory=memory,
        seconds=spent, start_s=lab.start_s,
    )  # fmt: skip


def last_word(address: str, name: str) -> Status:
    """Return a controller's status."""
    with Client(name, address) as client:
        return client.status()


def compare(
    accounts: dict[tuple[int, str], Heard], begun_ns: int, ended_ns: int
) -> tuple[int, int]:
    """Return (how often statuses and events should have been received, how often one was missed),
    by comparing all subscribers of a controller. Counts messages whose first arrival is between
    these times and after the first message that the subscriber itself received."""
    reported = untold = 0
    by_name: dict[str, list[Heard]] = defaultdict(list)
    for (_, name), heard in accounts.items():
        by_name[name].append(heard)
    for group in by_name.values():
        first: dict[tuple[str, int], int] = {}
        for heard in group:
            for what, arrived_ns in heard.reported.items():
                first[what] = min(arrived_ns, first.get(what, arrived_ns))
        for heard in group:
            since_ns = max(begun_ns, min(heard.reported.values(), default=begun_ns))
            due = {what for what, at in first.items() if since_ns < at < ended_ns}
            reported += len(due)
            untold += len(due - heard.reported.keys())
    return reported, untold
