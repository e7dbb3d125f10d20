"""A kernel that an attacker planted in the cache is not loaded.

The planted entry replaces the index of a real kernel with a pickle that makes a folder when it is
loaded: the folder shows whether the entry was read.
"""

import os
import pickle
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

from dehyst.daemon import kernel_cache

UNITS = Path(__file__).resolve().parents[2] / "systemd"
NOBODY = 65534
as_root = pytest.mark.skipif(os.geteuid() != 0, reason="needs a second user")
LOAD = """
import os, sys
from dehyst.daemon import kernel_cache
os.seteuid(int(sys.argv[1]))  # who looks; then root again, who may read the program
print(*kernel_cache.protect(), sep="\\n")
os.seteuid(os.getuid())
kernel_cache.drop_stale()
kernel_cache.load_lightly()
import numpy as np
from dehyst.daemon.rings.ring import load_word
load_word(np.zeros(8, np.int64), 1)
print("hits", sum(load_word.stats.cache_hits.values()))
"""


class Mark:
    """Makes a folder when it is unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return (os.mkdir, (str(self.path),))


def run(cache: Path, user: int = 0) -> str:
    """Return the output of a process that loads one kernel from the cache."""
    done = subprocess.run(
        [sys.executable, "-c", LOAD, str(user)],
        env={**os.environ, "NUMBA_CACHE_DIR": str(cache)},
        capture_output=True, text=True, check=False, timeout=200,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The cache that `installed` copies."""
    cache = tmp_path_factory.mktemp("compiled") / "kernels"
    cache.mkdir(mode=0o755)
    run(cache)
    assert list(cache.rglob("*.nbi"))
    return cache


@pytest.fixture
def installed(compiled: Path, tmp_path: Path) -> Path:
    """Copy a cache with that kernel, as an installation leaves it; readable by all."""
    for folder in (tmp_path, *tmp_path.parents):
        if folder.stat().st_mode & 0o055 != 0o055:  # pytest closes the folders of a run
            os.chmod(folder, 0o755)
    return shutil.copytree(compiled, tmp_path / "kernels")


@as_root
def test_installed_kernels_are_used_by_another_user_and_not_changed(installed: Path) -> None:
    before = {p: p.stat().st_mtime_ns for p in installed.rglob("*")}
    assert "hits 1" in run(installed, NOBODY)
    assert {p: p.stat().st_mtime_ns for p in installed.rglob("*")} == before


@as_root
@pytest.mark.parametrize("how", ["owner", "mode", "link", "folder"])
def test_a_planted_entry_is_not_loaded(installed: Path, tmp_path: Path, how: str) -> None:
    mark = tmp_path / "open" / "mark"
    mark.parent.mkdir()
    os.chmod(mark.parent, 0o777)
    index = next(p for p in installed.rglob("*.nbi") if p.name.startswith("ring.load_word"))
    planted = tmp_path / "planted"
    planted.write_bytes(pickle.dumps(Mark(mark)))
    index.unlink()
    if how == "link":
        os.chown(planted, NOBODY, NOBODY)
        index.symlink_to(planted)
    else:
        shutil.copy(planted, index)
    if how == "owner":
        os.chown(index, NOBODY, NOBODY)
    elif how == "mode":
        os.chmod(index, 0o666)
    elif how == "folder":
        os.chmod(index.parent, 0o777)
    words = run(installed, NOBODY)
    assert not mark.exists()
    assert "not loaded" in words
    assert "hits 0" in words
    run(installed)  # not by the owner either
    assert not mark.exists()


@as_root
def test_the_planted_entry_would_have_run(installed: Path, tmp_path: Path) -> None:
    """The mark works: an entry left by the owner is read, so the other tests would notice a planted
    one."""
    mark = tmp_path / "mark"
    index = next(p for p in installed.rglob("*.nbi") if p.name.startswith("ring.load_word"))
    index.write_bytes(pickle.dumps(Mark(mark)))
    subprocess.run(
        [sys.executable, "-c", LOAD, "0"], env={**os.environ, "NUMBA_CACHE_DIR": str(installed)},
        capture_output=True, check=False, timeout=200,
    )  # fmt: skip
    assert mark.exists()


def test_without_an_installed_cache_the_kernels_are_compiled_and_it_is_said(
    tmp_path: Path,
) -> None:
    (tmp_path / "file").write_text("")
    words = run(tmp_path / "file" / "kernels")
    assert "compiles the kernels again" in words
    assert "hits 0" in words


def test_a_cache_of_ones_own_is_used_as_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    os.chmod(tmp_path, 0o700)
    assert kernel_cache.protect() == []
    assert os.environ["NUMBA_CACHE_DIR"] == str(tmp_path)


def test_the_services_cannot_write_where_they_load_from() -> None:
    for name in ("dehyst.service", "dehyst-gateway.service"):
        unit = (UNITS / name).read_text()
        assert "Environment=NUMBA_CACHE_DIR=/opt/dehyst/kernels\n" in unit
        assert "ProtectSystem=strict\n" in unit
        assert "CacheDirectory" not in unit
        writable = [x for x in unit.splitlines() if x.startswith(("ReadWritePaths", "StateDir"))]
        assert not any("/opt" in line for line in writable)


def test_a_kernel_goes_with_what_its_file_imports_and_no_other_file_is_read_for_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """If a source has changed, the kernels of its importers are dropped too. Times in s: the
    kernels of three files were made at 30, b was changed at 40."""
    texts = {"a": "from dehyst.models.b import f\n", "b": "", "c": ""}
    for name, text in texts.items():
        path = tmp_path / "models" / f"{name}.py"
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
        index = path.parent / "__pycache__" / f"{name}.f-1.py311.nbi"
        index.parent.mkdir(exist_ok=True)
        index.write_bytes(b"")
        os.utime(path, (20, 20))
        os.utime(index, (30, 30))
    monkeypatch.setattr(kernel_cache, "PACKAGE", tmp_path)
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)

    def kernels() -> list[str]:
        return sorted(path.name[0] for path in tmp_path.rglob("*.nbi"))

    reads = []
    read_text = Path.read_text
    monkeypatch.setattr(Path, "read_text", lambda p, **k: reads.append(p) or read_text(p, **k))
    assert (kernel_cache.drop_stale(), kernels(), reads) == (0, ["a", "b", "c"], [])
    os.utime(tmp_path / "models" / "b.py", (40, 40))
    assert (kernel_cache.drop_stale(), kernels(), len(reads)) == (2, ["c"], 3)
    assert (kernel_cache.drop_stale(), kernels(), len(reads)) == (0, ["c"], 3)  # c is not reread
    index = next(tmp_path.rglob("c.*.nbi"))
    os.utime(index, (30, 30))
    os.link(index, tmp_path / "another tree's")  # whose sources may differ
    kernel_cache.drop_stale()
    assert index.stat().st_mtime == 30
    os.utime(tmp_path / "models" / "c.py", (time.time() + 5, time.time() + 5))
    assert (kernel_cache.drop_stale(), kernels()) == (1, [])
