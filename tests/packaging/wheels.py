"""Which wheels pip would install on which machine; it reads their metadata and installs nothing."""

import subprocess
import sys
import tomllib
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
LABEL = "Programming Language :: Python :: 3."
PYTHONS = [c.rpartition(" ")[2] for c in PROJECT["classifiers"] if c.startswith(LABEL)]
"""Versions that the classifiers promise."""
GLIBC = ("manylinux_2_28", "manylinux_2_27", "manylinux_2_17", "manylinux2014")
MACHINES = {
    "x86_64": [f"{tag}_x86_64" for tag in GLIBC],
    "aarch64": [f"{tag}_aarch64" for tag in GLIBC],
    "Windows x86_64": ["win_amd64"],
    "macOS arm64": [
        *(f"macosx_{version}_0_arm64" for version in (14, 13, 12, 11)),
        *(f"macosx_{version}_universal2" for version in ("11_0", "10_13", "10_9")),
    ],
}
"""Accepted wheel tags, by machine."""
WITH_THE_LOOP = ("x86_64", "aarch64")
"""Linux: the machines that can run a daemon."""


def resolve(python: str, machine: str, *requirements: str) -> "subprocess.CompletedProcess[str]":
    """Ask pip which wheels it would install there."""
    places = [word for tag in MACHINES[machine] for word in ("--platform", tag)]
    return subprocess.run(
        [sys.executable, "-m", "pip", "install", "--quiet", "--dry-run", "--no-input",
         "--ignore-installed", "--target", "nowhere", "--only-binary=:all:", "--timeout", "5",
         "--retries", "0", "--python-version", python, "--implementation", "cp", *places,
         *requirements],
        capture_output=True, text=True, timeout=200, check=False,
    )  # fmt: skip


@cache
def offline() -> str:
    """Return why there is no package index, or "" if there is one."""
    done = resolve("3.11", "x86_64", "pyserial")
    return "" if done.returncode == 0 else (done.stderr.strip() or "no answer").splitlines()[-1]
