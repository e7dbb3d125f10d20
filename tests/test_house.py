"""Rules for the tests: the parts are distinguished correctly, and no test needs a benchmark."""

import ast
import multiprocessing
import os
import pty
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest
import zenoh
from tests.long import LONG
from tests.rigs.starts import Started, guard, starting

TESTS = Path(__file__).resolve().parent


@pytest.mark.parametrize(
    "start",
    [
        lambda: subprocess.run([sys.executable, "-c", ""], check=True),
        lambda: os.posix_spawn(sys.executable, [sys.executable, "-c", ""], {}),
        lambda: os._exit(0) if os.fork() == 0 else None,
        lambda: os.system("true"),
        lambda: multiprocessing.get_context("spawn").Process(target=print).start(),
        lambda: pty.openpty(),
        lambda: os.openpty(),
        lambda: zenoh.open(zenoh.Config()),
    ],
    ids=["subprocess", "spawn", "fork", "system", "multiprocessing", "pty", "openpty", "zenoh"],
)
@pytest.mark.parametrize("swallowed", [False, True])
def test_a_quick_test_that_starts_something_fails(
    start: Callable[[], object], swallowed: bool
) -> None:
    with pytest.raises(Started, match="not marked"), guard(), suppress(*[Exception] * swallowed):
        start()


MODULE = """
import subprocess
from dehyst.daemon.bus.session import Bus, BusError

@fixture
def rig(): return subprocess.Popen(["x"])
class Lab:
    def start(self): self.bus = Bus.connect([])
def helper(): return Lab()
def test_by_fixture(rig): ...
def test_by_helper(): helper()
def test_by_fixture_above(bench): ...
def test_quick(tmp_path): assert BusError
"""


def test_a_test_that_starts_a_process_is_reported_by_what_it_names(tmp_path: Path) -> None:
    path = tmp_path / "test_x.py"
    path.write_text(MODULE)
    found = starting(path, frozenset({"bench"}))
    assert {name for name in found if name.startswith("test_")} == {
        "test_by_fixture", "test_by_helper", "test_by_fixture_above",
    }  # fmt: skip


def test_nothing_under_tests_imports_a_benchmark() -> None:
    for path in TESTS.rglob("*.py"):
        if path.relative_to(TESTS).parts[0] != "benchmarks":
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                names = [getattr(node, "module", None) or ""]
                names += [a.name for a in getattr(node, "names", []) if isinstance(a, ast.alias)]
                assert not any("benchmarks" in name for name in names), (path, names)


@pytest.mark.parametrize("path", sorted({path for kind in LONG.values() for path in kind}))
def test_what_is_left_to_make_long_is_there(path: str) -> None:
    """A name that no test has would leave a test where its author believes it is not."""
    tree = ast.parse((TESTS / path).read_text(encoding="utf-8"))
    tests = [n.name for n in ast.walk(tree) if isinstance(n, ast.FunctionDef | ast.ClassDef)]
    for begin in (name for kind in LONG.values() for name in kind.get(path, ())):
        name, params, _ = begin.partition("[")
        assert any(test == name if params else test.startswith(name) for test in tests), begin
