"""Check every Python that pyproject.toml names: are there wheels for all dependencies, and does it
run?

    python -m tests.packaging.interpreters [3.12 ...]

For each Python and Linux machine, and for the newest Python on Windows and macOS, pip resolves the
dependencies from wheels alone. For each Python on this machine: a new environment below out/, with
a copy of the tree; then the import, the command line, a recording written and read in each kind of
file, and a model on it, which compiles kernels. The oldest Python gets the lowest versions that
pyproject.toml allows, the others the newest. The exit status is 1 if one of them fails; what cannot
be tried is reported and skipped.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

from tests.packaging.wheels import MACHINES, PROJECT, PYTHONS, ROOT, WITH_THE_LOOP, offline, resolve

PROGRAM = """
import sys, numpy as np, dehyst
from dehyst.daemon.files.recordings import read_columns, write_recording
from dehyst.daemon.main import main
t_s = 0.001 * np.arange(500)
columns = {"u_v": 5 + 4 * np.sin(20 * t_s), "y_um": 5 + 4 * np.sin(20 * t_s - 0.1)}
for kind in ("csv", "csv.gz", "npz", "mcap"):
    write_recording(f"{sys.argv[1]}/run.{kind}", t_s, columns, {"made": "here"})
    found, notes = read_columns(f"{sys.argv[1]}/run.{kind}")
    assert all(np.array_equal(found[name], columns[name]) for name in columns), kind
    assert notes["made"] == "here"
out = dehyst.simulate("paper-eq12", {"t_s": t_s, **columns})
assert np.isfinite(np.asarray(out)).all()
assert main(["drivers"]) == 0
print("runs with", sys.version.split()[0])
"""


def interpreter(version: str) -> str:
    """Return a Python of this version that runs, else ""."""
    kept = sorted(Path.home().glob(f".pyenv/versions/{version}.*/bin/python"))
    for path in (shutil.which(f"python{version}"), *map(str, kept)):
        if path and subprocess.run([path, "-c", ""], capture_output=True).returncode == 0:
            return path
    return ""


def plain() -> dict[str, str]:
    """Return the environment without this tree's own path."""
    return {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}


def try_it(version: str, python: str) -> bool:
    """Install and run; return whether it succeeded."""
    place = ROOT / "out" / f"python-{version}"
    shutil.rmtree(place, ignore_errors=True)
    (place / "work").mkdir(parents=True)
    own, tree = str(place / "bin" / "python"), place / "tree"
    unwanted = shutil.ignore_patterns(".*", "build", "dist", "out", "tests", "*.egg-info")
    shutil.copytree(ROOT, tree, symlinks=True, ignore=unwanted)  # a build leaves files in the tree
    wheels = ["-m", "pip", "install", "--quiet", "--only-binary=:all:"]
    lowest = ["--resolution", "lowest-direct"] if version == PYTHONS[0] else []
    pinned = str(place / "dependencies.txt")
    lock = [
        sys.executable,
        "-m",
        "uv",
        "pip",
        "compile",
        "--quiet",
        "--no-config",
        "--native-tls",
        *lowest,
    ]
    steps = [
        [python, "-m", "venv", str(place)],
        [*lock, "--python", own, str(ROOT / "pyproject.toml"), "--output-file", pinned],
        [own, *wheels, "setuptools>=77", "-r", pinned],
        [own, "-m", "pip", "install", "--quiet", "--no-build-isolation", str(tree)],
        [own, "-I", "-c", PROGRAM, str(place / "work")],
    ]
    for step in steps:
        if subprocess.run(step, cwd=place / "work", env=plain(), timeout=900).returncode != 0:
            print(f"Python {version}: failed at {' '.join(step[:5])}")
            return False
    shutil.rmtree(place)
    return True


def main(versions: list[str]) -> int:
    """Try these versions, or all promised ones if none is named."""
    wrong, why = 0, offline()
    if why:
        print(f"wheels not looked for, no package index: {why}")
    for version in versions or PYTHONS:
        machines = MACHINES if version == PYTHONS[-1] else WITH_THE_LOOP
        for machine in () if why else machines:
            done = resolve(version, machine, *PROJECT["dependencies"])
            wrong += done.returncode != 0
            said = done.stderr.strip() if done.returncode else "a wheel for everything"
            print(f"Python {version}, {machine}: {said}", flush=True)
        if not (python := interpreter(version)):
            print(f"Python {version}: not on this machine, not tried")
        else:
            wrong += not try_it(version, python)
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
