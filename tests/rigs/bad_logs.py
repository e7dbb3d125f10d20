"""Log destinations that accept nothing: descriptors for a process' stdout and stderr."""

import fcntl
import os
import subprocess
import termios
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

Spoil = Callable[[], None]
"""Called while the daemon runs: after that nothing can be written."""


def _filled(file: int) -> None:
    os.set_blocking(file, False)
    try:
        while True:
            os.write(file, b"#" * 512)
    except BlockingIOError:
        os.set_blocking(file, True)


@contextmanager
def full_pipe(folder: Path) -> Iterator[tuple[int, Spoil]]:
    """A pipe that nobody reads."""
    read, write = os.pipe()
    fcntl.fcntl(write, fcntl.F_SETPIPE_SZ, 4096)
    try:
        yield write, lambda: _filled(write)
    finally:
        os.close(read)
        os.close(write)


@contextmanager
def closed_pipe(folder: Path) -> Iterator[tuple[int, Spoil]]:
    """A pipe whose reader closes it."""
    read, write = os.pipe()
    try:
        yield write, lambda: os.close(read)
    finally:
        os.close(write)


@contextmanager
def slow_pipe(folder: Path) -> Iterator[tuple[int, Spoil]]:
    """A pipe whose reader takes a few bytes per second."""
    read, write = os.pipe()
    fcntl.fcntl(write, fcntl.F_SETPIPE_SZ, 4096)
    slow = "import os, time\nwhile os.read(0, 16): time.sleep(0.5)"
    reader = subprocess.Popen(["python3", "-c", slow], stdin=read)
    try:
        yield write, lambda: _filled(write)
    finally:
        reader.kill()
        reader.wait()
        os.close(read)
        os.close(write)


@contextmanager
def stopped_terminal(folder: Path) -> Iterator[tuple[int, Spoil]]:
    """A terminal at which somebody has pressed Ctrl-S."""
    master, slave = os.openpty()
    try:
        yield slave, lambda: termios.tcflow(slave, termios.TCOOFF)
    finally:
        os.close(master)
        os.close(slave)


@contextmanager
def lost_terminal(folder: Path) -> Iterator[tuple[int, Spoil]]:
    """A terminal that has disappeared."""
    master, slave = os.openpty()
    try:
        yield slave, lambda: os.close(master)
    finally:
        os.close(slave)


@contextmanager
def no_room(folder: Path) -> Iterator[tuple[int, Spoil]]:
    """A device that is full."""
    file = os.open("/dev/full", os.O_WRONLY)
    try:
        yield file, lambda: None
    finally:
        os.close(file)


@contextmanager
def full_disk(folder: Path) -> Iterator[tuple[int, Spoil]]:
    """A file on a small disk that is full. Raises PermissionError if none can be mounted."""
    disk = folder / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=64k", "none", str(disk)]
    if subprocess.run(mount, check=False, capture_output=True).returncode:
        raise PermissionError("a small disk cannot be mounted here")
    file = os.open(disk / "log", os.O_WRONLY | os.O_CREAT | os.O_APPEND)

    def spoil() -> None:
        with open(disk / "rest", "wb", buffering=0) as rest:
            try:
                while True:
                    rest.write(b"#" * 512)
            except OSError:
                return

    try:
        yield file, spoil
    finally:
        os.close(file)
        subprocess.run(["umount", "-l", str(disk)], check=False)


BAD_LOGS = {
    "a pipe that nobody empties": full_pipe,
    "a pipe without a reader": closed_pipe,
    "a slow reader": slow_pipe,
    "a stopped terminal": stopped_terminal,
    "a terminal that has gone": lost_terminal,
    "/dev/full": no_room,
    "a full disk": full_disk,
}
