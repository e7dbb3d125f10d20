"""Kernels are compiled once for each installation, for a minute or two: nobody waits for that
without a word. numba itself says when it compiles what."""

import re
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Self

from numba.core.event import Listener, install_listener

from dehyst.daemon import clock, log_lines

SILENT_S = 1.0
"""Compiling that is over so soon is not worth a word."""
TICK_S, AGAIN_S = 1.0, 15.0
"""Between two looks, and between two lines where no terminal reads them."""
FIRST = "compiling kernels, once for this installation: this takes a minute or two"
ALSO = "compiling its own kernels, too"
"""Of a daemon's processes one says what it is about, the others that they do the same."""
CLEAR = "\r\x1b[K"
"""To the beginning of the line, and nothing on it."""
PACKAGE = Path(__file__).resolve().parents[2]
ROOMS = ("models", "drivers", "daemon")
_KERNEL = re.compile(r"^\s*@njit\(cache=True", re.MULTILINE)


class Compilations(Listener):
    """What is compiled. count: so far; kernel: the one that is compiled now; began: set when one
    begins, for whoever waits for that; on_kernel: called with a kernel's name as each begins."""

    def __init__(self, on_kernel: Callable[[str], None] = lambda kernel: None) -> None:
        self.count, self.kernel, self._on_kernel = 0, "", on_kernel
        self.began = threading.Event()
        self._depth, self._begun_ns, self._spent_ns = 0, 0, 0

    @property
    def seconds(self) -> float:
        """Spent on compiling so far."""
        now_ns = clock.monotonic_ns() if self._depth else self._begun_ns
        return (self._spent_ns + now_ns - self._begun_ns) / clock.NS

    @property
    def at_work(self) -> bool:
        """Whether something is compiled at this moment."""
        return self._depth > 0

    def on_start(self, event: Any) -> None:
        """One begins, perhaps within another that calls it."""
        if not self._depth:
            self._begun_ns = clock.monotonic_ns()
        self._depth += 1
        function = event.data["dispatcher"].py_func
        self.kernel = f"{function.__module__.removeprefix('dehyst.')}.{function.__name__}"
        self._on_kernel(self.kernel)
        self.began.set()

    def on_end(self, event: Any) -> None:
        """One is done."""
        self._depth -= 1
        self.count += 1
        if not self._depth:
            now_ns = clock.monotonic_ns()
            self._spent_ns, self._begun_ns = self._spent_ns + now_ns - self._begun_ns, now_ns


class CompilingProgress:
    """Says what is compiled and for how long, also while one kernel takes its time: a thread looks
    every TICK_S. On a terminal one line that is written anew, elsewhere a line every AGAIN_S.

    While nothing is compiled the thread sleeps: a thread of ordinary priority that wakes within a
    process with deadlines may lose its processor while it holds the interpreter, and the loop, or
    an emulated unit, would have to wait for it."""

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
        """The sum, where something was said before."""
        self.look()  # what was over within a tick
        if self._said_s:
            self._say(f"compiled {self._of.count} kernels in {self._of.seconds:.0f} s")

    def _run(self) -> None:
        while self._of.began.wait() and not self._stop.wait(TICK_S):
            if self._of.at_work:
                self.look()
            else:
                self._of.began.clear()
                if self._of.at_work:  # one that began in between
                    self._of.began.set()

    def look(self) -> None:
        """Say where it stands, where it is worth a word and not too soon after the last one."""
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
                f"still compiling after {seconds:.0f} s: {self._of.count} kernels so far, now "
                f"{self._of.kernel}"
            )
            self._said_s = seconds

    def _say(self, text: str) -> None:
        clear = CLEAR if self._terminal else ""
        if not self._silent:
            print(f"{clear}{self._by}: {text}", file=sys.stderr, flush=True)


@contextmanager
def compiling_reported(said_by: str, in_pipes: bool = False, ends: bool = True) -> Iterator[None]:
    """Lines on stderr while kernels are compiled inside the block: what for, how far, and how long
    it took. in_pipes: also where no terminal reads them; ends: the block ends with its work, so
    that the sum at its end is still news."""
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
    """A bar on a terminal with the kernel that is compiled and the time; lines in a pipe."""
    # core and gateway import this file, and draw no bars
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
        """Drawn by the bar's own thread, several times a second, whatever is compiled."""

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
    """How many kernels the product's files declare: about as many compilations."""
    return sum(
        len(_KERNEL.findall(path.read_text(encoding="utf-8")))
        for room in ROOMS
        for path in (PACKAGE / room).rglob("*.py")
    )
