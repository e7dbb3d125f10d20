"""Programs that start often, or that somebody waits for, import no heavy module needlessly."""

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
        ("dehyst.daemon.commands.identify", {"numba", "scipy", "matplotlib"}),
        ("dehyst.daemon.commands.diagnose", {"numba", "scipy", "matplotlib"}),
        ("dehyst.daemon.commands.invert", {"numba", "scipy", "matplotlib"}),
        ("dehyst.daemon.commands.simulate", {"numba", "scipy", "matplotlib"}),
        ("dehyst.daemon.api.functions", {"matplotlib", "scipy.signal", "scipy.stats"}),
    ],
)
def test_an_import_takes_nothing_heavy_with_it(module: str, without: set[str]) -> None:
    program = f"import sys, {module}; print(*({without!r} & sys.modules.keys()))"
    said = subprocess.run(
        [sys.executable, "-c", program], check=True, capture_output=True, text=True, timeout=60
    )
    assert said.stdout.split() == []


def test_a_kernel_on_disk_takes_no_more_than_it_needs_and_one_that_is_compiled_all() -> None:
    program = """
import sys
import numpy as np
from dehyst.daemon.kernel_cache import load_lightly
load_lightly()
from numba import njit
from dehyst.daemon.rings import ring
words = np.zeros(4, np.int64)
ring.store(words, 2, 7)
assert ring.load_word(words, 2) == 7
from dehyst.models.mismatch.monitor import compile_monitor
compile_monitor()
assert not {"scipy.linalg", "cffi"} & sys.modules.keys()
@njit
def multiply(a, b):
    return np.dot(a, b)
@njit
def keep(words):
    ring.store(words, 1, 5)
    return ring.load_word(words, 1)
assert keep(words) == 5
@njit
def factorial(n):  # its own symbol is looked for before it is defined
    return 1 if n < 2 else n * factorial(n - 1)
assert factorial(6) == 720
print(multiply(np.array([[2.0, 1.0], [0.0, 3.0]]), np.array([[1.0, 2.0], [3.0, 4.0]])).tolist())
"""
    said = subprocess.run(
        [sys.executable, "-c", program], check=True, capture_output=True, text=True, timeout=60
    )
    assert said.stdout == "[[5.0, 8.0], [9.0, 12.0]]\n"
