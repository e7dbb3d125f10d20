"""End a process: immediately on an interrupt during its start, and finally after all is closed."""

import atexit
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType

from dehyst.daemon import log_lines

INTERRUPTED = 130


@contextmanager
def ended_at_once(said_by: str) -> Iterator[None]:
    """End the process on an interrupt within the block, with one line and exit status 130.

    This is for the imports: a KeyboardInterrupt raised within one may be lost there, and the
    program would continue as if there had been no interrupt.
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
    """Note an interrupt within the block; the yielded function raises it as a KeyboardInterrupt.
    Raised immediately, it might be lost in a callback from compiled code. A second interrupt is
    raised at once, and one that was not raised by then is raised at the end. Outside the main
    thread, or if the program handles interrupts itself, nothing changes."""
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
    """Ends the process with the exit status `code`, without finalizing the interpreter. Create it
    first in a process, so that it acts last. code: 1 unless set, for an end by an exception.

    Non-daemon threads have ended by then, and the other exit handlers have run. Finalizing the
    interpreter would cost a process with kernels 0.3 s of CPU time. With a thread still in the bus
    it would end with SIGABRT: CPython ends such a thread as it returns, which zenoh's Rust code
    takes for a foreign exception.
    """

    def __init__(self) -> None:
        self.code = 1
        atexit.register(self._end)

    def _end(self) -> None:
        log_lines.last_words()
        try:
            sys.stdout.flush()
            sys.stderr.flush()
        except BrokenPipeError:  # the reader is gone
            pass
        except OSError as error:
            with suppress(OSError):
                os.write(2, f"dehyst: stdout: {error.strerror}\n".encode())
            self.code = self.code or 1
        os._exit(self.code)
