"""Find which tests start a process, a zenoh session or a pseudo terminal, and guard the others.

A test belongs to the part `processes` when it, a fixture that it takes or a helper of its module
that it calls names one of `TOOLS`. `guard` makes every other test that starts something fail.
"""

import ast
import multiprocessing.process
import os
import pty
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import zenoh

TOOLS = (
    "subprocess", "multiprocessing", "zenoh.open", "pty", "tests.rigs.processes",
    "tests.rigs.gateway_bench", "tests.rigs.axes_bench", "tests.rigs.controllers",
    "tests.rigs.chaos", "tests.rigs.exchange", "tests.rigs.service",
    "tests.benchmarks.late_wakeups.LateWakeups",
    "dehyst.daemon.bus.session.Bus", "dehyst.drivers.emulated.bench",
    "dehyst.drivers.emulated.amplifiers", "dehyst.drivers.emulated.mdt693b_port",
    "dehyst.drivers.emulated.pty_device", "nbclient",
)  # fmt: skip
EVENTS = {"subprocess.Popen", "os.fork", "os.forkpty", "os.posix_spawn", "os.system"}
"""Events that the interpreter reports to an audit hook."""


def _imported(node: ast.AST) -> Iterator[tuple[str, str]]:
    """Yield (name here, full name) for each name that an import binds."""
    if isinstance(node, ast.Import):
        for alias in node.names:
            yield alias.asname or alias.name.partition(".")[0], alias.name
    elif isinstance(node, ast.ImportFrom):
        for alias in node.names:
            yield alias.asname or alias.name, f"{node.module}.{alias.name}"


def _dotted(node: ast.Attribute) -> str:
    """Return the full dotted name; "" if it does not consist of names only."""
    parts, at = [node.attr], node.value
    while isinstance(at, ast.Attribute):
        parts.append(at.attr)
        at = at.value
    return ".".join([at.id, *reversed(parts)]) if isinstance(at, ast.Name) else ""


def _named(node: ast.AST) -> set[str]:
    """Return a definition's names, dotted ones in full; "(name)" for an argument: a fixture."""
    names = set()
    for one in ast.walk(node):
        if isinstance(one, ast.Name):
            names.add(one.id)
        elif isinstance(one, ast.Attribute):
            names.add(_dotted(one))
        elif isinstance(one, ast.arg):
            names.add(f"({one.arg})")
    return names


WORDS = {tool.rpartition(".")[0] or tool for tool in TOOLS}
"""Every file that imports a tool contains one of these."""


@cache
def starting(path: Path, inherited: frozenset[str] = frozenset()) -> frozenset[str]:
    """Return names in this file that start something; inherited: fixtures of folders above."""
    text = path.read_text(encoding="utf-8")
    words = "|".join(re.escape(name.strip("()")) for name in (*WORDS, *inherited))
    if not re.search(rf"\b(?:{words})\b", text):
        return frozenset()  # every worker checks every file: most need not be parsed
    tree = ast.parse(text)
    found = {
        name
        for node in ast.walk(tree)
        for name, full in _imported(node)
        if any(full == tool or full.startswith(f"{tool}.") for tool in TOOLS)
    }
    found |= {tool for tool in TOOLS if "." in tool} | {f"({name})" for name in inherited}
    definitions: dict[str, set[str]] = {}
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            definitions[node.name] = _named(node)
        elif isinstance(node, ast.Assign):
            for target in node.targets:
                definitions[ast.unparse(target)] = _named(node.value)
    found -= {f"({name})" for name in definitions}  # a fixture of this file hides an inherited one
    while more := {n for n, uses in definitions.items() if n not in found and uses & found}:
        found |= more | {f"({name})" for name in more}
    return frozenset(found)


@cache
def _above(folder: Path) -> frozenset[str]:
    """Return the fixtures of this folder and the folders above it that start something."""
    above: frozenset[str] = frozenset()
    for one in reversed((folder, *folder.parents)):
        conftest = one / "conftest.py"
        if conftest.exists():
            above |= starting(conftest, above)
    return above


def starts_something(path: Path, name: str) -> bool:
    """Return whether the test of this name (function, or class) in this file starts something."""
    return name in starting(path, _above(path.parent))


def starts_something_in(path: Path) -> bool:
    """Return whether any test of this file does."""
    names = starting(path, _above(path.parent))
    return any(name.lower().startswith("test") and name.isidentifier() for name in names)


def starts_something_always(path: Path) -> bool:
    """Return whether every test of this file does."""
    tests = re.findall(
        r"^(?:def|class) ([tT]est\w*)", path.read_text(encoding="utf-8"), re.MULTILINE
    )
    return starting(path, _above(path.parent)).issuperset(tests)


class Started(AssertionError):
    """A test of the quick part has started something."""


_watched: list[list[str]] = []


def _notice(what: str) -> None:
    if _watched:
        _watched[-1].append(what)
        raise Started(f"a test that is not marked `processes` starts something: {what}")


def _noticed(what: str, function: Callable[..., Any]) -> Callable[..., Any]:
    def call(*args: Any, **kwargs: Any) -> Any:
        _notice(what)
        return function(*args, **kwargs)

    return call


def watch() -> None:
    """Enable `guard` from now on. Called once per process: an audit hook cannot be removed."""

    def hook(event: str, args: tuple[Any, ...]) -> None:
        if event in EVENTS:
            _notice(f"{event} {args[:2]}")

    sys.addaudithook(hook)
    start = multiprocessing.process.BaseProcess.start
    multiprocessing.process.BaseProcess.start = _noticed("multiprocessing", start)  # type: ignore[method-assign]
    zenoh.open = _noticed("zenoh.open", zenoh.open)
    os.openpty = pty.openpty = _noticed("openpty", os.openpty)


@contextmanager
def guard() -> Iterator[None]:
    """Refuse what is started inside the block, and report it at the end even if the error was
    swallowed."""
    heard: list[str] = []
    _watched.append(heard)
    try:
        yield
    finally:
        _watched.remove(heard)
    if heard:
        raise Started(f"started by a test that is not marked `processes`: {', '.join(heard)}")
