"""The doctor's process: wait for cases of all axes, and have each examined by a child process with
limits, one at a time.

The child (dehyst.daemon.doctor.examination) writes its result into the folder of the case. If it
crashes, takes too long or uses too much memory, this process records the failure, so that no case
is tried twice. The process itself imports nothing that computes.
"""

import logging
import multiprocessing
import os
import signal
import threading
from pathlib import Path

from dehyst.daemon import clock, notify
from dehyst.daemon.config import Config, Controller
from dehyst.daemon.doctor.child import examine_case
from dehyst.daemon.files import cases
from dehyst.daemon.files.cases import Case, Examined

log = logging.getLogger(__name__)
LOOK_S = 0.5  # between two signs of life to systemd's watchdog
STARVED = 6.0
"""Longest duration of an examination that waits for a processor, as a multiple of its time limit:
it runs at the lowest priority."""


class Doctor:
    """`run` returns after `end` is called."""

    def __init__(self, controller: Controller) -> None:
        self._stop = threading.Event()
        # if no axis enables it for `dehyst run`, the doctor was started by hand: examine all axes
        self._axes = [a for a in controller.axes if a.doctor.enabled] or controller.axes
        self._ending = False

    def end(self) -> None:
        """Ask `run` to return; may be called from a signal handler."""
        self._ending = True

    def run(self) -> None:
        """Examine cases until `end` is called."""
        notify.send("READY=1", "STATUS=waiting")
        while not self._ending:
            for config in self._axes:
                folder = _newest_open(config)
                if folder is not None and not self._ending:
                    self._examine(config, folder)
            notify.send("WATCHDOG=1", "STATUS=waiting")
            self._stop.wait(LOOK_S)
        notify.send("STOPPING=1")

    def _examine(self, config: Config, folder: Path) -> None:
        limits = config.doctor
        log.info("%s: examining", folder.name)
        begun_ns = clock.monotonic_ns()
        spawn = multiprocessing.get_context("spawn")
        child = spawn.Process(target=examine_case, args=(str(folder), limits.memory_gb))
        child.start()
        why = ""
        try:
            while child.is_alive():
                child.join(LOOK_S)
                notify.send("WATCHDOG=1", f"STATUS=examining {folder.name}")
                if self._ending:
                    return  # it is examined again after the next start
                spent_s = (clock.monotonic_ns() - begun_ns) / clock.NS
                if why := why_to_stop(limits.time_s, spent_s, processor_s(child.pid or 0)):
                    break
        finally:
            child.kill()
            child.join(5.0)
        spent_s = (clock.monotonic_ns() - begun_ns) / clock.NS
        if (folder / cases.EXAMINED).exists():
            log.info("%s: examined, in %.0f s", folder.name, spent_s)
        else:
            why = why or describe_exit(child.exitcode)
            says = f"The recording could not be diagnosed: {why}."
            log.warning("%s: not examined, after %.0f s: %s", folder.name, spent_s, why)
            try:
                cases.put_record(folder, cases.EXAMINED, Examined(failed=True, says=says))
            except OSError as error:
                log.error("%s: %s: %s", folder.name, says, error)
                self._stop.wait(10.0)  # the disk may be full: try again later


def describe_exit(code: int | None) -> str:
    """Return how the child ended, in words. A child that ran out of its own memory has reported
    that itself."""
    if code is None or code >= 0:
        return f"its process ended with exit code {code} and left no result"
    try:
        name = signal.Signals(-code).name
    except ValueError:
        name = f"signal {-code}"
    if -code == signal.SIGKILL:
        return f"its process was killed from outside ({name}), as happens when memory runs out"
    return f"its process was ended by {name}"


def why_to_stop(time_s: float, spent_s: float, worked_s: float) -> str:
    """Return why an examination must end, in words; "" if it may continue. spent_s: time since it
    began; worked_s: processor time. Waiting for a processor does not count as slow."""
    if worked_s > time_s:
        return f"it did not finish within {worked_s:.0f} s of processor time"
    if spent_s > STARVED * time_s:
        return (
            f"other processes left it only {worked_s:.0f} s of processor time in {spent_s:.0f} s; "
            f"it may use {time_s:g} s"
        )
    return ""


def processor_s(pid: int) -> float:
    """Return the processor time that a process has used [s]; 0 if it has ended."""
    try:
        words = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


def _newest_open(config: Config) -> Path | None:
    """Return the newest case of an axis that has not been examined."""
    open_ones = [
        folder
        for folder in cases.case_folders(config.watch_directory)
        if not (folder / cases.EXAMINED).exists()
        and cases.get_record(folder, cases.CASE, Case) is not None
    ]
    return open_ones[-1] if open_ones else None


def run_doctor(controller: Controller) -> int:
    """Run the doctor's process until SIGTERM or SIGINT; return its exit code."""
    doctor = Doctor(controller)
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: doctor.end())
    doctor.run()
    return 0
