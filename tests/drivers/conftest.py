"""Fixtures that the tests of all drivers share."""

from collections.abc import Iterator

import pytest
from tests.rigs.two_loops import end_links


@pytest.fixture(autouse=True)
def _no_link_outlives_its_test() -> Iterator[None]:
    yield
    end_links()
