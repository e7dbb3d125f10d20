"""Signals to the loop's process: its first act is to take them, its last to have served them.

SIGTERM and SIGINT: end, as safe.on_stop says; before the loop runs they end the process at once,
nothing has moved yet. SIGHUP: load the model file again, in one thread, one at a time: of many that
come meanwhile the last one counts, and the next is served a while later, so that a storm of them
takes no more of the machine than a few.
"""

import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from queue import Empty, SimpleQueue
from typing import Any

from dehyst.daemon import clock
from dehyst.daemon.loop.timing import realtime

REST_S = 1.0
NOT_MOVED = 0
AGAIN_S = 0.01
"""Until a lost exit is raised again: longer than a callback takes, shorter than anybody notices."""


class Requests:
    """Takes the signals from when it is made; `serve` says what is to be done about them."""

    def __init__(self, rest_s: float = REST_S) -> None:
        self._stop: Callable[[], None] | None = None
        self._ended = False  # before the loop ran
        self._reloads: SimpleQueue[None] = SimpleQueue()  # its put may be called in a handler
        self._rest_s = rest_s
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._on_stop)
        signal.signal(signal.SIGHUP, lambda *_: self._reloads.put(None))

    @contextmanager
    def before_the_loop(self) -> Iterator[None]:
        """Around all that the process does: asked to end while numba compiles, which makes errors
        of its own of the exit or loses it, it ends as at any other time before the loop runs."""
        before, sys.unraisablehook = sys.unraisablehook, self._report_unless_ended
        try:
            yield
        except Exception:
            if self._ended:
                raise SystemExit(NOT_MOVED) from None
            raise
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0.0)  # what it would raise has come
            sys.unraisablehook = before

    def serve(self, stop: Callable[[], None], reload: Callable[[], None]) -> None:
        """The loop runs: stop() is called in the handler, reload() in a thread of its own. Not
        where it was asked to end before, and what ran then has swallowed the exit."""
        self._stop = stop
        if self._ended:
            raise SystemExit(NOT_MOVED)
        thread = threading.Thread(target=self._run, args=(reload,), name="reload", daemon=True)
        thread.start()

    def _report_unless_ended(self, lost: "sys.UnraisableHookArgs") -> None:
        """An exit that a callback of LLVM cannot pass on is raised again a moment later: compiling
        goes on for a minute."""
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
            reload()
            clock.sleep_s(self._rest_s)
