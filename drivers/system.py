"""Features that an operating system may lack, in one place.

Everything except the loop also runs on Windows and macOS. Names that only POSIX or Linux has are
used here, and in the modules that only Linux runs: the loop, its rings, its supervisor, the
emulated units. tests/packaging/test_systems.py compares every module with the names that Windows
has.
"""

import os
import select
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
"""Open files that a process asks for at most, also where the system sets no limit."""
STDOUT, STDERR = 1, 2
LINUX = sys.platform == "linux"
MODES = hasattr(os, "geteuid")
"""Whether files have owners and modes: Windows reports user 0 and 0o666 for every file."""
NO_FOLLOW: int = getattr(os, "O_NOFOLLOW", 0)
CLOSE_ON_EXEC: int = getattr(os, "O_CLOEXEC", 0)
BINARY: int = getattr(os, "O_BINARY", 0)
"""A flag of os.open, 0 on systems without it. Without O_BINARY, Windows would translate line ends
in a descriptor."""


def user_id() -> int:
    """Return the id of the user for whom this process acts; 0 on Windows, like st_uid there."""
    return os.geteuid() if MODES else 0


def others_may(found: os.stat_result, bits: int = stat.S_IWGRP | stat.S_IWOTH) -> bool:
    """Return whether a mode grants others any of these bits (to write, by default); False if files
    have no modes."""
    return MODES and bool(found.st_mode & bits)


def sync_folder(folder: Path) -> None:
    """Sync a folder so that a name created in it survives a power cut, on systems that allow it."""
    if not hasattr(os, "O_DIRECTORY"):
        return  # Windows cannot open a folder
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | CLOSE_ON_EXEC)
    try:
        os.fsync(handle)
    except OSError:
        pass  # some network file systems do not support it
    finally:
        os.close(handle)


def allow_open_files() -> None:
    """Raise the limit of open files, connections included, to what the system allows, at most
    MOST_FILES, instead of the 1024 of an ordinary login; Windows has no such limit."""
    if resource is None:
        return
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = MOST_FILES if hard == resource.RLIM_INFINITY else min(hard, MOST_FILES)
    if soft < wanted:
        with suppress(ValueError, OSError):  # macOS has a lower limit of its own
            resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))


def bound_memory(most_bytes: int, core_dump: bool = True) -> None:
    """Limit this process's address space, and forbid a core dump unless allowed, on systems with
    such limits."""
    if resource is None:
        return
    with suppress(ValueError, OSError):  # macOS refuses some limits
        resource.setrlimit(resource.RLIMIT_AS, (most_bytes, most_bytes))
    if not core_dump:
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def bound_processor_time(most_s: int) -> None:
    """End this process by SIGXCPU after this much processor time [s], on systems that can."""
    if resource is None:
        return
    with suppress(ValueError, OSError):
        resource.setrlimit(resource.RLIMIT_CPU, (most_s, most_s + 1))


def lowest_priority() -> None:
    """Run this process only when no other wants the processor, as far as the system can."""
    with suppress(OSError, AttributeError):
        os.nice(19)
        os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))


def end_unread(connection: socket.socket, after_ms: int) -> None:
    """Have the kernel close a connection whose peer has accepted no data for `after_ms`, on systems
    that can (TCP_USER_TIMEOUT, tcp(7)); connections inherit it from a listening socket."""
    if hasattr(socket, "TCP_USER_TIMEOUT"):
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, after_ms)


def drop_what_nobody_reads() -> None:
    """Redirect stdout and stderr to the null device where the terminal or pipe has gone. Does
    nothing on a system that cannot detect this."""
    if not hasattr(select, "poll"):
        return
    poll = select.poll()
    for file in (STDOUT, STDERR):
        poll.register(file, 0)  # errors and hang-ups only
    gone = [file for file, _ in poll.poll(0)]
    if gone:
        null = os.open(os.devnull, os.O_WRONLY)
        for file in gone:
            os.dup2(null, file)
        if null not in gone:
            os.close(null)


def in_forked_child(call: Callable[[], None]) -> None:
    """Call this in every child forked from now on; Windows has no fork."""
    if hasattr(os, "register_at_fork"):
        os.register_at_fork(after_in_child=call)


@contextmanager
def anonymous_file(name: str, content: bytes) -> Iterator[str]:
    """Yield the path of a file with this content for the duration of the block: in memory on Linux,
    otherwise a temporary file. Raises OSError."""
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
    """Return the signal that no process can ignore; SIGTERM on Windows."""
    return getattr(signal, "SIGKILL", signal.SIGTERM)
