"""A test that is run again begins afresh: what its module shares is made anew for the attempt.

pytest-rerunfailures makes only those fixtures anew that failed themselves; a bench that a failed
attempt has left in motion, or without its loop, would fail every further attempt.
"""

import pytest


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """End what the module shares before another attempt; dependents end before what they use."""
    if getattr(item, "execution_count", 1) < 2:
        return
    for definitions in item._fixtureinfo.name2fixturedefs.values():  # type: ignore[attr-defined]
        for definition in definitions:
            if definition.scope == "module":
                definition.finish(item._request)  # type: ignore[attr-defined]
