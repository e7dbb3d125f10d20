"""What starts often, or where somebody waits, imports nothing heavy that it does not use."""

import subprocess
import sys

import pytest

HEAVY = {"numba", "scipy", "matplotlib", "rich.progress"}


@pytest.mark.parametrize(
    ("module", "without"),
    [
        ("dehyst.daemon.main", HEAVY | {"numpy"}),
        ("dehyst.daemon.client.client", HEAVY),
        ("dehyst.daemon.service.supervisor", HEAVY),
        ("dehyst.daemon.gateway.process", {"matplotlib", "scipy.signal", "scipy.ndimage"}),
        ("dehyst.daemon.loop.process", {"matplotlib", "scipy.signal", "scipy.ndimage"}),
    ],
)
def test_an_import_takes_nothing_heavy_with_it(module: str, without: set[str]) -> None:
    program = f"import sys, {module}; print(*({without!r} & sys.modules.keys()))"
    said = subprocess.run(
        [sys.executable, "-c", program], check=True, capture_output=True, text=True, timeout=60
    )
    assert said.stdout.split() == []
