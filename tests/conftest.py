"""Fixtures and hooks that all tests share."""

import os
import signal
import sys
import tempfile
import threading

# `dehyst` itself does this too, before numpy is imported
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path

import pytest
from hypothesis import settings
from tests.long import is_long
from tests.parts import is_of, is_thorough
from tests.rigs import starts

from dehyst.daemon import kernel_cache

ROOT = Path(__file__).resolve().parent.parent
# a shell script starts background jobs with SIGINT ignored; programs that the tests start would
# inherit that
if (
    threading.current_thread() is threading.main_thread()
    and signal.getsignal(signal.SIGINT) is signal.SIG_IGN
):
    signal.signal(signal.SIGINT, signal.default_int_handler)
# keep byte code on disk: otherwise each of a thousand processes compiles all that it imports
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False
if "PYTEST_XDIST_WORKER" not in os.environ:  # the xdist workers start after this
    kernel_cache.drop_stale()
starts.watch()
# daemons of the same name share files here: neither parallel tests nor a daemon of this machine's
# user may share them
RUNTIME = tempfile.TemporaryDirectory(prefix="dehyst-run-")
os.environ["XDG_RUNTIME_DIR"] = RUNTIME.name
settings.register_profile("no times are judged", deadline=None)
settings.load_profile("no times are judged")


def pytest_configure(config: pytest.Config) -> None:
    """Load kernels as `dehyst` loads them, except in the process that only distributes tests."""
    if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
        # under nohup: what the tests start would inherit that; a handler is not inherited
        signal.signal(signal.SIGHUP, lambda *_: None)
    if hasattr(config, "workerinput") or not config.getoption("numprocesses", None):
        kernel_cache.load_lightly()


@pytest.hookimpl(tryfirst=True)  # xdist reads the groups in its own hook
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark tests that start a process, and keep tests that share a module's rig in one worker."""
    for item in items:
        name = item.cls.__name__ if getattr(item, "cls", None) else item.originalname  # type: ignore[attr-defined]
        if starts.starts_something(item.path, name) or item.get_closest_marker("timing"):
            item.add_marker("processes")
        if is_thorough(item.path):
            item.add_marker("thorough")
        if is_long(item.nodeid):
            item.add_marker("long")
        marked = {mark.name for mark in item.iter_markers()}
        assert "long" not in marked or marked & {"processes", "thorough"}, (
            f"{item.nodeid} is quick: it may not be left to `make long`"
        )
        parts = {"processes", "timing", "alone"} & marked
        for part in parts if marked & {"processes", "thorough"} else {"quick"}:
            assert is_of(item.path, part), (
                f"{item.nodeid} is of the part {part}, and tests/parts.py does not see that"
            )
        rigs = item._fixtureinfo.name2fixturedefs.values()  # type: ignore[attr-defined]
        grouped = item.get_closest_marker("xdist_group")
        if not grouped and any(d[-1].scope == "module" and d[-1].baseid for d in rigs):
            item.add_marker(pytest.mark.xdist_group(item.path.stem))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup(item: pytest.Item) -> Iterator[None]:
    """Forbid the fixtures of a quick test to start a process."""
    with nullcontext() if item.get_closest_marker("processes") else starts.guard():
        return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Iterator[None]:
    """Forbid a quick test itself to start a process."""
    with nullcontext() if item.get_closest_marker("processes") else starts.guard():
        return (yield)


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """Return the folder of recordings/ and concealed/: $DEHYST_DATA, else shared/ next to ROOT."""
    folder = Path(os.environ.get("DEHYST_DATA") or ROOT.parent / "shared")
    if not (folder / "recordings").is_dir():
        pytest.skip(f"no recordings in {folder}; set DEHYST_DATA to the folder that holds them")
    return folder
