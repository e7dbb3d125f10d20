"""Read single keys from the terminal on which a command runs."""

import os
import select
import sys
from collections.abc import Iterator
from contextlib import contextmanager

try:
    import termios
    import tty
except ImportError:  # Windows
    termios = None  # type: ignore[assignment]


@contextmanager
def single_keys() -> Iterator[None]:
    """Deliver keys without Enter and without echo; Ctrl-C still interrupts. Change nothing if stdin
    is not a terminal. The Windows console delivers single keys anyway."""
    if termios is None:
        yield
        return
    try:
        fd = sys.stdin.fileno()
        before = termios.tcgetattr(fd)
    except (OSError, ValueError, termios.error):
        yield
        return
    tty.setcbreak(fd)
    try:
        yield
    finally:
        termios.tcsetattr(fd, termios.TCSADRAIN, before)


def pressed() -> str:
    """Return the keys pressed since the last call; "" if stdin is not a terminal."""
    if termios is None:
        import msvcrt

        return "".join(iter(lambda: msvcrt.getwch() if msvcrt.kbhit() else "", ""))
    try:
        fd = sys.stdin.fileno()
        if not os.isatty(fd) or not select.select([fd], [], [], 0.0)[0]:
            return ""
        return os.read(fd, 64).decode("utf-8", "replace")
    except (OSError, ValueError):
        return ""
