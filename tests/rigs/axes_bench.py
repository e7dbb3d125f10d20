"""A controller of several axes for tests: its loop and its gateway, each in a process."""

import signal
import socket
import subprocess
import sys
from pathlib import Path

from tests.rigs.gateway_bench import (
    Core,
    environment,
    follows,
    free_port,
    wait_until,
)
from tests.rigs.processes import one_cpu
from tests.rigs.stage_model import model_text

from dehyst.daemon.client.client import Client
from dehyst.daemon.client.group import Group
from dehyst.daemon.config import Config, load_controller

SHARED = """
name = "stage-1"
run_dir = "{run_dir}"
loop = {{rate_hz = 200.0, cpu = {cpu}}}
bus = {{{auth}listen = ["tcp/127.0.0.1:{port}"]}}
model = {{file = "model.toml"}}
limits = {{min_v = 0.0, max_v = 95.0, slew_v_per_s = 10000.0}}
trim = {{enabled = false}}
safe = {{voltage_v = 0.0, ramp_v_per_s = 1000.0}}
setpoint = {{stale_s = 5.0, hold_s = 0.2, approach_um_per_s = 200.0, queue_s = 10.0, lease_s = 3.0}}
"""
AXIS = """
[axis.{axis}]
actuator = {{driver = "simulated", settings = {{stage = "{axis}"}}}}
sensor = {{driver = "simulated", settings = {{stage = "{axis}"}}}}
"""


class AxisRings(Core):
    """One axis of the loop's process, accessed through its rings."""

    def __init__(self, config: Config, process: subprocess.Popen[bytes]) -> None:
        self.config, self.process = config, process


class AxesBench:
    """Loop and gateway of a controller with these axes; auth: text in [bus]."""

    def __init__(self, folder: Path, axes: str = "xyz", auth: str = "") -> None:
        self.folder, self.port, self.axes = folder, free_port(), tuple(axes)
        self.path = folder / "stage.toml"
        (folder / "model.toml").write_text(model_text())
        text = SHARED.format(run_dir=folder / "run", port=self.port, auth=auth, cpu=one_cpu())
        self.path.write_text(text + "".join(AXIS.format(axis=axis) for axis in axes))
        self.controller = load_controller(self.path)
        self.address = f"tcp/127.0.0.1:{self.port}"
        self.open: list[Client | Group] = []
        self.gateway: subprocess.Popen[bytes] | None = None
        command = [sys.executable, "-m", "dehyst.daemon.main", "core", "--config", str(self.path)]
        self.core = subprocess.Popen(command, env=environment(), stdin=subprocess.DEVNULL)
        self.loops = {c.axis: AxisRings(c, self.core) for c in self.controller.axes}

    def start_gateway(self) -> None:
        """Start the gateway; wait until it listens and the loops run."""
        command = [sys.executable, "-m", "dehyst.daemon.main", "gateway", "--config"]
        self.gateway = subprocess.Popen([*command, str(self.path)], env=environment())
        wait_until("the gateway listens", self._listens)
        for loop in self.loops.values():
            wait_until("the loop runs", loop.running, 240.0)

    def _listens(self) -> bool:
        with socket.socket() as probe:
            return probe.connect_ex(("127.0.0.1", self.port)) == 0

    def client(self, axis: str, label: str = "", credentials: str = "") -> Client:
        """Return a client of one axis; it is closed with the bench."""
        client = Client(f"stage-1-{axis}", self.address, "dehyst", label, credentials)
        self.open.append(client)
        wait_until("the gateway has seen the loop", lambda: follows(client))
        return client

    def group(self, axes: str | None = None, label: str = "", credentials: str = "") -> Group:
        """Return a group of these axes; it is closed with the bench."""
        names = None if axes is None else list(axes)
        group = Group("stage-1", names, self.address, "dehyst", label, credentials)
        self.open.append(group)
        for client in group.clients.values():
            wait_until("the gateway has seen the loops", lambda one=client: follows(one))
        return group

    def kill_gateway(self, number: int = signal.SIGKILL) -> None:
        """End the gateway with a signal."""
        assert self.gateway is not None
        self.gateway.send_signal(number)
        self.gateway.wait(10.0)

    def close(self) -> None:
        """End everything."""
        for one in self.open:
            one.close()
        if self.gateway is not None and self.gateway.poll() is None:
            self.gateway.kill()
            self.gateway.wait(10.0)
        if self.core.poll() is None:
            self.core.kill()
        self.core.wait(20.0)
