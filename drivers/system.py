"""What an operating system may lack, in one place.

Everything but the loop also runs on Windows and macOS. Names of POSIX and of Linux stand here, and
in the modules that only Linux runs: the loop, its rings, its supervisor, the emulated units.
tests/packaging/test_systems.py compares every module with the names that Windows has.
"""

import os
import signal
import socket
import stat
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

try:
    import resource
except ImportError:  # Windows
    resource = None  # type: ignore[assignment]
try:
    from termios import error as TerminalError
except ImportError:  # Windows
    TerminalError = OSError  # type: ignore[misc,assignment]

MOST_FILES = 65_536
LINUX = sys.platform == "linux"
MODES = hasattr(os, "geteuid")
"""Whether files have owners and modes: Windows reports user 0 and 0o666 of every file."""
NO_FOLLOW: int = getattr(os, "O_NOFOLLOW", 0)
CLOSE_ON_EXEC: int = getattr(os, "O_CLOEXEC", 0)
BINARY: int = getattr(os, "O_BINARY", 0)
"""Flags of os.open; 0 where there is no such thing. Windows would translate line ends in a
descriptor without O_BINARY."""


def user_id() -> int:
    """The number of the user for whom this process acts; 0 on Windows, as st_uid is there."""
    return os.geteuid() if MODES else 0


def others_may(found: os.stat_result, bits: int = stat.S_IWGRP | stat.S_IWOTH) -> bool:
    """Whether a mode grants others any of these bits (to write, unless given); False where files
    have no modes."""
    return MODES and bool(found.st_mode & bits)


def sync_folder(folder: Path) -> None:
    """A name that was given in this folder survives a power cut too, where that can be had."""
    if not hasattr(os, "O_DIRECTORY"):
        return  # Windows opens no folder
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | CLOSE_ON_EXEC)
    try:
        os.fsync(handle)
    except OSError:
        pass  # some network file systems cannot
    finally:
        os.close(handle)


def allow_open_files() -> None:
    """As many connections as the system lets us have, not the 1024 of an ordinary login; Windows
    has no such limit."""
    if resource is None:
        return
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = MOST_FILES if hard == resource.RLIM_INFINITY else min(hard, MOST_FILES)
    if soft < wanted:
        with suppress(ValueError, OSError):  # macOS has a lower bound of its own
            resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))


def bound_memory(most_bytes: int, core_dump: bool = True) -> None:
    """This process gets at most so much address space, and no core dump unless allowed, where the
    system bounds them."""
    if resource is None:
        return
    with suppress(ValueError, OSError):  # macOS refuses some bounds
        resource.setrlimit(resource.RLIMIT_AS, (most_bytes, most_bytes))
    if not core_dump:
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def bound_processor_time(most_s: int) -> None:
    """This process ends by SIGXCPU after so much processor time [s], where the system bounds it."""
    if resource is None:
        return
    with suppress(ValueError, OSError):
        resource.setrlimit(resource.RLIMIT_CPU, (most_s, most_s + 1))


def lowest_priority() -> None:
    """This process runs only where no other one wants to, as far as the system knows of that."""
    with suppress(OSError, AttributeError):
        os.nice(19)
        os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))


def end_unread(connection: socket.socket, after_ms: int) -> None:
    """Have the kernel end a connection whose other side has taken nothing for so long, where it
    can (TCP_USER_TIMEOUT, tcp(7)); connections inherit it from a socket that listens."""
    if hasattr(socket, "TCP_USER_TIMEOUT"):
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, after_ms)


def in_forked_child(call: Callable[[], None]) -> None:
    """Call this in every child that is forked from now on; Windows forks none."""
    if hasattr(os, "register_at_fork"):
        os.register_at_fork(after_in_child=call)


@contextmanager
def anonymous_file(name: str, content: bytes) -> Iterator[str]:
    """The path of a file with this content while the block lasts: in memory on Linux, else a
    temporary one. Raises OSError."""
    if hasattr(os, "memfd_create"):
        held = os.memfd_create(name)
        with os.fdopen(held, "wb", closefd=False) as copy:
            copy.write(content)
        path = f"/proc/self/fd/{held}"
    else:
        held, path = tempfile.mkstemp(prefix=name)
        with os.fdopen(held, "wb", closefd=False) as copy:
            copy.write(content)
    try:
        yield path
    finally:
        os.close(held)
        if not path.startswith("/proc"):
            os.unlink(path)


def kill_signal() -> int:
    """The signal that no process can refuse; Windows has SIGTERM for it."""
    return getattr(signal, "SIGKILL", signal.SIGTERM)
