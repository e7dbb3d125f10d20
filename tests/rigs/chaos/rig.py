"""The rig of the chaos tests: real processes, real ptys, and the amplifier's own log as evidence.

    bench   `dehyst emulate`: MDT693B and KSG101 on ptys, one simulated stage between them
    daemon  `dehyst run`: supervisor, core, gateway
    mover   a client process that plays a trajectory repeatedly, whatever happens to it
    record  `dehyst record`, a client process that writes what it receives

All of them see a wall clock that `step_wall_clock` can set: a `sitecustomize` module adds the
offset in a file to `time.time`. The monotonic clock is the machine's.
"""

import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from tests.rigs import output
from tests.rigs.gateway_bench import free_port
from tests.rigs.processes import PATIENT, as_hardware

from dehyst.daemon.bus.messages import Event, Status
from dehyst.daemon.client.client import Client
from dehyst.daemon.client.telemetry import StatusFeed, TelemetryStream
from dehyst.daemon.files.recordings import read_recording
from dehyst.daemon.rings.records import State
from dehyst.drivers.emulated.control import ask
from dehyst.models.errors import DehystError

ROOT = Path(__file__).resolve().parents[3]
RATE_HZ, SLEW, RAMP, MAX_V, SAFE_V, HOLD_S = 100.0, 1000.0, 200.0, 140.0, 5.0, 0.4
STEP_NS = round(1e9 / RATE_HZ)
LATE_S = 3 / RATE_HZ
"""How late a write, or the emulator's reading of it, may be while the next one is in time."""
MOVER_V_PER_S = 260.0
"""The highest rate that the mover's trajectory needs: 17.3 um/s with a stage gain of 0.067 um/V."""
APPROACH_V_PER_S = 850.0
"""The highest rate of the approach to a first target: 40 um/s with a stage gain of 0.047 um/V after
a reversal at that rate."""

LIMITS = """\
limits = {{min_v = 0.0, max_v = {max_v}, slew_v_per_s = {slew}}}
safe = {{voltage_v = {safe_v}, ramp_v_per_s = {ramp}, on_fault = "{on_fault}"}}
bus = {{listen = ["{listen}"]}}
watch = {{before_s = 5.0, after_s = 1.0}}
[setpoint]
stale_s = 0.8
hold_s = {hold_s}
approach_um_per_s = 40.0
queue_s = 30.0
lease_s = 1.0
"""
"""The limits of all rigs."""
CONFIG = """
name = "chaos"
run_dir = "{run}"
model = {{file = "{model}"}}
loop = {{rate_hz = {rate}}}
{devices}
"""
CONFIG += LIMITS
DEVICES = """\
actuator = {{driver = "mdt693b", settings = {{port = "{mdt693b}", rate_hz = 250.0, {patient}}}}}
sensor = {{driver = "ksg101", settings = {{port = "{ksg101}", {patient}}}}}"""

SITE = """
import os, time
_path, _time, _time_ns = os.environ.get("CHAOS_CLOCK", ""), time.time, time.time_ns
def _offset_s():
    try:
        with open(_path) as file:
            return float(file.read() or 0)
    except (OSError, ValueError):
        return 0.0
time.time = lambda: _time() + _offset_s()
time.time_ns = lambda: _time_ns() + int(_offset_s() * 1e9)
"""


PAUSE_S = 0.5
"""A pause of a thread that only looks at the clock above which the machine has stood still."""


def until(condition: Callable[[], Any], seconds: float, what: str) -> Any:
    """Poll until the condition's value is true, and return it; a busy machine has twice as long
    (the logs decide what must be in time)."""
    end = time.monotonic() + 2.0 * seconds
    while time.monotonic() < end:
        value = condition()
        if value:
            return value
        time.sleep(0.01)
    raise AssertionError(f"not within {seconds:g} s: {what}")


def trajectory(seconds: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Return (t_s, target): three sines whose sum does not repeat, 3 to 11 um."""
    t = np.arange(round(100 * seconds) + 1) / 100
    phase = np.random.default_rng(seed).uniform(0, 2 * np.pi, 3)
    waves = [np.sin(2 * np.pi * f * t + p) for f, p in zip((0.31, 0.83, 1.9), phase, strict=True)]
    return t, 7.0 + 2.0 * waves[0] + 1.2 * waves[1] + 0.6 * waves[2]


class Listener(threading.Thread):
    """Receives everything the daemon publishes: samples, events, statuses, refusals."""

    def __init__(self, client: Client) -> None:
        super().__init__(daemon=True)
        self.client = client
        self.stream: TelemetryStream = client.stream()
        self.feed: StatusFeed = client.feed()
        self.samples: list[np.ndarray] = []
        self.events: list[Event] = []
        self.statuses: list[Status] = []
        self.rejections: list[Any] = []
        self.ending = threading.Event()

    def run(self) -> None:
        while not self.ending.is_set():
            batch = self.stream.read(0.02)
            if batch.size:
                self.samples.append(batch)
            for source, store in (
                (self.feed.events, self.events),
                (self.feed.rejections, self.rejections),
            ):
                while source:
                    store.append(source.popleft())  # type: ignore[attr-defined]
            status = self.feed.status
            if status is not None and (not self.statuses or self.statuses[-1] is not status):
                self.statuses.append(status)


class StoodStill(AssertionError):
    """Not judged: the machine stood still every time."""


class Witness(threading.Thread):
    """Notes when the machine stands still: this thread has nothing to do but look at the clock."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.pauses: list[tuple[int, float]] = []  # (end [ns], length [s]) of each above PAUSE_S
        self.ending = threading.Event()

    def run(self) -> None:
        seen_ns = time.monotonic_ns()
        while not self.ending.wait(0.01):
            now_ns = time.monotonic_ns()
            if now_ns - seen_ns > PAUSE_S * 1e9:
                self.pauses.append((now_ns, (now_ns - seen_ns) * 1e-9))
            seen_ns = now_ns

    def longest_s(self, since_ns: int) -> float:
        """Return the longest pause that ended since then; 0.0 if there was none above PAUSE_S."""
        return max((s for end_ns, s in list(self.pauses) if end_ns > since_ns), default=0.0)


class Rig:
    """The complete running rig. `since` marks the beginning of a fault (see `mark`)."""

    name = "chaos"
    commanded: tuple[str, ...] = (name,)
    axes = ""
    port_name = "mdt693b"  # the amplifier's port on the bench
    lasts_s = 1200.0  # length of one trajectory of the mover: longer than every fault
    bench_options: tuple[str, ...] = ()

    def __init__(self, folder: Path, model: Path, on_fault: str = "ramp") -> None:
        self.folder, self.log = folder, folder / "output.npz"
        self.clock_file = folder / "clock"
        self.port = free_port()
        self.address = f"tcp/127.0.0.1:{self.port}"
        (folder / "site").mkdir()
        (folder / "site" / "sitecustomize.py").write_text(SITE)
        self.environment = {
            **os.environ,
            "PYTHONPATH": f"{folder / 'site'}:{ROOT / 'src'}:{ROOT}",
            "CHAOS_CLOCK": str(self.clock_file),
            "DEHYST_CONNECT": self.address,
            "DEHYST_SUPERVISED": "1",
            "OMP_NUM_THREADS": "1",
        }
        self.environment.pop("NOTIFY_SOCKET", None)
        self.processes: list[subprocess.Popen[bytes]] = []
        self.listener: Listener | None = None
        self.mover: subprocess.Popen[bytes] | None = None
        self.witness = Witness()
        self.witness.start()
        self.ports = self._bench()
        self.model = folder / "model.toml"
        self.model.write_text(Path(model).read_text())
        self.config = folder / "config.toml"
        self.config.write_text(self.configured(on_fault))
        self.since_ns = self.fault_ns = 0

    def configured(self, on_fault: str) -> str:
        """Return the text of the configuration."""
        return CONFIG.format(
            run=self.folder / "run", model=self.model, rate=RATE_HZ, max_v=MAX_V, slew=SLEW,
            safe_v=SAFE_V, ramp=RAMP, hold_s=HOLD_S, on_fault=on_fault, listen=self.address,
            devices=self.devices(),
        )  # fmt: skip

    def devices(self) -> str:
        """Return the configuration's lines about the devices."""
        return DEVICES.format(patient=PATIENT, **self.ports)

    @property
    def kept(self) -> Path:
        """The folder in which the watch keeps its recordings."""
        return self.folder / "run" / "mismatch"

    # -- processes ------------------------------------------------------------------------------

    def start(self, *arguments: str, name: str = "") -> "subprocess.Popen[bytes]":
        """Start a dehyst command; its output goes to NAME.txt."""
        return self._start([sys.executable, "-m", "dehyst.daemon.main", *arguments], name)

    def _start(self, command: list[str], name: str) -> "subprocess.Popen[bytes]":
        with open(self.folder / f"{name or command[3]}.txt", "ab") as words:
            process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=words,
                stderr=subprocess.STDOUT,
                env=self.environment,
                cwd=ROOT,
            )
        self.processes.append(process)
        return process

    def words(self, name: str) -> str:
        """Return what a process has printed so far."""
        path = self.folder / f"{name}.txt"
        return path.read_text(errors="replace") if path.exists() else ""

    def _bench(self) -> dict[str, str]:
        self.bench = self.start(
            "emulate", "--dir", str(self.folder / "bench"), "--log", str(self.log),
            *self.bench_options, name="bench",
        )  # fmt: skip
        as_hardware(self.bench)
        # before its ports it prints which kernels it compiles
        line = until(lambda: re.search(r"^\{.*\}$", self.words("bench"), re.M), 240.0, "the bench")
        as_hardware(self.bench, ready=True)
        ports: dict[str, str] = json.loads(line[0])
        return ports

    def run(self) -> None:
        """Start daemon, listener and mover; return when the trajectory runs."""
        self.daemon = self.start("run", "--config", str(self.config), name="run")
        self.client = until(self._connect, 60.0, f"the gateway\n{self.words('run')}")
        self.listener = Listener(self._connect() or self.client)
        self.listener.start()
        self.start_mover()
        self.until_running(300.0)  # the kernels may have to be compiled first

    def _connect(self, name: str = "") -> Client | None:
        if self.daemon.poll() is not None:
            raise AssertionError(f"dehyst run ended: {self.words('run')}")
        try:
            return Client(name or self.name, self.address)
        except DehystError:
            return None

    def start_mover(self) -> None:
        """Start the client that commands."""
        script = str(ROOT / "tests" / "rigs" / "chaos" / "mover.py")
        self.mover = self._start(
            [sys.executable, script, self.address, self.name, str(self.lasts_s)], "mover"
        )

    def pid(self, name: str) -> int:
        """Return the process id of core, gateway or client."""
        if name == "client":
            assert self.mover is not None
            return self.mover.pid
        status = self.status()
        return status.pid if name == "core" else status.gateway.pid

    def kill(self, name: str, number: int = signal.SIGKILL) -> int:
        """Send a signal to core, gateway or client, wait if it kills; return the process id."""
        pid = self.pid(name)
        os.kill(pid, number)
        if number == signal.SIGKILL:
            until(lambda: not lives(pid), 5.0, f"{name} is gone")
        return pid

    # -- what can be observed -------------------------------------------------------------------

    def status(self) -> Status:
        """Return the daemon's status; repeat the query until it is answered."""

        def asked() -> Status | None:
            try:
                return self.client.status()
            except DehystError:
                return None

        answer: Status = until(asked, 30.0, "a status")
        return answer

    def mark(self) -> None:
        """Start the next fault: what comes from now on belongs to it."""
        self.since_ns = self.fault_ns = time.monotonic_ns()

    def mark_fault(self) -> None:
        """Start another part of the fault; the output is judged from the previous mark."""
        self.since_ns = time.monotonic_ns()

    def samples(self) -> np.ndarray:
        """Return the telemetry since the mark."""
        assert self.listener is not None
        return samples_since(self.since_ns, self.listener.samples)

    def judge(self, fault: Callable[..., str]) -> None:
        """Check what must hold after this fault beyond the amplifier's channel."""

    def flags(self) -> int:
        """Return all flags since the mark."""
        samples = self.samples()
        return int(np.bitwise_or.reduce(samples["flags"])) if samples.size else 0

    def states(self) -> set[State]:
        """Return all states since the mark, of telemetry and of status messages."""
        samples = self.samples()
        return {State(int(s)) for s in np.unique(samples["state"])} if samples.size else set()

    def events(self) -> str:
        """Return the texts of the events since the mark."""
        assert self.listener is not None
        events = list(self.listener.events)
        return "\n".join(e.text for e in events if e.time_ns >= self.since_ns)

    def known_events(self) -> str:
        """Return the texts of events since the mark that the gateway knows; "" if none."""
        try:
            events = self.client.events()
        except DehystError:
            return ""
        return "\n".join(e.text for e in events if e.time_ns >= self.since_ns)

    def refusals(self) -> set[str]:
        """Return the codes of the refusals since the mark."""
        assert self.listener is not None
        return {r.code for r in list(self.listener.rejections) if r.time_ns >= self.since_ns}

    def last(self) -> Any:
        """Return the newest sample; None if there is none."""
        assert self.listener is not None
        return self.listener.samples[-1][-1] if self.listener.samples else None

    def target(self) -> float:
        """Return the target of the newest sample."""
        last = self.last()
        return float("nan") if last is None else float(last["target"])

    def until_event(self, text: str, seconds: float = 20.0) -> None:
        """Wait until an event with this text was received, or is known to the gateway: events
        during a reconnection are not received."""
        asked_s = time.monotonic()

        def reported() -> bool:
            nonlocal asked_s
            if text in self.events():
                return True
            if time.monotonic() - asked_s < 2.0:
                return False
            asked_s = time.monotonic()
            return text in self.known_events()

        until(reported, seconds, f"event {text!r}; heard: {self.events()!r}")

    def until_state(self, state: State, seconds: float = 20.0) -> None:
        """Wait until the loop was in a state since the mark."""
        until(lambda: state in self.states(), seconds, f"state {state.name}\n{self.events()}")

    def until_running(self, seconds: float = 30.0) -> None:
        """Wait until the trajectory runs (again), with every sample fresh and good."""
        begun_ns = time.monotonic_ns()

        def runs() -> bool:
            last = self.last()
            return (
                last is not None
                and last["scheduled_ns"] > begun_ns
                and last["state"] == State.RUNNING
                and np.isfinite(last["measured"])
                and np.isfinite(last["target"])
            )

        until(runs, seconds, f"the trajectory runs\n{self.events()}\n{self.words('run')[-2000:]}")

    def bench_order(self, **order: Any) -> dict[str, Any]:
        """Send an order to the bench and return its state."""
        return ask(self.ports["control"], order)

    def output(self) -> tuple[np.ndarray, np.ndarray]:
        """Return (time_ns, volts) at the amplifier's output since the rig began, from its log."""
        self.bench_order(save=True)
        with np.load(self.log) as data:
            return data["time_ns"], data["volts"]

    def check_held(self, begin_ns: int, end_ns: int | None = None) -> None:
        """Check that the output did not move in this time, after any command in transit."""
        output.check_held(*self.output(), begin_ns + 2 * STEP_NS, end_ns)

    def check_steps(self, step_v: float, rate_v_per_s: float, begin_ns: int) -> None:
        """Check that every step after begin is at most step_v plus a movement at this rate."""
        log = output.during(*self.output(), begin_ns + 2 * STEP_NS)
        output.check_steps(*log, step_v, rate_v_per_s, LATE_S)

    def check_ramped(self, begin_ns: int) -> None:
        """Check that the output then ramped to its safe voltage in steps, no faster."""
        time_ns, volts = output.during(*self.output(), begin_ns + 2 * STEP_NS)
        there = np.flatnonzero(np.abs(volts - SAFE_V) < 0.01)
        assert there.size, "the output never came to its safe voltage"
        log = time_ns[: there[0] + 1], volts[: there[0] + 1]
        output.check_steps(*log, RAMP / RATE_HZ, 0.0, LATE_S)
        output.check_speed(*log, RAMP, RAMP * (1 / RATE_HZ + LATE_S))

    def check_held_then_ramped(self, begin_ns: int) -> None:
        """Check that after begin the loop held for the configured time, then ramped."""
        samples = self.samples()
        holding = samples["scheduled_ns"][
            (samples["state"] == State.HOLDING) & (samples["scheduled_ns"] >= begin_ns)
        ]
        assert holding.size, "the loop never held"
        held_ns = int(holding[0])
        self.check_held(held_ns, held_ns + round(HOLD_S * 1e9) - STEP_NS)
        self.check_ramped(held_ns)

    def step_wall_clock(self, seconds: float) -> None:
        """Set every process's wall clock forward by `seconds`."""
        self.clock_file.write_text(repr(seconds))

    def record(self, path: Path, *arguments: str, name: str = "record") -> Any:
        """Start `dehyst record`; return the process when the file has rows."""
        process = self.start("record", "-o", str(path), *arguments, name=name)
        until(lambda: path.exists() and path.stat().st_size > 3000, 30.0, self.words(name) or name)
        return process

    def close(self) -> None:
        """End everything, including stopped processes."""
        self.witness.ending.set()
        if self.listener is not None:
            self.listener.ending.set()
            self.listener.join(5.0)
        for process in reversed(self.processes):
            if process.poll() is None:
                process.send_signal(signal.SIGCONT)
                process.send_signal(signal.SIGTERM)
                try:
                    process.wait(20.0)
                except subprocess.TimeoutExpired:
                    process.kill()
                    process.wait(5.0)
        for client in {id(c): c for c in (getattr(self, "client", None),) if c}.values():
            client.close()
        if self.listener is not None:
            self.listener.client.close()


def samples_since(since_ns: int, batches: list[np.ndarray]) -> np.ndarray:
    """Return the telemetry from this moment on, given batches in order of arrival."""
    found = []
    for batch in reversed(batches):  # the list grows meanwhile
        found.append(batch[batch["scheduled_ns"] >= since_ns])
        if batch["scheduled_ns"][-1] < since_ns:
            break
    return np.concatenate(found[::-1]) if found else np.zeros(0)


def lives(pid: int) -> bool:
    """Return whether the process exists (a zombie does not count)."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def readable_rows(path: Path) -> int:
    """Return the rows of a recording that is readable without an error."""
    return int(read_recording(path).t_s.size)
