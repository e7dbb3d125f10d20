"""`dehyst run`: core and gateway as child processes, and on the simulated stage the bench too.

What systemd does with the shipped units, for a terminal: the gateway is started again when it
dies; when the core dies, `dehyst safe` brings the output to its configured state and the core is
started again. SIGTERM and SIGINT end the core first (it ramps), then the rest. SIGHUP goes to the
core.
"""

import json
import os
import select
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from dehyst.daemon import clock
from dehyst.daemon.config import Config
from dehyst.daemon.pulse import Pulse
from dehyst.daemon.records import EVENT
from dehyst.daemon.ring import Ring
from dehyst.models.errors import BadInput, DehystError

# -P: a folder called dehyst where the user stands must not be taken for the package
DEHYST = (sys.executable, "-P", "-m", "dehyst.daemon.main")
RESTART_S = 0.5
LONGEST_RESTART_S = 10.0
STOP_S = 60.0  # the longest ramp that is waited for
BENCH_READY_S = 240.0  # with a cold cache the kernels are compiled first


class Child:
    """One child process, started again after it dies."""

    def __init__(self, name: str, arguments: list[str], say: Callable[[str], None]) -> None:
        self.name, self.arguments, self.say = name, arguments, say
        self.process: subprocess.Popen[bytes] | None = None
        self.again_ns = 0
        self._wait_s = RESTART_S
        self._started_ns = 0

    def start(self) -> None:
        """Start it now."""
        self._started_ns = clock.monotonic_ns()
        self.process = subprocess.Popen(
            [*DEHYST, *self.arguments],
            stdin=subprocess.DEVNULL,
            env={**os.environ, "DEHYST_SUPERVISED": "1"},
            start_new_session=True,  # a Ctrl-C at the terminal reaches the supervisor alone
        )

    def died(self) -> int | None:
        """Its exit code when it is no longer running and not yet scheduled again."""
        if self.process is None:
            return None
        code = self.process.poll()
        if code is None:
            return None
        self.process = None
        lived_s = (clock.monotonic_ns() - self._started_ns) * 1e-9
        self._wait_s = RESTART_S if lived_s > 30 else min(2 * self._wait_s, LONGEST_RESTART_S)
        self.again_ns = clock.monotonic_ns() + round(self._wait_s * 1e9)
        return code

    def signal(self, number: int) -> None:
        """Pass a signal on."""
        if self.process is not None and self.process.poll() is None:
            self.process.send_signal(number)

    def end(self, timeout_s: float) -> int:
        """SIGTERM and wait; SIGKILL after the time-out. Returns the exit code."""
        if self.process is None:
            return 0
        self.signal(signal.SIGTERM)
        try:
            return self.process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            self.say(f"{self.name} does not end; killing it")
            self.process.kill()
            return self.process.wait(5.0)


class Supervisor:
    """Runs core and gateway for one configuration file."""

    def __init__(self, config: Config, path: Path, say: Callable[[str], None]) -> None:
        self.config, self.path, self.say = config, path, say
        option = ["--config", str(path)]
        self.core = Child("core", ["core", *option], say)
        self.gateway = Child("gateway", ["gateway", *option], say)
        self._wake_read, self._wake_write = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        self._ending = self._unsafe = False
        self._pulse = Pulse(config.directory)
        self._events: Ring | None = None
        self._told = 0
        self.code = 0

    def run(self) -> int:
        """Until a signal; 0, or 2 where the core refuses to start."""
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._on_end)
        signal.signal(signal.SIGHUP, lambda *_: self.core.signal(signal.SIGHUP))
        signal.signal(signal.SIGCHLD, lambda *_: self._wake())
        try:
            self._watch()
        finally:  # whatever happened, nothing that drives the stage is left behind
            if self.core.process is not None:
                self.say("ending: the output goes to its configured state")
                self.core.end(STOP_S)
            self._tell_events()
            self.gateway.end(10.0)
        return self.code

    def _watch(self) -> None:
        self.core.start()
        self.gateway.start()
        started = False
        while not self._ending:
            self._sleep(0.5)
            self._tell_events()
            self._end_hanging()
            code = self.core.died()
            if code is not None and not self._ending:
                if code == 2 and not started:
                    self.code = 2  # it has said why on stderr
                    return
                self.say(f"core ended with code {code}: bringing the output to its safe state")
                self._safe()
                self._pulse.restart()
            started = started or self._pulse.beats
            code = self.gateway.died()
            if code is not None and not self._ending:
                self.say(f"gateway ended with code {code}: starting it again")
            now = clock.monotonic_ns()
            for child in (self.core, self.gateway):
                if child.process is None and now >= child.again_ns and not self._ending:
                    if child is self.core and self._unsafe:
                        self._safe()
                    if child is self.core and self._unsafe:  # the amplifier is still away
                        child.again_ns = clock.monotonic_ns() + round(RESTART_S * 1e9)
                    else:
                        child.start()

    def _end_hanging(self) -> None:
        """Kill a process that stands still, as systemd's watchdog does; it is started again."""
        core_hangs, gateway_hangs = self._pulse.hanging(clock.monotonic_ns())
        for child, hangs in ((self.core, core_hangs), (self.gateway, gateway_hangs)):
            if hangs and child.process is not None and child.process.poll() is None:
                self.say(f"{child.name} hangs; killing it")
                child.process.kill()
                child.process.wait(5.0)

    def _tell_events(self) -> None:
        """Say what the loop has to say."""
        try:
            if self._events is None or self._events.stale():
                self._events = Ring.attach(self.config.directory / "event.ring", EVENT)
                self._told = 0
        except BadInput:
            return  # no loop yet
        records, self._told, _ = self._events.read(self._told)
        for record in records:
            self.say(bytes(record["text"]).decode("utf-8", "replace"))

    def _safe(self) -> None:
        """Bring the output to its safe state; remembered where that is not possible now."""
        command = [*DEHYST, "safe", "--config", str(self.path)]
        try:
            done = subprocess.run(command, stdin=subprocess.DEVNULL, check=False, timeout=STOP_S)
            self._unsafe = done.returncode != 0
        except subprocess.TimeoutExpired:
            self._unsafe = True
        if self._unsafe:
            self.say("the output could not be brought to its safe state")

    def _on_end(self, *_: Any) -> None:
        self._ending = True
        self._wake()

    def _wake(self) -> None:
        try:
            os.write(self._wake_write, b"!")
        except BlockingIOError:
            return  # a wake-up is already waiting

    def _sleep(self, seconds: float) -> None:
        select.select([self._wake_read], [], [], seconds)
        try:
            os.read(self._wake_read, 4096)
        except BlockingIOError:
            return


class Bench:
    """The emulated bench as a child process: an MDT693B and a KSG101 on pseudo terminals."""

    def __init__(self, directory: Path, arguments: list[str]) -> None:
        self.process = subprocess.Popen(
            [
                *DEHYST, "emulate", "--dir", str(directory), *arguments,
            ],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            env={**os.environ, "DEHYST_SUPERVISED": "1"},
            start_new_session=True,
        )  # fmt: skip
        assert self.process.stdout is not None
        ready, _, _ = select.select([self.process.stdout], [], [], BENCH_READY_S)
        line = self.process.stdout.readline() if ready else b""
        try:
            self.ports: dict[str, str] = json.loads(line)
        except ValueError:
            self.close()
            raise DehystError("the emulated bench did not start; try `dehyst emulate`") from None

    def close(self) -> None:
        """End it."""
        self.process.terminate()
        try:
            self.process.wait(10.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait(5.0)
        if self.process.stdout is not None:
            self.process.stdout.close()
