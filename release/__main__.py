"""Build and check a release from this tree.

    python -m release [--publish] [--without-demo]

writes into dist/: the source distribution and the wheel; constraints-service.txt and
constraints-image.txt, every dependency with its hashes; an SBOM (CycloneDX) of the service's
environment; on Debian a package of the service; SHA256SUMS. It checks the metadata (twine), the
hashes, an installation in a fresh environment, and `dehyst demo --first-act` in it. With --publish
nothing is built from a tree that has no public home.
"""

import shutil
import sys
import tempfile
from pathlib import Path

from release import debian
from release.publication import lacking
from release.steps import (
    IMAGE,
    PROJECT,
    ROOT,
    SERVICE,
    VERSION,
    ReleaseError,
    bill_of_materials,
    build,
    call,
    install,
    lock,
    sums,
)

HOW = "docs/releases.md#publish"
TOO_BUSY = 77
"""Exit status of a demonstration that could not be judged because the machine was busy."""


def demonstrate(own: Path, folder: Path) -> int:
    """Run the demo's first act with the environment of this Python. Returns 0, or TOO_BUSY. Raises
    ReleaseError if the stage is not compensated."""
    folder.mkdir()
    try:
        said = call(own, "-m", "dehyst.daemon.main", "demo", "--first-act", cwd=folder)
    except ReleaseError as error:
        if error.code != TOO_BUSY:
            raise
        print("demo --first-act: ran, not judged: this machine was too busy", flush=True)
        return TOO_BUSY
    print(f"demo --first-act: {said.strip().splitlines()[-2].strip()}", flush=True)
    return 0


def release(dist: Path, work: Path, with_demo: bool) -> int:
    """Run all steps in order; each prints what it has made. Returns 0, or TOO_BUSY."""
    shutil.rmtree(dist, ignore_errors=True)
    dist.mkdir()
    for name in lock():
        print(f"release/{name}: renewed, commit it", flush=True)
    for path in (SERVICE, IMAGE):
        shutil.copy(path, dist)
    sdist, wheel = build(dist, work)
    print(f"{sdist.name} and {wheel.name}: built, metadata good", flush=True)
    interpreter = debian.interpreter()
    root = work / "root"
    own = install(interpreter or sys.executable, root / "opt" / "dehyst", wheel)
    print("installed in a fresh environment, every hash as listed", flush=True)
    bill = dist / f"dehyst-{VERSION}.cdx.json"
    bill_of_materials(own, bill)
    print(f"{bill.name}: what it holds", flush=True)
    code = demonstrate(own, work / "demo") if with_demo else 0
    if interpreter:
        package = debian.package(root, own, dist)
        print(f"{package.name}: {package.stat().st_size / 1e6:.0f} MB", flush=True)
    else:
        print("no Debian package: needs dpkg-deb and a Python of /usr/bin from 3.11 on", flush=True)
    sums(dist)
    return code


def main(arguments: list[str]) -> int:
    """Return 0 if the release is in dist/; 77 if it is, but the demonstration was not judged; 1 if
    it failed, with the reason printed."""
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    missing = "; ".join(lacking(PROJECT, changes))
    if missing and "--publish" in arguments:
        print(f"release: not built, because {HOW} asks for more: {missing}", file=sys.stderr)
        return 1
    if missing:
        print(f"for use here, not for publication ({HOW}): {missing}", flush=True)
    with tempfile.TemporaryDirectory(prefix="dehyst-release-") as work:
        try:
            return release(ROOT / "dist", Path(work), "--without-demo" not in arguments)
        except ReleaseError as error:
            print(f"release: {error}", file=sys.stderr)
            return 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
