"""The two ends of a process: at once while nothing has begun, and for good when all is closed."""

import atexit
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager

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
