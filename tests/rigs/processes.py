"""Real processes for tests: the emulated bench, the core, the gateway, and their rings."""

import json
import os
import random
import re
import select
import signal
import socket
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from dehyst.daemon.rings.records import COMMAND, EVENT, TELEMETRY, LoopCommand, State
from dehyst.daemon.rings.ring import Ring
from dehyst.daemon.rings.status import STATUS

DTYPES = {"telemetry": TELEMETRY, "status": STATUS, "event": EVENT, "command": COMMAND}
SLEW = 4000.0
TIMEOUT_S = 1.0
"""Of the emulated devices: their process may stand still for longer than a unit does."""
PATIENT = f"timeout_s = {TIMEOUT_S}"
ATTEMPTS = 3
TIMED_OUT = re.compile(r"\bwithin [\d.]+ s\b")
REPEATABLE = "The same command repeats it"

CONFIG = """
name = "test"
run_dir = "{run}"
[model]
file = "{model}"
[loop]
rate_hz = {rate}
{loop}
[actuator]
driver = "{actuator}"
settings = {actuator_settings}
[sensor]
driver = "{sensor}"
settings = {sensor_settings}
[limits]
min_v = 0.0
max_v = 150.0
slew_v_per_s = 4000.0
[safe]
voltage_v = 5.0
ramp_v_per_s = 200.0
on_fault = "ramp"
[setpoint]
stale_s = 1.0
hold_s = 0.5
[trim]
enabled = {trim}
"""


def dehyst(*arguments: str, **options: Any) -> "subprocess.Popen[str]":
    """Start a dehyst command; it dies with the test."""
    return subprocess.Popen(
        [sys.executable, "-P", "-m", "dehyst.daemon.main", *arguments],
        stdin=subprocess.DEVNULL,
        text=True,
        env={**os.environ, "DEHYST_SUPERVISED": "1"},
        **{"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **options},
    )


def as_hardware(process: "subprocess.Popen[Any]", ready: bool = False) -> None:
    """Give an emulated device a device's priority: if permitted, no other process delays it, and
    once it is ready, not even a loop that waits for its answer."""
    with suppress(PermissionError):
        os.setpriority(os.PRIO_PROCESS, process.pid, -15)
        if ready:
            os.sched_setscheduler(process.pid, os.SCHED_FIFO, os.sched_param(90))


def one_cpu() -> int:
    """Return a CPU for a loop whose timing is not judged: a witness on every CPU would take three
    times as much of the machine as the loop itself."""
    return random.choice(sorted(os.sched_getaffinity(0)))


def until(condition: Any, seconds: float = 60.0, what: str | Callable[[], str] = "") -> Any:
    """Poll until the condition's value is true, and return it. what: the words of a failure."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        value = condition()
        if value:
            return value
        time.sleep(0.01)
    words = what() if callable(what) else what
    raise AssertionError(f"not within {seconds} s: {words or condition}")


def simulated_config(
    folder: Path, rate: float, model: Path, loop: str = "", trim: bool = False
) -> Path:
    """Write a configuration on the in-process simulated stage; loop: further lines of [loop]."""
    path = folder / "config.toml"
    path.write_text(
        CONFIG.format(
            run=folder / "run", model=model, rate=rate, loop=loop, actuator="simulated",
            sensor="simulated",
            actuator_settings='{stage = "t"}', sensor_settings='{stage = "t"}',
            trim=str(trim).lower(),
        )
    )  # fmt: skip
    return path


class EmulatedBench:
    """`dehyst emulate` as a process, with its control socket and its log of the output."""

    def __init__(self, folder: Path, *arguments: str) -> None:
        self.folder, self.log = folder, folder / "output.npz"
        self.process = dehyst("emulate", "--dir", str(folder / "bench"), "--log", str(self.log),
                              *arguments)  # fmt: skip
        as_hardware(self.process)
        assert self.process.stdout is not None
        ready, _, _ = select.select([self.process.stdout], [], [], 60.0)
        assert ready, "the bench did not start"
        self.ports: dict[str, str] = json.loads(self.process.stdout.readline())
        as_hardware(self.process, ready=True)

    def config(self, rate: float, model: Path) -> Path:
        """Write a configuration on this bench."""
        path = self.folder / "config.toml"
        path.write_text(
            CONFIG.format(
                run=self.folder / "run", model=model, rate=rate, actuator="mdt693b",
                sensor="ksg101", loop=f"cpu = {one_cpu()}",
                actuator_settings=f'{{port = "{self.ports["mdt693b"]}", {PATIENT}}}',
                sensor_settings=f'{{port = "{self.ports["ksg101"]}", {PATIENT}}}',
                trim="false",
            )
        )  # fmt: skip
        return path

    def control(self, **order: Any) -> None:
        """Send an order to the control socket."""
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
            sender.sendto(json.dumps(order).encode(), self.ports["control"])

    def output(self) -> tuple[np.ndarray, np.ndarray]:
        """Return (time_ns, volts) at the amplifier's output so far."""
        logged = self.logged()
        return logged["time_ns"], logged["volts"]

    def logged(self) -> dict[str, np.ndarray]:
        """Return the bench's log so far: time_ns, volts; reading_ns, reading_um, true_um."""
        self.log.unlink(missing_ok=True)
        self.control(save=True)
        until(self.log.exists, 10.0, "the bench's log")
        with np.load(self.log) as data:
            return dict(data)

    def close(self) -> None:
        """End it."""
        end(self.process)


class Rings:
    """The rings of a running core; axis: selects one of its axes, if it has several."""

    def __init__(self, folder: Path, axis: str = "") -> None:
        self.folder = folder / "run" / axis

    def read(self, name: str) -> np.ndarray:
        """Return all records that the ring still holds."""
        ring = Ring.attach(self.folder / f"{name}.ring", DTYPES[name])
        records = ring.read(0)[0]
        ring.close()
        return records

    def last(self, name: str = "telemetry") -> Any:
        """Return the newest record; None if there is none."""
        try:
            ring = Ring.attach(self.folder / f"{name}.ring", DTYPES[name])
            records = ring.read(max(0, ring.head - 1))[0]
            ring.close()
        except Exception:
            return None
        return records[-1] if records.size else None

    def state(self) -> State | None:
        """Return the core's state."""
        record = self.last()
        return None if record is None else State(int(record["state"]))

    def events(self) -> str:
        """Return all event texts."""
        return "\n".join(r["text"].decode() for r in self.read("event"))

    def drive(self, value: float, done: Callable[[Any], bool], seconds: float = 60.0) -> Any:
        """Repeat this set-point, before it goes stale, until the newest sample satisfies `done`;
        return that sample."""

        def there() -> Any:
            nonlocal given
            if time.monotonic() - given > 0.3:
                given = time.monotonic()
                self.command(LoopCommand.SETPOINT, value)
            last = self.last()
            return last if last is not None and done(last) else None

        given = 0.0
        return until(there, seconds, f"{value} is followed")

    def command(self, kind: LoopCommand, value: float = 0.0) -> None:
        """Send one command as the gateway would."""
        row = np.zeros(1, COMMAND)
        row["kind"], row["value"] = kind, value
        self.commands(row)

    def commands(self, batch: np.ndarray) -> None:
        """Send commands as the gateway would."""
        ring = Ring.attach(self.folder / "command.ring", COMMAND)
        ring.push_many(batch)
        ring.close()


def say_repeated(what: str, why: str) -> None:
    """Report in pytest's summary that something is repeated, and why."""
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        warnings.warn(f"repeated: {what}: {why}", stacklevel=2)


def set_up(*arguments: str, seconds: float = 280.0) -> "tuple[subprocess.Popen[str], str, str]":
    """Run `dehyst setup`, and run it again as it says itself where a device that was late ended it,
    ATTEMPTS times at most, all within `seconds`. Return (process, stdout, stderr), the latter of
    all attempts."""
    deadline, said = time.monotonic() + seconds, ""
    for attempt in range(1, ATTEMPTS + 1):
        process = dehyst("setup", *arguments)
        try:
            out, err = process.communicate(timeout=max(1.0, deadline - time.monotonic()))
        finally:
            process.kill()
        said += err
        last = " ".join(err.split())
        ended_late = REPEATABLE in last and (late := TIMED_OUT.search(last))
        if process.returncode == 0 or not ended_late or attempt == ATTEMPTS:
            break
        say_repeated("dehyst setup", f"a device did not answer {late[0]}")
    return process, out, said


def end(process: "subprocess.Popen[str]", timeout: float = 30.0) -> int:
    """Send SIGTERM, wait, send SIGKILL if necessary; return the exit code."""
    if process.poll() is None:
        process.send_signal(signal.SIGTERM)
    try:
        process.communicate(timeout=timeout)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate(timeout=10)
    return int(process.returncode)


@contextmanager
def emulated_bench(folder: Path, *arguments: str) -> Iterator[dict[str, str]]:
    """Run `dehyst emulate` with ports and control socket in `folder`; end it by SIGTERM."""
    process = dehyst("emulate", *arguments, "--dir", str(folder), stderr=None)
    try:
        assert process.stdout is not None
        yield json.loads(process.stdout.readline())
        process.send_signal(signal.SIGTERM)
        assert process.wait(30.0) == 0
    finally:
        process.kill()
        process.communicate()  # closes the pipe


@contextmanager
def core(config: Path, axis: str = "") -> Iterator["subprocess.Popen[str]"]:
    """Run `dehyst core`; yield when it has written its first sample. axis: one of several."""
    ring = config.parent / "run" / axis / "telemetry.ring"
    old = ring.stat().st_ino if ring.exists() else 0
    process = dehyst("core", "--config", str(config))
    rings = Rings(config.parent, axis)

    def first_sample() -> bool:
        fresh = ring.exists() and ring.stat().st_ino != old
        return (fresh and rings.last() is not None) or process.poll() is not None

    try:
        until(first_sample, 110.0, "first sample")  # the kernels may have to be compiled
        assert process.poll() is None, process.communicate()[1]
        yield process
    finally:
        end(process)
