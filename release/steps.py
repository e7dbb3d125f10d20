"""The parts of a release: distributions, locked dependencies, environment, bill of materials."""

import hashlib
import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
VERSION: str = PROJECT["version"]
SERVICE, IMAGE = ROOT / "release/constraints-service.txt", ROOT / "release/constraints-image.txt"
SERVICE_EXTRAS = ("epics",)
"""Extras that the units in systemd/ need in addition to the dependencies."""
IMAGE_PYTHON = "3.12"
"""The Python version of Containerfile."""


class ReleaseError(Exception):
    """A step failed; the message is the last lines of its output. code: the exit status of the
    command that failed."""

    def __init__(self, words: str, code: int = 1) -> None:
        super().__init__(words)
        self.code = code


def call(*command: str | Path, cwd: Path = ROOT, seconds: float = 900.0, **env: str) -> str:
    """Run a command and return its output. Raises ReleaseError if it fails."""
    words = [str(word) for word in command]
    own = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    done = subprocess.run(
        words, cwd=cwd, env=own | env, capture_output=True, text=True, timeout=seconds
    )
    if done.returncode != 0:
        said = "\n".join((done.stdout + done.stderr).strip().splitlines()[-12:])
        text = f"{' '.join(words[:6])}: exit status {done.returncode}\n{said}"
        raise ReleaseError(text, done.returncode)
    return done.stdout


def python(*arguments: str | Path, **env: str) -> str:
    """Run a module or file with this interpreter."""
    return call(sys.executable, *arguments, **env)


def build(dist: Path, work: Path) -> tuple[Path, Path]:
    """Build the source distribution, and the wheel from it, in a copy of the tree, because a build
    leaves files behind."""
    tree = work / "tree"
    unwanted = shutil.ignore_patterns(".*", "build", "dist", "out", "tests", "*.egg-info")
    shutil.copytree(ROOT, tree, symlinks=True, ignore=unwanted)
    python("-m", "build", "--outdir", dist, tree)
    (sdist,), (wheel,) = dist.glob("*.tar.gz"), dist.glob("*.whl")
    python("-m", "twine", "check", "--strict", sdist, wheel)
    return sdist, wheel


def lock() -> list[str]:
    """Pin every dependency with the hashes of its files; return the names of the lists that
    changed.

    A version that is already pinned is kept while pyproject.toml allows it; to get the newest,
    delete the list first.
    """
    before = {path: path.read_text() if path.exists() else "" for path in (SERVICE, IMAGE)}
    extras = [word for extra in SERVICE_EXTRAS for word in ("--extra", extra)]
    lowest = PROJECT["requires-python"].removeprefix(">=")
    linux = ("--python-version", IMAGE_PYTHON, "--python-platform", "linux")
    for path, words in (
        (SERVICE, ("--universal", "--python-version", lowest, *extras)),
        (IMAGE, linux),
    ):
        python(
            *("-m", "uv", "pip", "compile", "pyproject.toml", "--generate-hashes", "--no-config"),
            "--native-tls",  # the system's certificates, as pip uses them
            *("--quiet", "--no-header", "--no-annotate", "--output-file", path, *words),
        )
    return [path.name for path, text in before.items() if path.read_text() != text]


def install(interpreter: str, place: Path, wheel: Path) -> Path:
    """Make a new environment with this wheel and the locked dependencies, each of which has one of
    the hashes in the list; return its Python."""
    call(interpreter, "-m", "venv", "--without-pip", place)
    own = place / "bin" / "python3"
    pip = ("-m", "pip", "--python", own, "install", "--quiet", "--no-compile", "--no-input")
    python(*pip, "--only-binary=:all:", "--require-hashes", "-r", SERVICE)
    python(*pip, "--no-deps", "--no-index", wheel)
    return own


def bill_of_materials(own: Path, path: Path) -> None:
    """Write the contents of this environment, as CycloneDX."""
    python(
        *("-m", "cyclonedx_py", "environment", "--pyproject", "pyproject.toml"),
        *("--output-format", "JSON", "--output-reproducible", "--output-file", path, own),
    )


def sums(dist: Path) -> None:
    """Write SHA256SUMS of everything in the folder, in the format of `sha256sum --check`."""
    lines = [
        f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.name}\n"
        for path in sorted(dist.iterdir())
        if path.name != "SHA256SUMS"
    ]
    (dist / "SHA256SUMS").write_text("".join(lines))
