"""The two ends of a process: at once while nothing has begun, and for good when all is closed."""

import atexit
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from dehyst.daemon import log_lines

INTERRUPTED = 130


@contextmanager
def ended_at_once(said_by: str) -> Iterator[None]:
    """An interrupt ends the process with one line and exit status 130, wherever it comes.

    For the imports: a KeyboardInterrupt that is raised within one may be lost there, and the
    program would go on as if nobody had asked.
    """

    def end(number: int, frame: object) -> None:
        os.write(2, f"{said_by}: interrupted\n".encode())
        os._exit(INTERRUPTED)

    before = signal.signal(signal.SIGINT, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def noted_interrupts() -> Iterator[Callable[[], None]]:
    """Within, an interrupt is noted, and the yielded function raises it as a KeyboardInterrupt:
    raised wherever the program happens to be, it may be lost in a callback from compiled code. A
    second one is raised at once, and one that nobody took is raised at the end. Outside of the main
    thread, and where the program handles interrupts itself, nothing changes."""
    noted, taken = 0, False

    def note(number: int, frame: FrameType | None) -> None:
        nonlocal noted
        noted += 1
        if noted > 1:
            signal.default_int_handler(number, frame)

    def raise_noted() -> None:
        nonlocal taken
        if noted:
            taken = True
            raise KeyboardInterrupt

    main = threading.current_thread() is threading.main_thread()
    if not main or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield raise_noted
        return
    signal.signal(signal.SIGINT, note)
    try:
        yield raise_noted
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if noted and not taken:
        raise KeyboardInterrupt


class LightEnd:
    """Made first in a process, it ends it last, with the exit status `code`; 1: by an exception.

    Threads that are no daemons have been waited for then, and what is to be done at exit is done.
    The interpreter is not taken down: that costs a process with kernels 0.3 s of a processor, and
    with a thread still within the bus it ends with SIGABRT: CPython ends such a thread as it comes
    back, which zenoh's Rust takes for a foreign exception.
    """

    def __init__(self) -> None:
        self.code = 1
        atexit.register(self._end)

    def _end(self) -> None:
        log_lines.last_words()
        try:
            sys.stdout.flush()
            sys.stderr.flush()
        except BrokenPipeError:  # the reader has gone
            pass
        except OSError as error:
            os.write(2, f"dehyst: stdout: {error.strerror}\n".encode())
            self.code = self.code or 1
        os._exit(self.code)
