"""Real-time services of the operating system: priority, locked memory, idle states, timer slack.

Every call reports what was really obtained. None raises where a privilege is missing, because the
daemon must also run for a user without privileges (and then reports it in its status).
"""

import ctypes
import functools
import gc
import os
import struct
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from dehyst.drivers import system

_PR_SET_PDEATHSIG, _PR_SET_TIMERSLACK = 1, 29
_MCL_CURRENT, _MCL_FUTURE, _MCL_ONFAULT = 1, 2, 4
IDLE_LATENCY, AWAKE_FROM_HZ = "/dev/cpu_dma_latency", 1000.0  # at 1 kHz, 100 us are 10 %


@functools.cache
def _libc() -> ctypes.CDLL:
    return ctypes.CDLL(None, use_errno=True)


@dataclass(frozen=True)
class Obtained:
    """Real-time properties that the process obtained."""

    fifo: bool
    priority: int
    locked: bool
    cpus: tuple[int, ...]
    advice: tuple[str, ...] = ()
    awake: bool = False


def leave_realtime() -> None:
    """Set ordinary scheduling for the calling thread, which may have the loop's priority."""
    if hasattr(os, "sched_setscheduler"):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def enter_realtime(priority: int, cpu: int, rate_hz: float) -> Obtained:
    """Set FIFO scheduling at `priority` (0: leave), pin to `cpu` (-1: leave), lock memory, and turn
    garbage collection off.

    This applies to the calling thread and threads that it makes later. A loop with priority and a
    rate of AWAKE_FROM_HZ or more also keeps the CPUs out of idle states that take long to leave.
    """
    advice = []
    if cpu >= 0:
        try:
            os.sched_setaffinity(0, {cpu})
        except OSError as error:
            advice.append(f"loop.cpu = {cpu} refused: {error.strerror}")
    fifo = False
    if priority > 0:
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
            fifo = True
        except OSError:
            advice.append(
                "no FIFO scheduling: give the user LimitRTPRIO=80 (the systemd unit does) or "
                "`ulimit -r 80`; the loop runs at ordinary priority"
            )
    finest_timer()
    locked = _libc().mlockall(_MCL_CURRENT | _MCL_FUTURE | _MCL_ONFAULT) == 0
    if not locked:
        advice.append("memory not locked: LimitMEMLOCK=infinity (the systemd unit sets it)")
    wanted = priority > 0 and rate_hz >= AWAKE_FROM_HZ
    awake = wanted and stay_awake()
    if wanted and not awake:
        advice.append(
            f"idle states not bounded: {IDLE_LATENCY} is not writable (the udev rule opens it to "
            "the daemon's group); wake-ups may take some 100 us longer"
        )
    # other threads release the interpreter within 50 us instead of 5 ms
    sys.setswitchinterval(5e-5)
    gc.collect()
    gc.freeze()
    gc.disable()
    return Obtained(
        fifo,
        priority if fifo else 0,
        locked,
        tuple(sorted(os.sched_getaffinity(0))),
        tuple(advice),
        awake,
    )


@functools.cache
def stay_awake() -> bool:
    """Request idle states without exit latency; the request lasts as long as the process.

    The file must stay open for that (Linux, Documentation/power/pm_qos_interface.rst).
    """
    try:
        file = os.open(IDLE_LATENCY, os.O_WRONLY | os.O_CLOEXEC)
        os.write(file, struct.pack("=i", 0))
    except OSError:
        return False
    return True


NICE = {"run": -10, "core": -10, "safe": -15, "gateway": -5, "page": 5}
"""Nice values by command: on a busy machine, the processes that keep the output safe come before
those that serve clients. The doctor sets the lowest priority itself."""
EXPENDABLE = {"page": 500, "doctor": 800}
"""Values of oom_score_adj: which process the kernel ends first when memory runs out."""


def take_place(command: str) -> None:
    """Give this thread, and those that it starts, the priority of their process, where allowed. The
    scheduler weighs a session as a group with its own nice value; only the process that leads the
    session sets it, because everything run in a terminal belongs to one session."""
    if os.getsid(0) == os.getpid():
        with suppress(OSError, KeyError):
            Path("/proc/self/autogroup").write_text(f"{NICE[command]}", "ascii")
    with suppress(OSError, KeyError):
        os.setpriority(os.PRIO_PROCESS, 0, NICE[command])
    with suppress(OSError, KeyError):
        Path("/proc/self/oom_score_adj").write_text(f"{EXPENDABLE[command]}", "ascii")


def finest_timer() -> None:
    """Set the timer slack of this thread to 1 ns; ordinary threads have 50 us."""
    _libc().prctl(_PR_SET_TIMERSLACK, ctypes.c_ulong(1), 0, 0, 0)


@contextmanager
def raised(priority: int) -> Iterator[None]:
    """Set FIFO scheduling at `priority` for the calling thread during the block, where allowed; 0:
    leave it."""
    if priority == 0:
        yield
        return
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except (OSError, ValueError):
        yield
        return
    try:
        yield
    finally:
        os.sched_setscheduler(0, *before)


def die_with_parent(signal_number: int) -> None:
    """Ask the kernel to send this process `signal_number` when its parent dies, if
    $DEHYST_SUPERVISED is set: to the parent's process number, or 1 where that is not given.

    Raises SystemExit where the parent had already died.
    """
    parent = os.environ.get("DEHYST_SUPERVISED", "")
    if not parent.isdigit() or not system.LINUX:
        return
    _libc().prctl(_PR_SET_PDEATHSIG, ctypes.c_ulong(signal_number), 0, 0, 0)
    if int(parent) > 1 and os.getppid() != int(parent):
        raise SystemExit(128 + signal_number)
