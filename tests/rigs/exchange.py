"""Two identical amplifiers and one port: a link that leads to one or the other."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tests.rigs.gateway_bench import free_port
from tests.rigs.processes import CONFIG, Rings, dehyst, until

from dehyst.daemon.rings.records import TELEMETRY, State
from dehyst.daemon.rings.ring_file import RingFile
from dehyst.models.errors import BadInput

KNOWN, FOREIGN, FOREIGN_V = "150226175403", "150226175404", 100.0


class TwoUnits:
    """`port` leads to unit A, and after `exchange` to unit B, whose output is at FOREIGN_V."""

    def __init__(self, folder: Path, blank: bool) -> None:
        self.port = folder / "amplifier"
        self.units = []
        for name, number, volts in (("a", KNOWN, 0.0), ("b", FOREIGN, FOREIGN_V)):
            command = [sys.executable, "-P", "-m", "dehyst.drivers.emulated.mdt693b_port"]
            command += ["--link", str(folder / name), "--start-v", str(volts)]
            command += ["--serial-number", "" if blank else number]
            self.units.append(
                subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
            )
        self.ports = [os.path.realpath(self._line(place)["ready"]) for place in (0, 1)]
        self._lead_to(0)

    def ask(self, place: int, *words: str) -> dict[str, Any]:
        """Send a command to one of the emulators and return its answer."""
        unit = self.units[place]
        assert unit.stdin is not None
        unit.stdin.write(" ".join(words) + "\n")
        unit.stdin.flush()
        return self._line(place)

    def exchange(self) -> None:
        """Unplug A and connect B in its place."""
        self.ask(0, "unplug")
        self._lead_to(1)

    def _lead_to(self, place: int) -> None:
        fresh = self.port.with_suffix(".new")
        fresh.symlink_to(self.ports[place])
        fresh.replace(self.port)

    def _line(self, place: int) -> dict[str, Any]:
        out = self.units[place].stdout
        assert out is not None
        answer: dict[str, Any] = json.loads(out.readline())
        return answer

    def close(self) -> None:
        """End both."""
        for unit in self.units:
            unit.kill()
            unit.communicate()


class Exchanged:
    """A daemon that drives unit A to a high voltage, and what it does to unit B."""

    def __init__(self, folder: Path, model: Path, blank: bool) -> None:
        self.folder, self.units = folder, TwoUnits(folder, blank)
        text = f'bus = {{listen = ["tcp/127.0.0.1:{free_port()}"]}}\ndoctor = {{enabled = false}}\n'
        text += CONFIG.format(
            run=folder / "run", model=model, rate=100.0, loop="", actuator="mdt693b",
            sensor="simulated", actuator_settings=f'{{port = "{self.units.port}"}}',
            sensor_settings='{stage = "t"}', trim="false",
        )  # fmt: skip
        self.config = folder / "config.toml"
        self.config.write_text(text.replace("ramp_v_per_s = 200.0", "ramp_v_per_s = 40.0"))
        self.rings, self.log = Rings(folder), folder / "run.txt"
        self.supervisor: subprocess.Popen[str] | None = None

    def start(self) -> subprocess.Popen[str]:
        """Start `dehyst run`."""
        with open(self.log, "ab") as words:
            self.supervisor = dehyst(
                "run", "--config", str(self.config), stdout=words, stderr=words
            )
        return self.supervisor

    def safe(self) -> int:
        """Run `dehyst safe`, as systemd does at the end; return its exit status."""
        with open(self.log, "ab") as words:
            return dehyst("safe", "--config", str(self.config), stdout=words, stderr=words).wait(60)

    def start_high(self) -> subprocess.Popen[str]:
        """Start the daemon and drive unit A up."""
        supervisor = self.start()
        until(lambda: self.core_pid() and self.rings.last() is not None, 120.0, "samples")
        self.rings.drive(9.0, lambda last: last["volts"] > 60.0)
        return supervisor

    def core_pid(self) -> int:
        """Return the id of the process that writes the rings; 0 if none does."""
        try:
            with RingFile(self.folder / "run" / "telemetry.ring", TELEMETRY) as ring:
                os.kill(ring.pid, 0)
                return ring.pid
        except (BadInput, ProcessLookupError):
            return 0

    def words(self) -> str:
        """Return what the daemon has printed."""
        return self.log.read_text(errors="replace")

    def foreign(self) -> tuple[int, float]:
        """Return (number of sets that unit B received, its output voltage)."""
        state = self.units.ask(1, "state")
        return int(state["sets"]), float(state["outputs_v"]["x"])

    def close(self) -> None:
        """End everything."""
        if self.supervisor is not None and self.supervisor.poll() is None:
            self.supervisor.terminate()
            try:
                self.supervisor.wait(30.0)
            except subprocess.TimeoutExpired:
                self.supervisor.kill()
        if pid := self.core_pid():
            os.kill(pid, signal.SIGKILL)
        self.units.close()


def at_start(rig: Exchanged) -> int:
    """Exchange the units while no daemon runs; return the exit status of the next start."""
    supervisor = rig.start_high()
    supervisor.terminate()
    assert supervisor.wait(60.0) == 0
    rig.units.exchange()
    return rig.start().wait(90.0)


def in_motion(rig: Exchanged) -> int:
    """Exchange the units during a stream of set-points, which continues."""
    supervisor = rig.start_high()
    rig.units.exchange()
    end = time.monotonic() + 3.0
    while time.monotonic() < end:
        rig.rings.command(1, 5.0)  # type: ignore[arg-type]
        time.sleep(0.2)
    supervisor.terminate()
    return supervisor.wait(90.0)


def at_stop(rig: Exchanged) -> int:
    """Exchange the units while the output ramps to its safe state."""
    supervisor = rig.start_high()
    supervisor.terminate()
    until(lambda: rig.rings.state() is State.STOPPING, 20.0, "it ramps")
    rig.units.exchange()
    return supervisor.wait(90.0)


def loop_dead(rig: Exchanged) -> int:
    """Exchange the units as the loop dies; `dehyst safe` finds the other unit."""
    supervisor = rig.start_high()
    pid = rig.core_pid()
    rig.units.exchange()
    os.kill(pid, signal.SIGKILL)
    until(lambda: "trying again" in rig.words(), 60.0, "it cannot be made safe")
    supervisor.terminate()
    return supervisor.wait(90.0)


def supervisor_dead(rig: Exchanged) -> int:
    """Exchange the units as the supervisor dies and the loop ends because of it."""
    supervisor = rig.start_high()
    rig.units.exchange()
    supervisor.kill()
    supervisor.wait(10.0)
    until(lambda: not rig.core_pid(), 90.0, "the loop has ended")
    return rig.safe()


def both_dead(rig: Exchanged) -> int:
    """Exchange the units as both die; what systemd then runs finds the other unit."""
    supervisor = rig.start_high()
    pid = rig.core_pid()
    rig.units.exchange()
    supervisor.kill()
    os.kill(pid, signal.SIGKILL)
    supervisor.wait(10.0)
    until(lambda: not rig.core_pid(), 30.0, "the loop has gone")
    return rig.safe()


_WAYS = (at_start, in_motion, at_stop, loop_dead, supervisor_dead, both_dead)
WAYS: dict[str, Callable[[Exchanged], int]] = {way.__name__: way for way in _WAYS}
