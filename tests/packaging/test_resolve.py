"""The newest Python that pyproject.toml promises needs no compiler on the rarer machine.

`make interpreters` checks all of them. The test queries the package index, and is skipped without
one.
"""

import pytest
from tests.packaging.wheels import PROJECT, PYTHONS, offline, resolve


@pytest.mark.processes
def test_wheels_for_all_that_it_needs() -> None:
    if why := offline():
        pytest.skip(f"no package index: {why}")
    done = resolve(PYTHONS[-1], "aarch64", *PROJECT["dependencies"])
    assert done.returncode == 0, done.stderr


def test_the_promised_pythons_are_those_that_the_project_takes() -> None:
    assert PYTHONS[0] == PROJECT["requires-python"].removeprefix(">=")
    minor = [int(version.rpartition(".")[2]) for version in PYTHONS]
    assert minor == list(range(minor[0], minor[-1] + 1))
