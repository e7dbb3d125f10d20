"""Processes and measurements for deadlines.py: the core, cyclictest, loads, subscribers."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from tests.benchmarks.daemon.doctor_load import lay_cases
from tests.rigs.gateway_bench import free_port

from dehyst.daemon.config import load_config
from dehyst.daemon.files.models import save_model
from dehyst.daemon.rings.records import COMMAND, TELEMETRY, LoopCommand, MissCause
from dehyst.daemon.rings.ring import Ring
from dehyst.daemon.rings.status import STATUS
from dehyst.models.errors import BadInput
from dehyst.models.model import Hysteresis, Model, Validity

CONFIG = """
name = "bench"
run_dir = "{folder}/run"
model = {{file = "model.toml"}}
loop = {{rate_hz = {rate}, cpu = {cpu}, engine = "{engine}", priority = 80}}
actuator = {{driver = "simulated", settings = {{stage = "b"}}}}
sensor = {{driver = "simulated", settings = {{stage = "b"}}}}
limits = {{min_v = 0.0, max_v = 150.0, slew_v_per_s = 20000.0}}
safe = {{voltage_v = 5.0, ramp_v_per_s = 2000.0}}
setpoint = {{stale_s = 3600.0}}
bus = {{listen = ["tcp/127.0.0.1:{port}"]}}
"""
BURN = "while True: pass"
BURNING_GATEWAY = """
import sys, threading
from dehyst.daemon.main import main
def burn():
    while True:
        pass
for _ in range(2):
    threading.Thread(target=burn, daemon=True).start()
sys.exit(main(["gateway", "--config", sys.argv[1]]))
"""
SUBSCRIBERS = """
import json, sys, time
from dehyst.daemon.client.client import Client
address, count, seconds = sys.argv[1], int(sys.argv[2]), float(sys.argv[3])
clients = [Client("bench", address) for _ in range(count)]
streams = [client.stream() for client in clients]
end, heard = time.monotonic() + seconds, [0] * count
first, last = [None] * count, [0] * count
while time.monotonic() < end:
    for i, stream in enumerate(streams):
        records = stream.read(0.0)
        if records.size:
            heard[i] += records.size
            first[i] = int(records["seq"][0]) if first[i] is None else first[i]
            last[i] = int(records["seq"][-1])
    time.sleep(0.01)
print(json.dumps([[n, b - a + 1, s.lost, s.recovered] for n, a, b, s in
                  zip(heard, first, last, streams, strict=True) if a is not None]), flush=True)
for client in clients:
    client.close()
"""


CASES = 60  # more than a doctor can examine in one window
BROWSER = """
import json, sys
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect
look = '{"ask":"look","name":"%s","window_s":10,"width_px":1000}'
address = sys.argv[1]
with connect(f"ws://{address}/stream", origin=f"http://{address}", compression=None) as socket:
    looks = False
    try:
        while True:
            message = socket.recv()
            if looks or not isinstance(message, str):
                continue
            said = json.loads(message)
            if said["kind"] == "controllers" and said["names"]:
                socket.send(look % said["names"][0])
                looks = True
    except ConnectionClosed:  # the page has ended
        pass
"""


def model() -> Model:
    """Return a monotone, rate-independent model with 16 elements."""
    r = 150.0 * (np.arange(16) / 16) ** 1.5 / 2
    return Model(
        Hysteresis(r=r, b=np.r_[0.09, np.full(15, 0.002)], c=np.array([0.0, 1.0])),
        Validity(0.0, 150.0),
    )


def python(code: str, *arguments: str, **options: Any) -> "subprocess.Popen[str]":
    """Start a piece of Python."""
    return subprocess.Popen(
        [sys.executable, "-c", code, *arguments], text=True, stdin=subprocess.DEVNULL, **options
    )


def end(process: "subprocess.Popen[str]") -> None:
    """Send SIGTERM, then SIGKILL."""
    process.send_signal(signal.SIGTERM)
    try:
        process.wait(20.0)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait(5.0)


class Core:
    """A `dehyst core` on the in-process simulated stage, following a set-point."""

    def __init__(self, folder: Path, rate: float, cpu: int, engine: str, port: int) -> None:
        self.folder, self.address = folder, f"tcp/127.0.0.1:{port}"
        save_model(model(), folder / "model.toml")
        self.config = folder / "config.toml"
        self.config.write_text(
            CONFIG.format(folder=folder, rate=float(rate), cpu=cpu, engine=engine, port=port)
        )
        shutil.rmtree(folder / "run", ignore_errors=True)
        begin = time.monotonic()
        self.process = subprocess.Popen(
            [sys.executable, "-m", "dehyst.daemon.main", "core", "--config", str(self.config)],
            stdin=subprocess.DEVNULL,
        )
        self.telemetry = self._attach("telemetry", TELEMETRY)
        while self.telemetry.head == 0:
            self._check()
            time.sleep(0.002)
        self.start_s = time.monotonic() - begin
        self.status = self._attach("status", STATUS)
        row = np.zeros(1, COMMAND)
        row["kind"], row["value"] = LoopCommand.SETPOINT, 5.0
        commands = self._attach("command", COMMAND)
        commands.push(row[0])
        self.tail = 0

    def _check(self) -> None:
        if self.process.poll() is not None:
            raise SystemExit(f"the core ended with code {self.process.returncode}")

    def _attach(self, name: str, dtype: np.dtype[Any]) -> Ring:
        while True:
            try:
                return Ring.attach(self.folder / "run" / f"{name}.ring", dtype)
            except BadInput:
                self._check()
                time.sleep(0.002)

    def drain(self) -> np.ndarray:
        """Return the records since the last call."""
        records, self.tail, lost = self.telemetry.read(self.tail)
        assert lost == 0 or self.tail == records.size + lost, "the benchmark was too slow"
        return records

    def loop_thread(self) -> int:
        """Return the thread id of the loop: FIFO at priority 80."""
        for task in Path(f"/proc/{self.process.pid}/task").iterdir():
            number = int(task.name)
            if os.sched_getparam(number).sched_priority == 80:
                return number
        return self.process.pid

    def faults(self) -> tuple[int, int]:
        """Return the (minor, major) page faults of the loop's thread."""
        path = Path(f"/proc/{self.process.pid}/task/{self.loop_thread()}/stat")
        fields = path.read_text().rpartition(")")[2].split()
        return int(fields[7]), int(fields[9])

    def rss_kb(self) -> int:
        """Return the resident memory."""
        text = Path(f"/proc/{self.process.pid}/status").read_text()
        return int(re.search(r"VmRSS:\s+(\d+)", text).group(1))  # type: ignore[union-attr]

    def close(self) -> None:
        """Send SIGTERM and wait."""
        end(self.process)  # type: ignore[arg-type]


@dataclass
class Window:
    """One measurement."""

    rate: float
    load: str
    wake_us: np.ndarray = field(default_factory=lambda: np.zeros(0))
    samples: int = 0
    missed: int = 0
    by: dict[str, int] = field(default_factory=dict)
    cyclic: dict[int, int] = field(default_factory=dict)  # cyclictest's histogram
    exec_us: float = 0.0
    rss_kb: int = 0
    faults: tuple[int, int] = (0, 0)
    subscribers: list[list[int]] = field(default_factory=list)

    @property
    def outside(self) -> int:
        """Missed deadlines that the witness does not explain."""
        excused = {"stall", "steal", "suspended", "preempted"}
        return sum(n for name, n in self.by.items() if name not in excused)

    @property
    def too_late(self) -> float:
        """Share of cyclictest's wake-ups that would have missed the loop's deadline."""
        slack_us = 1e6 / self.rate - self.exec_us
        late = sum(n for us, n in self.cyclic.items() if us >= slack_us)
        return late / max(1, sum(self.cyclic.values()))

    def add(self, other: "Window") -> None:
        """Add another window of the same kind."""
        self.wake_us = np.concatenate([self.wake_us, other.wake_us])
        self.samples += other.samples
        self.missed += other.missed
        for name, n in other.by.items():
            self.by[name] = self.by.get(name, 0) + n
        for us, n in other.cyclic.items():
            self.cyclic[us] = self.cyclic.get(us, 0) + n
        self.exec_us, self.rss_kb = other.exec_us, max(self.rss_kb, other.rss_kb)
        self.faults = (self.faults[0] + other.faults[0], self.faults[1] + other.faults[1])
        self.subscribers += other.subscribers

    def reference(self) -> dict[str, float]:
        """p50, p99, p99.9 and max of cyclictest [us]; empty if it did not run."""
        total, seen, found = sum(self.cyclic.values()), 0, {}
        wanted = [("p50", 0.5), ("p99", 0.99), ("p99.9", 0.999)]
        for us in sorted(self.cyclic):
            seen += self.cyclic[us]
            while wanted and seen >= wanted[0][1] * total:
                found[wanted.pop(0)[0]] = us + 1.0
            found["max"] = us + 1.0
        return found


def cyclictest(cpu: int, rate: float, seconds: float) -> "subprocess.Popen[str] | None":
    """Start cyclictest on the same CPU, above the loop; its interval differs slightly from the
    loop's period so that the two drift relative to each other. None if it is not installed."""
    if shutil.which("cyclictest") is None:
        return None
    interval = round(1e6 / rate * 1.013)
    return subprocess.Popen(
        ["cyclictest", "-q", "-m", "-p", "90", "-a", str(cpu), "-i", str(interval),
         "-D", str(max(1, round(seconds))), "-h", "20000"],
        text=True, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
    )  # fmt: skip


def histogram(output: str) -> dict[int, int]:
    """Parse cyclictest's histogram: counts by whole microseconds; overflows count as 20 ms."""
    rows = [line.split() for line in output.splitlines() if re.match(r"^\d{6} ", line)]
    counts = {int(row[0]): int(row[1]) for row in rows if int(row[1])}
    beyond = re.search(r"# Histogram Overflows: (\d+)", output)
    if beyond and int(beyond.group(1)):
        counts[20_000] = counts.get(20_000, 0) + int(beyond.group(1))
    return counts


@contextmanager
def load_of(kind: str, core: Core, seconds: float) -> Iterator[list["subprocess.Popen[str]"]]:
    """Run a load next to the core; yield processes whose last line of output is wanted."""
    running, wanted = [], []
    if kind == "cpu":
        running = [python(BURN) for _ in range(os.cpu_count() or 1)]
    elif kind in ("doctor", "served"):
        running = _served(core, working=kind == "doctor")
    elif kind in ("subscribers", "gateway"):
        if kind == "gateway":
            running.append(python(BURNING_GATEWAY, str(core.config)))
        else:
            running.append(
                python(
                    "import sys; from dehyst.daemon.main import main; sys.exit(main(sys.argv[1:]))",
                    "gateway", "--config", str(core.config),
                )
            )  # fmt: skip
            time.sleep(4.0)
            for _ in range(2):
                wanted.append(
                    python(SUBSCRIBERS, core.address, "10", str(seconds), stdout=subprocess.PIPE)
                )
        time.sleep(4.0)
    try:
        yield wanted
    finally:
        for process in running:
            end(process)
        for process in wanted:
            if process.poll() is None:
                process.kill()


def _served(core: Core, working: bool) -> list["subprocess.Popen[str]"]:
    """Start the gateway alone, or with a page viewed in a browser and a working doctor."""
    start = "import sys; from dehyst.daemon.main import main; sys.exit(main(sys.argv[1:]))"
    running = [python(start, "gateway", "--config", str(core.config))]
    if working:
        lay_cases(load_config(core.config), CASES)
        host = f"127.0.0.1:{free_port()}"
        running += [
            python(start, "doctor", "--config", str(core.config)),
            python(start, "page", "--connect", core.address, "--listen", host),
        ]
        time.sleep(8.0)
        running.append(python(BROWSER, host))
    time.sleep(4.0)
    return running


def measure(core: Core, rate: float, cpu: int, load: str, seconds: float) -> Window:
    """Measure one window under one load."""
    window = Window(rate, load)
    with load_of(load, core, seconds + 2.0) as wanted:
        core.drain()
        before = core.status.read(max(0, core.status.head - 1))[0][-1]
        faults, rss = core.faults(), core.rss_kb()
        reference = cyclictest(cpu, rate, seconds)
        parts, until = [], time.monotonic() + seconds
        while time.monotonic() < until:
            time.sleep(0.5)
            parts.append(core.drain())
        output = reference.communicate()[0] if reference is not None else ""
        time.sleep(1.1)
        after = core.status.read(max(0, core.status.head - 1))[0][-1]
        window.faults = tuple(b - a for a, b in zip(faults, core.faults(), strict=True))  # type: ignore[assignment]
        window.rss_kb = core.rss_kb() - rss
        for process in wanted:
            window.subscribers += json.loads(process.communicate(timeout=60)[0] or "[]")
    records = np.concatenate(parts)
    window.wake_us = (records["actual_ns"] - records["scheduled_ns"]) * 1e-3
    window.exec_us = float(np.median(records["exec_us"]))
    window.samples = int(after["samples"] - before["samples"])
    window.missed = int(after["missed"] - before["missed"])
    difference = after["missed_by"] - before["missed_by"]
    window.by = {MissCause(i).name.lower(): int(n) for i, n in enumerate(difference) if n}
    window.cyclic = histogram(output)
    return window
