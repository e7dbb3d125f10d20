"""Fixtures of the daemon's tests."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.rigs.gateway_bench import Bench, started_bench
from tests.rigs.stage_model import kept_model

from dehyst.daemon.files.models import save_model


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    """A loop and gateway that run for one test only."""
    bench = Bench(tmp_path)
    try:
        bench.start_gateway()
        yield bench
    finally:
        bench.close()


@pytest.fixture(scope="module")
def bench_of_module(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    """The bench that `shared` returns."""
    with started_bench(tmp_path_factory.mktemp("shared")) as bench:
        yield bench


@pytest.fixture
def shared(bench_of_module: Bench) -> Bench:
    """A running loop and gateway for tests that end neither and change nothing that lasts: at rest
    when the test begins, but not new."""
    bench_of_module.rest()
    return bench_of_module


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The file of the stage's model."""
    path = tmp_path_factory.mktemp("model") / "model.toml"
    save_model(kept_model(), path)
    return path
