"""Report the compilation of kernels, which takes a minute or two, once per installation. numba's
events say when it compiles which kernel."""

import re
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Self

from numba.core.event import Listener, install_listener

from dehyst.daemon import clock, log_lines
from dehyst.models.units import how_many

SILENT_S = 1.0
"""Compilations that finish within this time are not reported."""
TICK_S, AGAIN_S = 1.0, 15.0
"""Time between two looks, and between two lines if stderr is not a terminal."""
FIRST = "compiling kernels, once for this installation: this takes a minute or two"
ALSO = "compiling its own kernels, too"
"""Of a daemon's processes, the first prints FIRST, the others ALSO."""
CLEAR = "\r\x1b[K"
"""Return to the beginning of the line and erase it."""
PACKAGE = Path(__file__).resolve().parents[2]
ROOMS = ("models", "drivers", "daemon")
_KERNEL = re.compile(r"^\s*@njit\(cache=True", re.MULTILINE)


class Compilations(Listener):
    """Counts the compilations. count: finished so far; kernel: the one being compiled; began: event
    that is set when a compilation begins; on_kernel: called with a kernel's name as each begins."""

    def __init__(self, on_kernel: Callable[[str], None] = lambda kernel: None) -> None:
        self.count, self.kernel, self._on_kernel = 0, "", on_kernel
        self.began = threading.Event()
        self._depth, self._begun_ns, self._spent_ns = 0, 0, 0

    @property
    def seconds(self) -> float:
        """Time spent on compiling so far [s]."""
        now_ns = clock.monotonic_ns() if self._depth else self._begun_ns
        return (self._spent_ns + now_ns - self._begun_ns) / clock.NS

    @property
    def at_work(self) -> bool:
        """True while something is being compiled."""
        return self._depth > 0

    def on_start(self, event: Any) -> None:
        """Count a compilation that begins, perhaps within that of a kernel which calls this one."""
        if not self._depth:
            self._begun_ns = clock.monotonic_ns()
        self._depth += 1
        function = event.data["dispatcher"].py_func
        self.kernel = f"{function.__module__.removeprefix('dehyst.')}.{function.__name__}"
        self._on_kernel(self.kernel)
        self.began.set()

    def on_end(self, event: Any) -> None:
        """Count a finished compilation."""
        self._depth -= 1
        self.count += 1
        if not self._depth:
            now_ns = clock.monotonic_ns()
            self._spent_ns, self._begun_ns = self._spent_ns + now_ns - self._begun_ns, now_ns


class CompilingProgress:
    """Reports what is compiled and for how long. A thread looks every TICK_S, so that a single slow
    kernel is reported as well. On a terminal it rewrites one line; elsewhere it prints a line every
    AGAIN_S.

    While nothing is compiled the thread sleeps: a thread of ordinary priority that wakes in a
    process with deadlines may lose its CPU while it holds the interpreter lock, and the loop or an
    emulated unit would have to wait for it."""

    def __init__(self, said_by: str, compilations: Compilations, in_pipes: bool) -> None:
        self._by, self._of = said_by, compilations
        self._terminal = sys.stderr.isatty()
        self._silent = not (in_pipes or self._terminal)
        self._said_s = 0.0
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="compiling", daemon=True)

    def __enter__(self) -> Self:
        if not self._silent:
            self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._of.began.set()
        if self._thread.is_alive():
            self._thread.join(2 * TICK_S)

    def say_end(self) -> None:
        """Report the total, if anything was reported before."""
        self.look()  # covers compilations that ended within a tick
        if self._said_s:
            self._say(f"compiled {how_many(self._of.count, 'kernel')} in {self._of.seconds:.0f} s")

    def _run(self) -> None:
        while self._of.began.wait() and not self._stop.wait(TICK_S):
            if self._of.at_work:
                self.look()
            else:
                self._of.began.clear()
                if self._of.at_work:  # a compilation began in between
                    self._of.began.set()

    def look(self) -> None:
        """Report the progress, unless compiling has taken less than SILENT_S or it is too soon
        after the last line."""
        seconds = self._of.seconds
        if seconds <= SILENT_S or self._silent:
            return
        if not self._said_s:
            self._say(FIRST if log_lines.first_to_say() else ALSO)
            self._said_s = seconds
        elif self._terminal:
            words = f"{self._by}: compiling, {seconds:.0f} s: {self._of.count} done, "
            print(f"{CLEAR}{words}now {self._of.kernel}", end="\r", file=sys.stderr, flush=True)
        elif seconds - self._said_s >= AGAIN_S:
            self._say(
                f"still compiling after {seconds:.0f} s: "
                f"{how_many(self._of.count, 'kernel')} so far, now {self._of.kernel}"
            )
            self._said_s = seconds

    def _say(self, text: str) -> None:
        clear = CLEAR if self._terminal else ""
        if not self._silent:
            print(f"{clear}{self._by}: {text}", file=sys.stderr, flush=True)


@contextmanager
def compiling_reported(said_by: str, in_pipes: bool = False, ends: bool = True) -> Iterator[None]:
    """Report on stderr why, how far and for how long kernels are compiled within the block.
    in_pipes: report even if stderr is not a terminal; ends: the block ends with its work, so the
    total is reported at its end."""
    compilations = Compilations()
    teller = CompilingProgress(said_by, compilations, in_pipes)
    try:
        with install_listener("numba:compile", compilations), teller:
            yield
    finally:
        if ends:
            teller.say_end()


@contextmanager
def compiling_shown(said_by: str) -> Iterator[Compilations]:
    """Show a bar with the present kernel and the time on a terminal; print lines in a pipe."""
    # imported here: core and gateway import this file but draw no bars
    from rich.console import Console
    from rich.progress import BarColumn, Progress, ProgressColumn, Task
    from rich.text import Text

    compilations, begun_ns = Compilations(), clock.monotonic_ns()
    console = Console(stderr=True)
    if not console.is_terminal:
        with (
            install_listener("numba:compile", compilations),
            CompilingProgress(said_by, compilations, in_pipes=True),
        ):
            yield compilations
        return

    class Now(ProgressColumn):
        """Column drawn by the bar's own thread, several times a second, during compilation too."""

        def render(self, task: Task) -> Text:
            seconds = (clock.monotonic_ns() - begun_ns) / clock.NS
            bar.update(task.id, completed=compilations.count)
            return Text(
                f"{seconds:.0f} s  {compilations.count} of about {total}  {compilations.kernel}"
            )

    total = count_kernels()
    with Progress(BarColumn(), Now(), console=console, transient=True) as bar:
        bar.add_task("", total=total)
        with install_listener("numba:compile", compilations):
            yield compilations


def count_kernels() -> int:
    """Count the kernels declared in the package's files; about as many are compiled."""
    return sum(
        len(_KERNEL.findall(path.read_text(encoding="utf-8")))
        for room in ROOMS
        for path in (PACKAGE / room).rglob("*.py")
    )
