"""Ctrl-C while nothing has begun that must be ended in order."""

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager

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
