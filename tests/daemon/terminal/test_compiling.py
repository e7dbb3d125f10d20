"""Compilation is reported: its purpose, its progress and its duration. numba really compiles
here."""

import io
import math
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest
from numba import njit

from dehyst.daemon import log_lines
from dehyst.daemon.terminal import compiling


@pytest.fixture(autouse=True)
def _nothing_said_before(monkeypatch: pytest.MonkeyPatch) -> None:
    """As in a new process."""
    monkeypatch.setattr(log_lines, "_counts", -1)


def fresh_kernel() -> Callable[[float], float]:
    """Return a kernel that calls another one; neither is cached on disk."""

    @njit
    def inner(x: float) -> float:
        return math.sqrt(x)

    @njit
    def outer(x: float) -> float:
        return float(inner(x) + 1.0)

    return outer  # type: ignore[no-any-return]


def test_it_says_once_that_it_compiles_and_how_long_it_took(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(compiling, "SILENT_S", 0.0)
    with compiling.compiling_reported("dehyst core", in_pipes=True):
        assert fresh_kernel()(4.0) == 3.0
        assert fresh_kernel()(9.0) == 4.0
    first, last = capsys.readouterr().err.splitlines()
    assert first.startswith("dehyst core: compiling kernels, once")
    assert last.startswith("dehyst core: compiled 4 kernels in")
    with compiling.compiling_reported("dehyst core", in_pipes=True, ends=False):
        fresh_kernel()(4.0)
    assert "compiled" not in capsys.readouterr().err


TALKS = """
import sys, time
from dehyst.daemon import log_lines
from dehyst.daemon.terminal import compiling

log_lines.keep_going("core")
compiling.SILENT_S = 0.0
compilations = compiling.Compilations()
with compiling.CompilingProgress(sys.argv[1], compilations, in_pipes=True) as progress:
    time.sleep(0.001)
    compilations._spent_ns = 10**9
    progress.look()
log_lines.last_words()
"""


def test_of_the_processes_of_a_start_one_says_what_it_is_about_the_others_that_they_do_it_too() -> (
    None
):
    children = [
        subprocess.Popen(
            [sys.executable, "-c", TALKS, who],
            stderr=subprocess.PIPE,
            text=True,
            **log_lines.for_child(),
        )
        for who in ("dehyst core", "dehyst gateway", "dehyst emulate")
    ]
    said = sorted(child.communicate(timeout=60)[1].strip() for child in children)
    texts = [line.partition(": ")[2] for line in said]
    assert sorted(texts) == sorted([compiling.FIRST, compiling.ALSO, compiling.ALSO])
    assert len({line.partition(":")[0] for line in said}) == 3
    assert log_lines.dropped() == 0


def test_what_is_soon_done_or_there_already_is_not_worth_a_word(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    kernel = fresh_kernel()
    kernel(1.0)
    monkeypatch.setattr(compiling, "SILENT_S", 0.0)
    with compiling.compiling_reported("dehyst core", in_pipes=True):
        kernel(4.0)
    monkeypatch.setattr(compiling, "SILENT_S", 1e3)
    with compiling.compiling_reported("dehyst core", in_pipes=True):
        fresh_kernel()(4.0)
    monkeypatch.setattr(compiling, "SILENT_S", 0.0)
    with compiling.compiling_reported("dehyst identify"):  # stderr is not a terminal
        fresh_kernel()(4.0)
    assert capsys.readouterr().err == ""


def test_a_kernel_within_a_kernel_is_counted_and_its_time_once() -> None:
    names: list[str] = []
    from numba.core.event import install_listener

    compilations = compiling.Compilations(names.append)
    with install_listener("numba:compile", compilations):
        fresh_kernel()(4.0)
    assert [name.rpartition(".")[2] for name in names] == ["outer", "inner"]
    assert compilations.count == 2
    spent = compilations.seconds
    assert 0.0 < spent < 60.0
    assert compilations.seconds == spent


def test_all_kernels_of_the_product_are_counted() -> None:
    assert compiling.count_kernels() > 150


class Slow:
    """Stands in for a kernel that numba compiles for a long time."""

    def __init__(self, name: str) -> None:
        self.data = {"dispatcher": SimpleNamespace(py_func=SimpleNamespace(
            __module__="dehyst.models.x", __name__=name))}  # fmt: skip


def wait_for(happened: Callable[[], bool]) -> None:
    end = time.monotonic() + 20.0
    while not happened() and time.monotonic() < end:
        time.sleep(0.01)
    assert happened()


def test_while_one_kernel_takes_long_a_pipe_still_gets_a_line_with_its_name_now_and_then(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, value in (("SILENT_S", 0.0), ("TICK_S", 0.01), ("AGAIN_S", 0.03)):
        monkeypatch.setattr(compiling, name, value)
    compilations, said = compiling.Compilations(), ""
    with compiling.CompilingProgress("dehyst warm", compilations, in_pipes=True):
        compilations.on_start(Slow("windowed"))

        def has_said() -> bool:
            nonlocal said
            said += capsys.readouterr().err
            return said.count("\n") >= 4

        wait_for(has_said)
    lines = said.splitlines()
    assert lines[0].startswith("dehyst warm: compiling kernels, once")
    for line in lines[1:4]:
        assert line.startswith("dehyst warm: still compiling after")
        assert line.endswith("now models.x.windowed")


def test_on_a_terminal_one_line_is_written_anew_all_the_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    screen = Terminal()
    monkeypatch.setattr("sys.stderr", screen)
    monkeypatch.setattr(compiling, "SILENT_S", 0.0)
    monkeypatch.setattr(compiling, "TICK_S", 0.01)
    compilations = compiling.Compilations()
    with compiling.CompilingProgress("dehyst run", compilations, in_pipes=False):
        compilations.on_start(Slow("windowed"))
        wait_for(lambda: screen.getvalue().count("now models.x.windowed\r") >= 3)
    assert screen.getvalue().count("\n") == 1


def wakes(thread: threading.Thread) -> int:
    """Return how often the operating system has resumed this thread after a wait."""
    status = Path(f"/proc/self/task/{thread.native_id}/status").read_text()
    return int(status.split("\nvoluntary_ctxt_switches:")[1].split()[0])


def test_while_nothing_is_compiled_its_thread_sleeps(monkeypatch: pytest.MonkeyPatch) -> None:
    """The reporting thread sleeps while nothing is compiled, because it shares its interpreter with
    a process that has deadlines."""
    monkeypatch.setattr(compiling, "TICK_S", 0.01)
    with compiling.compiling_reported("dehyst core", in_pipes=True):
        fresh_kernel()(4.0)
        (thread,) = [one for one in threading.enumerate() if one.name == "compiling"]
        time.sleep(0.2)
        before = wakes(thread)
        time.sleep(0.5)
        assert wakes(thread) - before <= 1
