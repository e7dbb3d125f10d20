"""Fixtures of the daemon's tests."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.rigs.gateway_bench import Bench

FAILED = pytest.StashKey[bool]()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Iterator[None]:
    """Tell the fixtures of a test whether it failed."""
    report = yield
    if report.failed:  # type: ignore[attr-defined]
        item.stash[FAILED] = True
    return report


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    """A running loop and gateway of its own for one test."""
    bench = Bench(tmp_path)
    try:
        bench.start_gateway()
        yield bench
    finally:
        bench.close()


class Kept:
    """The bench that tests of a file share; none before the first, and behind one that failed."""

    def __init__(self, folders: pytest.TempPathFactory) -> None:
        self._folders = folders
        self.bench: Bench | None = None

    def running(self) -> Bench:
        """At rest, and new where there is none."""
        if self.bench is None:
            self.bench = Bench(self._folders.mktemp("shared"))
            self.bench.start_gateway()
        self.bench.rest()
        return self.bench

    def close(self) -> None:
        """End it; the next test gets another."""
        if self.bench is not None:
            self.bench.close()
        self.bench = None


@pytest.fixture(scope="module")
def kept_bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Kept]:
    kept = Kept(tmp_path_factory)
    try:
        yield kept
    finally:
        kept.close()


@pytest.fixture
def shared(kept_bench: Kept, request: pytest.FixtureRequest) -> Iterator[Bench]:
    """A running loop and gateway for tests that end neither and change nothing that stays: at rest
    when it is handed out, but not new. A test that is run again gets a new one."""
    request.node.stash[FAILED] = True  # until it is known better
    try:
        bench = kept_bench.running()
        request.node.stash[FAILED] = False
        yield bench
    finally:
        if request.node.stash[FAILED]:
            kept_bench.close()
