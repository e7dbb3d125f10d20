"""Kernels are compiled once for each installation, for a minute or two: nobody waits for that
without being told. numba itself says when it compiles what."""

import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from numba.core.event import Listener, install_listener

from dehyst.daemon import clock

SILENT_S = 1.0
"""Compiling that is over so soon is not worth a word."""
AGAIN_S = 15.0
PACKAGE = Path(__file__).resolve().parents[2]
ROOMS = ("models", "drivers", "daemon")
_KERNEL = re.compile(r"^\s*@njit\(cache=True", re.MULTILINE)


class Compilations(Listener):
    """What is compiled. count: so far; told: called with a kernel's name as each begins."""

    def __init__(self, told: Callable[[str], None]) -> None:
        self.count, self._told = 0, told
        self._depth, self._begun_ns, self._spent_ns = 0, 0, 0

    @property
    def seconds(self) -> float:
        """Spent on compiling so far."""
        now_ns = clock.monotonic_ns() if self._depth else self._begun_ns
        return (self._spent_ns + now_ns - self._begun_ns) / clock.NS

    def on_start(self, event: Any) -> None:
        """One begins, perhaps within another that calls it."""
        if not self._depth:
            self._begun_ns = clock.monotonic_ns()
        self._depth += 1
        function = event.data["dispatcher"].py_func
        self._told(f"{function.__module__.removeprefix('dehyst.')}.{function.__name__}")

    def on_end(self, event: Any) -> None:
        """One is done."""
        self._depth -= 1
        self.count += 1
        if not self._depth:
            now_ns = clock.monotonic_ns()
            self._spent_ns, self._begun_ns = self._spent_ns + now_ns - self._begun_ns, now_ns


@contextmanager
def compiling_told(said_by: str, in_pipes: bool = False, ends: bool = True) -> Iterator[None]:
    """Lines on stderr while kernels are compiled inside the block: what for, how far, and how long
    it took. in_pipes: also where no terminal reads them; ends: the block ends with its work, so
    that the sum at its end is still news."""
    said_s = 0.0

    def told(kernel: str) -> None:
        nonlocal said_s
        if compilations.seconds < SILENT_S or compilations.seconds - said_s < AGAIN_S * (
            said_s > 0
        ):
            return
        if not said_s:
            say("compiling kernels, once for this installation: a minute or two; then it is quick")
        else:
            say(f"still compiling: {compilations.count} kernels so far, now {kernel}")
        said_s = compilations.seconds

    def say(text: str) -> None:
        if in_pipes or sys.stderr.isatty():
            print(f"{said_by}: {text}", file=sys.stderr, flush=True)

    compilations = Compilations(told)
    try:
        with install_listener("numba:compile", compilations):
            yield
    finally:
        if said_s and ends:
            say(f"compiled {compilations.count} kernels in {compilations.seconds:.0f} s")


@contextmanager
def compiling_shown() -> Iterator[Compilations]:
    """A bar on a terminal with the kernel that is compiled and the time that is left."""
    # core and gateway import this file, and draw no bars
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    if not console.is_terminal:
        compilations = Compilations(lambda kernel: None)
        with install_listener("numba:compile", compilations):
            yield compilations
        return
    columns = (BarColumn(), TimeRemainingColumn(), TextColumn("{task.description}"))
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("", total=count_kernels())
        compilations = Compilations(
            lambda kernel: bar.update(task, completed=compilations.count, description=kernel)
        )
        with install_listener("numba:compile", compilations):
            yield compilations


def count_kernels() -> int:
    """How many kernels the product's files declare: about as many compilations."""
    return sum(
        len(_KERNEL.findall(path.read_text(encoding="utf-8")))
        for room in ROOMS
        for path in (PACKAGE / room).rglob("*.py")
    )
