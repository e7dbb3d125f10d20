"""Install and run dehyst with every Python that pyproject.toml names and that is on this machine.

    python -m tests.packaging.interpreters [3.12 ...]

For each a new environment below out/, a copy of the tree installed with wheels of all that it needs,
and then: the import, the command line, a recording written and read in each kind of file, and a
model on it, which compiles kernels.
Exit status 1 where one of them fails; a Python that is not here is said and passed over.
"""

import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
LABEL = "Programming Language :: Python :: 3."
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


def promised() -> list[str]:
    """The versions of the classifiers."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    return [c.rpartition(" ")[2] for c in project["classifiers"] if c.startswith(LABEL)]


def interpreter(version: str) -> str:
    """A Python of this version that runs, else ""."""
    kept = sorted(Path.home().glob(f".pyenv/versions/{version}.*/bin/python"))
    for path in (shutil.which(f"python{version}"), *map(str, kept)):
        if path and subprocess.run([path, "-c", ""], capture_output=True).returncode == 0:
            return path
    return ""


def plain() -> dict[str, str]:
    """The environment without this tree's own path."""
    return {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}


def try_it(version: str, python: str) -> bool:
    """Install and run; whether it went well."""
    place = ROOT / "out" / f"python-{version}"
    shutil.rmtree(place, ignore_errors=True)
    (place / "work").mkdir(parents=True)
    own, tree = str(place / "bin" / "python"), place / "tree"
    unwanted = shutil.ignore_patterns(".*", "build", "dist", "out", "tests", "*.egg-info")
    shutil.copytree(ROOT, tree, symlinks=True, ignore=unwanted)  # a build leaves things behind
    wheels = ["-m", "pip", "install", "--quiet", "--only-binary=:all:"]
    steps = [
        [python, "-m", "venv", str(place)],
        [own, *wheels, "setuptools>=77"],
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
    """Try these, all that are promised where none is named."""
    wrong = 0
    for version in versions or promised():
        if not (python := interpreter(version)):
            print(f"Python {version}: not on this machine, not tried")
        else:
            wrong += not try_it(version, python)
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
