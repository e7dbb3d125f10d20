"""`dehyst run`: core and gateway as child processes, and with the simulated stage also the bench.

This does in a terminal what systemd does with the shipped units. The core follows the state table
in dehyst.daemon.service.life; this module detects the events and enters the states. The gateway is
restarted when it dies, after growing pauses if it cannot start. SIGTERM and SIGINT end the core
first (it may take as long as its ramp needs), then the rest. SIGHUP is passed to the core.
"""

import json
import os
import select
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from dehyst.daemon import clock, log_lines, notify
from dehyst.daemon.config import Config, Controller
from dehyst.daemon.service.event_log import EventLog
from dehyst.daemon.service.heartbeat import Heartbeats
from dehyst.daemon.service.life import NEXT, Life, LifeEvent
from dehyst.daemon.terminal.what_follows import after_a_death, at_the_end
from dehyst.models.errors import DehystError

# -P: a folder called dehyst in the working directory must not be taken for the package
DEHYST = (sys.executable, "-P", "-m", "dehyst.daemon.main")
FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.5, 30.0  # before a restart; doubles at each failure
SPARE_S = 20.0  # in addition to a ramp's duration: for slow devices, a busy machine
BENCH_READY_S = 240.0  # with a cold cache, the kernels are compiled first
LOOK_S = 0.25  # interval at which the processes are checked
UNBORN = 126  # for one that could not be started: the shell's status for such a command


class Child:
    """One child process that is restarted after it dies; the pauses grow until it has worked."""

    def __init__(self, name: str, arguments: list[str]) -> None:
        self.name, self.arguments = name, arguments
        self.process: subprocess.Popen[bytes] | None = None
        self.pause_s, self.due_ns = FIRST_PAUSE_S, 0
        self._unborn = False

    def start(self) -> None:
        """Start it now. If the system cannot create a process, it counts as one that died."""
        # SIGHUP stays blocked until the child has installed its handler
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGHUP})
        try:
            self.process = subprocess.Popen(
                [*DEHYST, *self.arguments],
                stdin=subprocess.DEVNULL,
                start_new_session=True,  # Ctrl-C at the terminal reaches only the supervisor
                **log_lines.for_child(),
            )
        except OSError:
            self._unborn = True
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)

    @property
    def pid(self) -> int:
        """Process id; 0 if it is not running."""
        return 0 if self.process is None else self.process.pid

    def died(self, worked: bool) -> int | None:
        """Return its exit code once after it has ended, otherwise None. worked: it did its work
        before it ended, so the pause is reset."""
        code = None if self.process is None else self.process.poll()
        if self._unborn:
            code, self._unborn = UNBORN, False
        if code is not None:
            self.process = None
            self.pause_s = FIRST_PAUSE_S if worked else min(2 * self.pause_s, LONGEST_PAUSE_S)
            self.due_ns = clock.monotonic_ns() + round(self.pause_s * clock.NS)
        return code

    @property
    def due(self) -> bool:
        """True if it is not running and its pause is over."""
        return self.process is None and clock.monotonic_ns() >= self.due_ns

    def signal(self, number: int) -> None:
        """Send it a signal if it runs."""
        if self.process is not None and self.process.poll() is None:
            self.process.send_signal(number)

    def kill(self) -> None:
        """Kill it with SIGKILL."""
        if self.process is not None:
            self.process.kill()
            with suppress(subprocess.TimeoutExpired):  # it is in a kernel call and ends later
                self.process.wait(5.0)


class Supervisor:
    """Runs core and gateway for one configuration file with any number of axes."""

    def __init__(self, controller: Controller, path: Path, say: Callable[[str], None]) -> None:
        self.controller, self.path, self.say = controller, path, say
        option = ["--config", str(path)]
        self.core = Child("core", ["core", *option])
        self.gateway = Child("gateway", ["gateway", *option])
        self.safe = Child("safe", ["safe", *option])
        self.page = Child("page", ["page", *option]) if controller.page is not None else None
        doctor = any(axis.doctor.enabled for axis in controller.axes)
        self.doctor = Child("doctor", ["doctor", *option]) if doctor else None
        self.life, self.code = Life.WAITING, 0
        self._wake_read, self._wake_write = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        self._end_asked = self._reload_asked = False
        self._heartbeat = Heartbeats([axis.directory for axis in controller.axes])
        self._events = [EventLog(axis, say) for axis in controller.axes]
        self._pid = 0
        self._entered_ns = 0
        self._began_ns: dict[str, int] = {}
        self._ever = self._ready = self._folder_gone = False
        self._begun = True  # False: the core was asked to end before it had its signal handlers

    def run(self) -> int:
        """Run until a signal. Return 0; 1 if the output had to be made safe by force or could not
        be made safe; 2 if the core refused to start."""
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._on_end)
        signal.signal(signal.SIGHUP, self._on_reload)
        signal.signal(signal.SIGCHLD, lambda *_: self._wake())
        try:
            self._enter(Life.STARTING)
            self._start_gateway()
            while self.life is not Life.OVER:
                self._sleep(LOOK_S)
                self._look()
        finally:  # whatever happened, no process that drives the stage may remain
            self._end(self.core, self.patience_s)
            self._log_events()
            for child in (self.page, self.doctor):
                if child is not None:
                    self._end(child, 10.0)
            self._end(self.gateway, 10.0)
        return self.code

    # -- events ---------------------------------------------------------------------------------

    def _look(self) -> None:
        """Detect what has happened; each event leads to the state in the table."""
        self._heartbeat.look(clock.monotonic_ns())
        self._log_events()
        self._look_for_folder()
        beats = self._heartbeat.core_moves
        if beats and self.core.process is not None:
            self._ever = True
            self._happens(LifeEvent.SAMPLE)
        if self._reload_asked and self.life is Life.BEATING:  # a starting core ignores SIGHUP
            self._reload_asked = False
            self.core.signal(signal.SIGHUP)
        code = self.core.died(beats)
        if code is not None:
            self._log_events()
            self._core_died(code)
        code = self.safe.died(True)
        if code is not None:
            self._happens(LifeEvent.FAILED if code else LifeEvent.SAVED)
        if self._still():
            self._happens(LifeEvent.STILL)
        if self._end_asked:
            self._end_asked = False
            self._happens(LifeEvent.END)
        self._look_at_gateway()
        self._look_at(self.page)
        self._look_at(self.doctor)
        if self.core.due:
            self._happens(LifeEvent.DUE)

    def _core_died(self, code: int) -> None:
        if code == 2 and not self._ever:
            self.code = 2  # it has said why on stderr
            self._happens(LifeEvent.REFUSED)
        elif code == 0:
            self._happens(LifeEvent.WELL)
        elif self.life is Life.ENDING and code == -signal.SIGTERM:
            self._begun = False
            self.say(f"the core had not begun: {self._of_axes(after_a_death)}")
            self._happens(LifeEvent.DIED)
        else:
            self.say(f"core ended with code {code}: {self._of_axes(after_a_death)}")
            self._happens(LifeEvent.DIED)

    def _still(self) -> bool:
        """True if the running process has exceeded the time that its state allows."""
        if self.life in (Life.STARTING, Life.BEATING):
            return self._heartbeat.core_hangs
        if self.life in (Life.ENDING, Life.SAVING, Life.LAST):
            return clock.monotonic_ns() - self._entered_ns > self.patience_s * clock.NS
        return False

    @property
    def patience_s(self) -> float:
        """Longest time for a ramp, by the core as it ends or by `dehyst safe` [s]."""
        return self.controller.longest_ramp_s + SPARE_S

    # -- states ---------------------------------------------------------------------------------

    def _happens(self, event: LifeEvent) -> None:
        before, after = self.life, NEXT[self.life, event]
        if after is before:
            return
        if event is LifeEvent.STILL:
            stuck = self.core if self.core.process is not None else self.safe
            self.say(f"{stuck.name} hangs; killing it")
            stuck.kill()
            stuck.died(False)
        if after is Life.LAST and before is Life.SAVING:  # `dehyst safe` already runs
            self.life = after
            return
        if before is Life.LAST and event is not LifeEvent.SAVED:
            self.say("ending although the output could not be brought to its safe state")
            self.code = 1
        self._enter(after)

    def _enter(self, life: Life) -> None:
        self.life, self._entered_ns = life, clock.monotonic_ns()
        if life is Life.STARTING:
            self.core.start()
            self._pid = self.core.pid
            self._heartbeat.core_started(self._pid)
            self._ready = False
        elif life is Life.ENDING:
            self.say(f"ending: {self._of_axes(at_the_end)}")
            self.core.signal(signal.SIGTERM)
        elif life in (Life.SAVING, Life.LAST):
            if life is Life.LAST and self._begun:
                self.code = 1
            self.safe.start()
        elif life is Life.UNSAFE:
            self.say("the output could not be brought to its safe state; trying again")
            self.core.due_ns = clock.monotonic_ns() + round(self.core.pause_s * clock.NS)

    # -- gateway --------------------------------------------------------------------------------

    def _start_gateway(self) -> None:
        self.gateway.start()
        self._heartbeat.gateway_started()
        self._ready = False

    def _look_at_gateway(self) -> None:
        if self._heartbeat.gateway_hangs and self.gateway.process is not None:
            self.say("gateway hangs; killing it")
            self.gateway.kill()
        code = self.gateway.died(self._heartbeat.gateway_moves)
        if code is not None:
            state = (
                f"not ready: gateway ended with code {code}; clients cannot reach this daemon; "
                f"next try in {self.gateway.pause_s:g} s"
            )
            self.say(state)
            notify.send(f"STATUS={state}")
        if self.gateway.due and self.life not in (Life.ENDING, Life.LAST, Life.OVER):
            self._start_gateway()
        if not self._ready and self._heartbeat.gateway_moves and self.life is Life.BEATING:
            self._ready = True
            net = self.controller.bus
            where = ", ".join((*net.listen, *net.connect))
            names = ", ".join(axis.name for axis in self.controller.axes)
            self.say(f"ready: clients reach {names} at {where}")
            notify.send("STATUS=ready")

    def _look_at(self, child: Child | None) -> None:
        """Restart the page or the doctor if it has died. Neither is essential: loop and gateway
        continue without them. The doctor starts only once the loop writes samples, so that it does
        not delay the start."""
        if child is None:
            return
        began_ns = self._began_ns.get(child.name, 0)
        code = child.died(clock.monotonic_ns() - began_ns > LONGEST_PAUSE_S * clock.NS)
        if code is not None:
            self.say(f"the {child.name} ended with code {code}; next try in {child.pause_s:g} s")
        if child is self.doctor and self.life is not Life.BEATING:
            return
        if child.due and self.life not in (Life.ENDING, Life.LAST, Life.OVER):
            self._began_ns[child.name] = clock.monotonic_ns()
            child.start()

    def _of_axes(self, words: Callable[[Config], str]) -> str:
        """Describe something of every axis, once where all are alike."""
        said = {axis.axis: words(axis) for axis in self.controller.axes}
        if len(set(said.values())) == 1:
            return next(iter(said.values()))
        return "; ".join(f"{axis}: {text}" for axis, text in said.items())

    # -- the rest -------------------------------------------------------------------------------

    def _end(self, child: Child, timeout_s: float) -> None:
        """Send SIGTERM and wait; send SIGKILL after the time-out."""
        if child.process is None:
            return
        child.signal(signal.SIGTERM)
        try:
            child.process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            self.say(f"{child.name} does not end; killing it")
            child.kill()
            self.code = self.code or 1

    def _look_for_folder(self) -> None:
        """Report once that the rings are gone: running processes continue with the files that they
        have open, but a process started now cannot find them."""
        rings = [axis.directory / "telemetry.ring" for axis in self.controller.axes]
        gone = self.life is Life.BEATING and not all(os.path.lexists(ring) for ring in rings)
        if gone and not self._folder_gone:
            self.say(
                f"the run folder {self.controller.directory} or its rings have gone; the loop "
                "goes on without them, but a new gateway could not reach it: end the daemon and "
                "start it again"
            )
        self._folder_gone = gone

    def _log_events(self) -> None:
        """Report the new events of this run of the loop, with their times."""
        for events in self._events:
            events.log_new(self._pid)

    def _on_end(self, *_: Any) -> None:
        self._end_asked = True
        self._wake()

    def _on_reload(self, *_: Any) -> None:
        self._reload_asked = True
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


class BenchProcess:
    """The emulated bench as a child process: an MDT693B and a KSG101 on pseudo terminals."""

    def __init__(self, directory: Path, arguments: list[str]) -> None:
        self.process = subprocess.Popen(
            [*DEHYST, "emulate", "--dir", str(directory), *arguments],
            stdin=subprocess.DEVNULL,
            start_new_session=True,
            **(log_lines.for_child() | {"stdout": subprocess.PIPE}),
        )
        try:
            self.ports = self._wait()
        except BaseException:  # including an interrupt during the start
            self.close()
            raise

    def _wait(self) -> dict[str, str]:
        """Wait until the bench serves its ports; return them. Raises DehystError."""
        assert self.process.stdout is not None
        ready, _, _ = select.select([self.process.stdout], [], [], BENCH_READY_S)
        line = self.process.stdout.readline() if ready else b""
        try:
            ports: dict[str, str] = json.loads(line)
        except ValueError:
            raise DehystError("the emulated bench did not start; try `dehyst emulate`") from None
        return ports

    def close(self) -> None:
        """End the bench."""
        self.process.terminate()
        try:
            self.process.wait(10.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait(5.0)
        if self.process.stdout is not None:
            self.process.stdout.close()
