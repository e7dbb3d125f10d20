"""`dehyst run` on the emulated bench as a real process, for the safety tests."""

import os
import signal
import subprocess
import time
from pathlib import Path

from tests.rigs.gateway_bench import answering, free_port
from tests.rigs.processes import DTYPES, EmulatedBench, Rings, dehyst, until

from dehyst.daemon.client.client import Client
from dehyst.daemon.rings.records import LoopCommand
from dehyst.daemon.rings.ring_file import RingFile
from dehyst.drivers.emulated.control import ask
from dehyst.models.errors import DehystError

HIGH_UM, SAFE_V = 9.0, 5.0


class Service:
    """Emulated bench and supervisor. replaced: text in the configuration."""

    def __init__(self, folder: Path, model: Path, rate: float = 100.0, **replaced: str) -> None:
        self.bench = EmulatedBench(folder)
        self.folder, self.port = folder, free_port()
        self.config = self.bench.config(rate, model)
        text = f'bus = {{listen = ["tcp/127.0.0.1:{self.port}"]}}\ndoctor = {{enabled = false}}\n'
        text += self.config.read_text()
        for old, new in replaced.items():
            assert old in text
            text = text.replace(old, new)
        self.config.write_text(text)
        self.rings = Rings(folder)
        self.log = folder / "run.txt"
        self.supervisor: subprocess.Popen[str] | None = None

    def start(self) -> None:
        """Start the supervisor; return when its core writes samples."""
        with open(self.log, "ab") as words:
            self.supervisor = dehyst(
                "run", "--config", str(self.config), stdout=words, stderr=words
            )
        until(lambda: self.core_pid() and self.rings.last() is not None, 120.0, "samples")

    def core_pid(self) -> int:
        """Return the id of the process that writes the present rings; 0 if none is alive."""
        try:
            with RingFile(self.folder / "run" / "telemetry.ring", DTYPES["telemetry"]) as ring:
                pid = ring.pid
            os.kill(pid, 0)
        except (DehystError, ProcessLookupError):
            return 0
        return pid

    def words(self) -> str:
        """Return what the supervisor and its children have printed."""
        return self.log.read_text(errors="replace") if self.log.exists() else ""

    def high(self, um: float = HIGH_UM, volts: float = 60.0) -> float:
        """Drive the stage up through the command ring; return the output then."""
        self.rings.drive(um, lambda last: last["volts"] > volts)
        return self.output()

    def hold_high(self) -> None:
        """Repeat the command, so that the set-point does not go stale at once."""
        self.rings.command(LoopCommand.SETPOINT, HIGH_UM)

    def output(self) -> float:
        """Return the output that the amplifier reports."""
        return float(ask(self.bench.ports["control"], {})["output_v"])

    def client(self) -> Client:
        """Return a client as soon as the gateway answers."""
        return answering(self.port, f"the gateway answers\n{self.words()}")

    def end(self, number: int = signal.SIGTERM, timeout_s: float = 60.0) -> int:
        """Send a signal to the supervisor; return its exit code."""
        assert self.supervisor is not None
        self.supervisor.send_signal(number)
        return self.supervisor.wait(timeout_s)

    def close(self) -> None:
        """End everything, including stopped processes."""
        if pid := self.core_pid():
            os.kill(pid, signal.SIGCONT)
        if self.supervisor is not None and self.supervisor.poll() is None:
            self.end()
        end = time.monotonic() + 20.0
        while self.core_pid() and time.monotonic() < end:
            time.sleep(0.1)
        if pid := self.core_pid():
            os.kill(pid, signal.SIGKILL)
        self.bench.close()
