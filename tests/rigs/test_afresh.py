"""Run again, a test gets the fixtures of its module anew, and so do those that follow."""

import subprocess
import sys
from pathlib import Path

TESTS = """
import pytest

made = []

@pytest.fixture(scope="module")
def bench():
    bench = {"number": len(made), "spoilt": False}
    made.append(bench)
    yield bench
    assert not bench.get("page"), "the page ends before its bench"
    bench["closed"] = True

@pytest.fixture(scope="module")
def page(bench):
    bench["page"] = True
    yield bench
    bench["page"] = False

def test_before(page):
    assert page["number"] == 0

def test_fails_at_first(page):
    assert not page["spoilt"]
    page["spoilt"] = page["number"] == 0
    assert not page["spoilt"]

def test_behind(page):
    assert (page["number"], made[0]["closed"], "closed" in page) == (1, True, False)
"""


def test_a_module_that_an_attempt_has_spoilt_is_made_anew(tmp_path: Path) -> None:
    (tmp_path / "test_it.py").write_text(TESTS)
    options = ["-q", "--reruns", "1", "-p", "tests.rigs.afresh", "-p", "no:cacheprovider"]
    done = subprocess.run(
        [sys.executable, "-m", "pytest", *options, "test_it.py"],
        cwd=tmp_path, env={"PYTHONPATH": str(Path(__file__).parents[2])},
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert "3 passed, 1 rerun" in done.stdout, done.stdout
