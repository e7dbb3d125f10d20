"""Handle the signals to the loop's process, from its first action to its last.

SIGTERM and SIGINT end the process as safe.on_stop says; before the loop runs they end it at once,
because nothing has moved yet. SIGHUP reloads the model file, in one thread and one at a time.
Signals that arrive during a reload are merged into one, which is served after a pause of REST_S,
so that a flood of signals costs no more than a few.
"""

import logging
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from queue import Empty, SimpleQueue
from typing import Any

from dehyst.daemon import clock
from dehyst.daemon.loop.timing import realtime

log = logging.getLogger(__name__)
REST_S = 1.0
NOT_MOVED = 0
AGAIN_S = 0.01
"""Delay before a lost exit is raised again: longer than a callback, too short to be noticed."""


class Requests:
    """Handles the signals from its construction on; `serve` sets what they do."""

    def __init__(self, rest_s: float = REST_S) -> None:
        self._stop: Callable[[], None] | None = None
        self._ended = False  # before the loop ran
        self._reloads: SimpleQueue[None] = SimpleQueue()  # put is safe in a signal handler
        self._rest_s = rest_s
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._on_stop)
        signal.signal(signal.SIGHUP, lambda *_: self._reloads.put(None))

    @contextmanager
    def before_the_loop(self) -> Iterator[None]:
        """Wrap everything that the process does. If it is asked to end while numba compiles, numba
        may lose the exit or turn it into another error; the process then still ends as at any
        other time before the loop runs."""
        before, sys.unraisablehook = sys.unraisablehook, self._report_unless_ended
        try:
            yield
        except Exception:
            if self._ended:
                raise SystemExit(NOT_MOVED) from None
            raise
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0.0)  # the exit has been raised by now
            sys.unraisablehook = before

    def serve(self, stop: Callable[[], None], reload: Callable[[], None]) -> None:
        """Serve the signals while the loop runs: stop() is called in the handler, reload() in its
        own thread. Raises SystemExit if the process was asked to end before and the exit was
        swallowed."""
        self._stop = stop
        if self._ended:
            raise SystemExit(NOT_MOVED)
        thread = threading.Thread(target=self._run, args=(reload,), name="reload", daemon=True)
        thread.start()

    def _report_unless_ended(self, lost: "sys.UnraisableHookArgs") -> None:
        """Raise an exit again a moment later if an LLVM callback could not propagate it; otherwise
        compilation would continue for a minute."""
        if self._ended and isinstance(lost.exc_value, SystemExit):
            signal.signal(signal.SIGALRM, self._on_stop)
            signal.setitimer(signal.ITIMER_REAL, AGAIN_S)
        else:
            sys.__unraisablehook__(lost)

    def _on_stop(self, *_: Any) -> None:
        if self._stop is None:
            self._ended = True
            raise SystemExit(NOT_MOVED)
        self._stop()

    def _run(self, reload: Callable[[], None]) -> None:
        realtime.leave_realtime()
        while True:
            self._reloads.get()
            while True:
                try:
                    self._reloads.get_nowait()
                except Empty:
                    break
            try:
                reload()
            except Exception:  # the next request is served all the same
                log.exception("a reload of the model has failed")
            clock.sleep_s(self._rest_s)
