"""A real gateway process between a real zenoh session and rings that a small loop here writes."""

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from dehyst.daemon import messages
from dehyst.daemon.bus import BusError
from dehyst.daemon.client import Client
from dehyst.daemon.config import Config, load_config
from dehyst.daemon.corelink import LAYOUTS
from dehyst.daemon.feed import TelemetryStream
from dehyst.daemon.records import STATUS, Command, Flag, State
from dehyst.daemon.ring import Ring

ROOT = Path(__file__).resolve().parents[2]
SIZES = {"telemetry": 65536, "status": 256, "event": 256, "command": 65536}


def free_port() -> int:
    """A TCP port on loopback that nobody uses at present."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def wait_until(what: str, check: Callable[[], bool], timeout_s: float = 60.0) -> None:
    """Poll until true; the test fails after timeout_s."""
    end = time.monotonic() + timeout_s
    while not check():
        if time.monotonic() > end:
            pytest.fail(f"did not happen within {timeout_s:g} s: {what}")
        time.sleep(0.01)


class Follower:
    """What a loop does with commands, in few words and for a stage of 1 um/V: approach, follow,
    hold when the targets go stale, ramp to 0 V. Independent of the real stepper."""

    def __init__(self, config: Config) -> None:
        self.config, self.period_s = config, config.period_ns * 1e-9
        self.state, self.volts, self.target, self.flags = State.READY, 0.0, float("nan"), Flag(0)
        self.trajectory, self.done = 0, False
        self.events: list[str] = []
        self._times: list[float] = []
        self._values: list[float] = []
        self._last = False
        self._now_s = self._fresh_s = self._since_s = self._begun_s = 0.0

    def step(self, commands: np.ndarray) -> None:
        """One sample."""
        self._now_s += self.period_s
        for command in commands:
            self._take(Command(int(command["kind"])), command)
        self.flags = Flag(0)
        if self.state is State.RUNNING:
            self._follow()
        elif (
            self.state is State.HOLDING
            and self._now_s - self._since_s >= self.config.setpoint.hold_s
        ):
            self.volts = max(0.0, self.volts - self.config.safe.ramp_v_per_s * self.period_s)
            if self.volts == 0.0:
                self._enter(State.READY)

    @property
    def ahead_s(self) -> float:
        """Trajectory ahead."""
        return max(0.0, self._begun_s + self._times[-1] - self._now_s) if self._times else 0.0

    def _enter(self, state: State) -> None:
        self.state, self._since_s = state, self._now_s
        if state is not State.RUNNING:
            self._times.clear()
            self._values.clear()
            self.target = float("nan")

    def _take(self, kind: Command, command: np.void) -> None:
        self._fresh_s = self._now_s
        if kind in (Command.STOP_MOTION, Command.RELEASE):
            self.events.append("stopped")
            self._enter(State.HOLDING)
            return
        if kind is Command.SETPOINT:
            self._times, self._values, self._last = [0.0], [float(command["value"])], True
            self._begun_s, self.state = self._now_s, State.RUNNING
        elif kind is Command.POINT:
            offset_s = int(command["offset_ns"]) * 1e-9
            if self.trajectory != command["trajectory"] or not self._times:
                self.trajectory, self.done = int(command["trajectory"]), False
                self._times, self._values = [], []
                self._begun_s, self.state = self._now_s + 0.02 - offset_s, State.RUNNING
            self._times.append(offset_s)
            self._values.append(float(command["value"]))
            self._last = bool(command["last"])

    def _follow(self) -> None:
        at_s = self._now_s - self._begun_s
        self.target = float(np.interp(at_s, self._times, self._values))
        self.volts = min(max(self.target, 0.0), 10.0)
        over = at_s >= self._times[-1] - 1e-9
        if at_s < self._times[0] - 1e-9:
            self.flags |= Flag.APPROACH
        if self.volts != self.target:
            self.flags |= Flag.UNREACHABLE
        if over and self._last:
            self.done = True
        elif over:
            self.flags |= Flag.FALLBACK
        else:
            self._fresh_s = self._now_s
        if self._now_s - self._fresh_s > self.config.setpoint.stale_s:
            self.events.append("no set-point: holding")
            self._enter(State.HOLDING)


class Loop(threading.Thread):
    """The core's place: real rings, written at the configured rate."""

    def __init__(self, config: Config) -> None:
        super().__init__(daemon=True)
        self.config = config
        self.rings = {
            name: Ring.create(config.directory / f"{name}.ring", dtype, SIZES[name])
            for name, dtype in LAYOUTS.items()
        }
        self.stepper = Follower(config)
        self.ending, self.frozen, self.seq = threading.Event(), threading.Event(), 0
        self.commands: list[np.ndarray] = []
        self._tail = 0

    def run(self) -> None:
        period_ns = self.config.period_ns
        scheduled_ns = time.monotonic_ns()
        said_ns, state = 0, -1
        row = np.zeros(1, LAYOUTS["telemetry"])[0]
        while not self.ending.is_set():
            scheduled_ns += period_ns
            time.sleep(max(0.0, (scheduled_ns - time.monotonic_ns()) * 1e-9))
            if self.frozen.is_set():
                continue
            commands, self._tail, _ = self.rings["command"].read(self._tail)
            self.rings["command"].taken(self._tail)
            if commands.size:
                self.commands.append(commands)
            row["measured"] = self.stepper.volts + 0.01  # read before the write
            self.stepper.step(commands)
            row["seq"], row["scheduled_ns"] = self.seq, scheduled_ns
            row["actual_ns"] = time.monotonic_ns()
            row["target"], row["volts"] = self.stepper.target, self.stepper.volts
            row["flags"], row["state"] = self.stepper.flags, self.stepper.state
            self.seq += 1
            self.rings["telemetry"].push(row)
            self._events()
            if state != self.stepper.state or scheduled_ns - said_ns >= 1_000_000_000:
                state, said_ns = self.stepper.state, scheduled_ns
                self._status(scheduled_ns)

    def _events(self) -> None:
        for text in self.stepper.events:
            event = np.zeros(1, LAYOUTS["event"])
            event["time_ns"], event["level"], event["code"] = time.monotonic_ns(), 1, b"loop"
            event["text"] = text.encode()[:400]
            self.rings["event"].push(event[0])
        self.stepper.events.clear()

    def _status(self, now_ns: int) -> None:
        row = np.zeros(1, STATUS)[0]
        row["time_ns"], row["wall_ns"] = now_ns, time.time_ns()
        row["state"], row["samples"] = self.stepper.state, self.seq
        row["queue_s"], row["volts"] = self.stepper.ahead_s, self.stepper.volts
        row["trajectory"], row["trajectory_done"] = self.stepper.trajectory, self.stepper.done
        row["reach_min"], row["reach_max"] = 0.0, 10.0
        row["period_ns"], row["pid"] = self.config.period_ns, os.getpid()
        row["actuator_ok"] = row["sensor_ok"] = 1
        self.rings["status"].push(row)

    def close(self) -> None:
        """End the thread."""
        self.ending.set()
        self.join(5.0)


CONFIG = """
name = "bench"
run_dir = "{run_dir}"
model = {{file = "paper-eq11"}}
actuator = {{driver = "simulated"}}
sensor = {{driver = "simulated"}}
limits = {{min_v = 0.0, max_v = 10.0, slew_v_per_s = 10000.0}}
loop = {{rate_hz = 200.0}}
safe = {{voltage_v = 0.0, ramp_v_per_s = 100.0}}
setpoint = {{stale_s = 1.0, hold_s = 0.2, approach_um_per_s = 200.0, queue_s = 10.0, lease_s = 1.5}}
bus = {{listen = ["tcp/127.0.0.1:{port}"]}}
"""


class Bench:
    """Loop and gateway of one test; `client()` connects to it. start: False leaves the rings to
    somebody else; replaced: text in the configuration."""

    def __init__(self, folder: Path, start: bool = True, **replaced: str) -> None:
        self.port = free_port()
        self.path = folder / "bench.toml"
        text = CONFIG.format(run_dir=folder / "run", port=self.port)
        for old, new in replaced.items():
            text = text.replace(old, new)
        self.path.write_text(text)
        self.config = load_config(self.path)
        self.address = f"tcp/127.0.0.1:{self.port}"
        self.has_loop = start
        if start:
            self.loop = Loop(self.config)
            self.loop.start()
        self.gateway: subprocess.Popen[bytes] | None = None
        self.clients: list[Client] = []

    def start_gateway(self) -> None:
        """Start the gateway process and wait until a client can ask it."""
        env = {**os.environ, "PYTHONPATH": str(ROOT / "src")}
        env.pop("NOTIFY_SOCKET", None)
        command = [sys.executable, "-m", "dehyst.daemon.main", "gateway", "--config"]
        self.gateway = subprocess.Popen([*command, str(self.path)], env=env)
        wait_until("the gateway listens", self._listens)

    def _listens(self) -> bool:
        with socket.socket() as probe:
            return probe.connect_ex(("127.0.0.1", self.port)) == 0

    def client(self, label: str = "") -> Client:
        """A connected client; closed with the bench."""
        client = Client("bench", self.address, label=label)
        self.clients.append(client)

        def alive() -> bool:
            return client.status().core_alive

        wait_until("the gateway has seen the loop", alive)
        return client

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


def observer_only_hears(operator: Client, observer: Client) -> tuple[TelemetryStream, set[float]]:
    """The operator commands; the observer sees it, asks, and is refused what commands: its stream
    and the targets heard so far."""
    wait_until("the loop is seen", lambda: operator.status().core_alive)
    feed, stream = observer.feed(), observer.stream()
    assert observer.model().displacement_unit == "um"
    operator.send(3.0)
    operator.put(4.0)
    targets: set[float] = set()

    def told() -> bool:
        targets.update(stream.read(0.1)["target"].tolist())
        return 4.0 in targets and feed.status is not None

    wait_until("the observer hears of it", told)
    assert observer.history(0.2).size > 10
    observer.patience_s = 0.0
    for action in (lambda: observer.send(5.0), observer.stop, observer.take_over):
        with pytest.raises(BusError, match="let these credentials"):
            action()
    return stream, targets


def forged_setpoint(operator: Client) -> messages.Setpoint:
    """A set-point under the operator's lease, as if it had been overheard."""
    return messages.Setpoint(
        client=operator.client, lease=operator._lease, sequence=99, sent_ns=time.monotonic_ns(),
        value=9.0, unit="um",
    )  # fmt: skip
