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

from dehyst.daemon.client import Client
from dehyst.daemon.config import Config, load_config
from dehyst.daemon.corelink import LAYOUTS
from dehyst.daemon.records import STATUS
from dehyst.daemon.ring import Ring
from dehyst.daemon.step import Plan, Stepper
from dehyst.models.compensator import Compensator
from dehyst.models.modelfile import shipped

ROOT = Path(__file__).resolve().parents[2]
SIZES = {"telemetry": 65536, "status": 256, "event": 256, "command": 65536}


def free_port() -> int:
    """A TCP port on loopback that nobody uses at present."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def wait_until(what: str, check: Callable[[], bool], timeout_s: float = 20.0) -> None:
    """Poll until true; the test fails after timeout_s."""
    end = time.monotonic() + timeout_s
    while not check():
        if time.monotonic() > end:
            pytest.fail(f"did not happen within {timeout_s:g} s: {what}")
        time.sleep(0.01)


class Loop(threading.Thread):
    """The core's place: real rings, the real stepper and inverse, an ideal stage, no devices."""

    def __init__(self, config: Config) -> None:
        super().__init__(daemon=True)
        self.config = config
        self.rings = {
            name: Ring.create(config.directory / f"{name}.ring", dtype, SIZES[name])
            for name, dtype in LAYOUTS.items()
        }
        period_ns = config.period_ns
        compensator = Compensator(
            shipped("paper-eq11"), period_ns * 1e-9, 0.0, 10.0, 1e4, "static", 0.0
        )
        plan = Plan.from_config(config, 0.0, 0.0, 10.0)
        self.stepper = Stepper(plan, compensator, 0.0)
        self.ending, self.frozen, self.seq = threading.Event(), threading.Event(), 0
        self.commands: list[np.ndarray] = []
        self._tail = 0

    def run(self) -> None:
        period_ns = self.config.period_ns
        scheduled_ns = time.monotonic_ns()
        said_ns, state = 0, -1
        while not self.ending.is_set():
            scheduled_ns += period_ns
            time.sleep(max(0.0, (scheduled_ns - time.monotonic_ns()) * 1e-9))
            if self.frozen.is_set():
                continue
            commands, self._tail, _ = self.rings["command"].read(self._tail)
            self.rings["command"].taken(self._tail)
            if commands.size:
                self.commands.append(commands)
            record = self.stepper.step(scheduled_ns, self._measured(), commands)[0]
            self.stepper.written(float(record["volts"]))
            record["seq"], record["scheduled_ns"] = self.seq, scheduled_ns
            record["actual_ns"] = time.monotonic_ns()
            self.seq += 1
            self.rings["telemetry"].push(record)
            self._events()
            if state != self.stepper.state or scheduled_ns - said_ns >= 1_000_000_000:
                state, said_ns = self.stepper.state, scheduled_ns
                self._status(scheduled_ns)

    def _measured(self) -> float:
        predicted = float(self.stepper.record[0]["predicted"])
        return predicted + 0.01 if np.isfinite(predicted) else 0.0

    def _events(self) -> None:
        for text in self.stepper.events:
            event = np.zeros(1, LAYOUTS["event"])
            event["time_ns"], event["level"], event["code"] = time.monotonic_ns(), 1, b"loop"
            event["text"] = text.encode()[:400]
            self.rings["event"].push(event[0])
        self.stepper.events.clear()

    def _status(self, now_ns: int) -> None:
        status = np.zeros(1, STATUS)
        row = status[0]
        row["time_ns"], row["wall_ns"] = now_ns, time.time_ns()
        row["state"], row["samples"] = self.stepper.state, self.seq
        row["queue_s"] = self.stepper.queue.ahead_s(now_ns)
        row["trajectory"] = self.stepper.trajectory
        row["trajectory_done"] = self.stepper.trajectory_done
        row["reach_min"], row["reach_max"] = 0.0, 11.0
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
    """Loop and gateway of one test; `client()` connects to it."""

    def __init__(self, folder: Path, **replaced: str) -> None:
        self.port = free_port()
        self.path = folder / "bench.toml"
        text = CONFIG.format(run_dir=folder / "run", port=self.port)
        for old, new in replaced.items():
            text = text.replace(old, new)
        self.path.write_text(text)
        self.config = load_config(self.path)
        self.address = f"tcp/127.0.0.1:{self.port}"
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
        self.loop.close()
