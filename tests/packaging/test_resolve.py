"""Every Python and machine that pyproject.toml promises can be installed for, without a compiler.

pip resolves the dependencies from wheels alone; it reads their metadata and installs nothing. It asks
the package index, and is skipped where there is none.
"""

import subprocess
import sys
import tomllib
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
LABEL = "Programming Language :: Python :: 3."
PYTHONS = [c.rpartition(" ")[2] for c in PROJECT["classifiers"] if c.startswith(LABEL)]
GLIBC = ("manylinux_2_28", "manylinux_2_27", "manylinux_2_17", "manylinux2014")


def resolve(python: str, machine: str, *requirements: str) -> "subprocess.CompletedProcess[str]":
    """pip's answer to: which wheels would be installed there?"""
    places = [word for tag in GLIBC for word in ("--platform", f"{tag}_{machine}")]
    return subprocess.run(
        [sys.executable, "-m", "pip", "install", "--quiet", "--dry-run", "--no-input",
         "--ignore-installed", "--target", "nowhere", "--only-binary=:all:", "--timeout", "5",
         "--retries", "0", "--python-version", python, "--implementation", "cp", *places,
         *requirements],
        capture_output=True, text=True, timeout=200, check=False,
    )  # fmt: skip


@cache
def offline() -> str:
    """Why there is no package index; "" where there is one."""
    done = resolve("3.11", "x86_64", "pyserial")
    return "" if done.returncode == 0 else (done.stderr.strip() or "no answer").splitlines()[-1]


@pytest.mark.processes
@pytest.mark.parametrize("machine", ["x86_64", "aarch64"])
@pytest.mark.parametrize("python", PYTHONS)
def test_wheels_for_all_that_it_needs(python: str, machine: str) -> None:
    if why := offline():
        pytest.skip(f"no package index: {why}")
    done = resolve(python, machine, *PROJECT["dependencies"])
    assert done.returncode == 0, done.stderr


def test_the_promised_pythons_are_those_that_the_project_takes() -> None:
    assert PYTHONS[0] == PROJECT["requires-python"].removeprefix(">=")
    minor = [int(version.rpartition(".")[2]) for version in PYTHONS]
    assert minor == list(range(minor[0], minor[-1] + 1))
