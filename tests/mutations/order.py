"""A pytest plugin that runs one named test first, so that a change is judged quickly."""

import os

import pytest

FIRST = "DEHYST_MUTATION_FIRST"
"""Environment variable with the name of the test to run first; empty: the order stays."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Move the tests of that name, with all their parameters, to the front."""
    name = os.environ.get(FIRST, "")
    items.sort(key=lambda item: item.name.partition("[")[0] != name)
