"""Fixtures of the daemon's tests."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.rigs.gateway_bench import Bench


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    """A running loop and gateway of its own for one test."""
    bench = Bench(tmp_path)
    try:
        bench.start_gateway()
        yield bench
    finally:
        bench.close()
