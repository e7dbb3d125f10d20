"""Discard stale compiled kernels on disk, and load only kernels that can be trusted.

numba keeps a kernel's machine code as long as the kernel's own file is unchanged. A kernel that
calls another file's kernel, or reads a constant or a record layout from there, would not be
recompiled when that file changes. `drop_stale` follows the imports and removes outdated kernels.

A cached kernel is a pickle: whoever can write one can run code in every process that loads it. The
services therefore load kernels that another user wrote at installation and that they cannot write
themselves ($NUMBA_CACHE_DIR, see systemd/). `protect` checks the cache and links only the files
that nobody but their owner could have written into a folder private to this process; kernels that
must be compiled again go there too. Both functions are called before any kernel is loaded.
"""

import atexit
import os
import re
import shutil
import stat
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

from dehyst.drivers import system

PACKAGE = Path(__file__).resolve().parents[1]
ROOMS = ("models", "drivers", "daemon")
_FROM = re.compile(r"^from dehyst\.([\w.]+) import (\([^)]*\)|[^\n]*)", re.MULTILINE)


def _sources() -> dict[str, Path]:
    """Return the source files by module name without "dehyst."."""
    found = {}
    for room in ROOMS:
        for path in sorted((PACKAGE / room).rglob("*.py")):
            parts = path.relative_to(PACKAGE).with_suffix("").parts
            parts = parts[:-1] if parts[-1] == "__init__" else parts
            found[".".join(parts)] = path
    return found


def _imports(text: str, known: dict[str, Path]) -> set[str]:
    """Return the modules of this package that a file's text imports."""
    found = set()
    for module, names in _FROM.findall(text):
        found.add(module)
        found |= {f"{module}.{name}" for name in re.findall(r"\w+", names)}
    return {name for name in found if name in known}


def newest_sources_ns() -> dict[tuple[str, str], int]:
    """Return by folder and file name when the file, or anything it imports directly or indirectly,
    last changed."""
    files = _sources()
    texts = {name: path.read_text(encoding="utf-8") for name, path in files.items()}
    needs = {name: _imports(text, files) for name, text in texts.items()}
    changed = {name: path.stat().st_mtime_ns for name, path in files.items()}

    @cache
    def reached_from(name: str) -> frozenset[str]:
        seen, todo = {name}, [name]
        while todo:
            for other in needs[todo.pop()] - seen:
                seen.add(other)
                todo.append(other)
        return frozenset(seen)

    return {
        (path.parent.name, path.stem): max(changed[other] for other in reached_from(name))
        for name, path in files.items()
    }


def _kernel_file(index: Path) -> tuple[str, str]:
    """Return folder and file name of the kernel to which an index belongs. numba keeps the index in
    __pycache__ next to the file, or in $NUMBA_CACHE_DIR in a folder named FOLDER_HASH."""
    folder = index.parent
    beside = folder.name == "__pycache__"
    room = folder.parent.name if beside else folder.name.rpartition("_")[0]
    return room, index.name.partition(".")[0]


def protect() -> list[str]:
    """Replace $NUMBA_CACHE_DIR with a private view of it unless it belongs to this user and is
    closed to others. Return messages for the user about what was left out."""
    given = os.environ.get("NUMBA_CACHE_DIR")
    if not given:
        return []
    root = Path(given).resolve()
    view = Path(tempfile.mkdtemp(prefix="dehyst-kernels-"))
    try:
        root.mkdir(mode=0o755, parents=True, exist_ok=True)
        left = _view(root, view)
        own = root.stat().st_uid == system.user_id()
    except OSError as error:
        own, left = False, [(root, f"{error.strerror}; each start compiles the kernels again")]
    if own and not left:
        shutil.rmtree(view)
        return []
    atexit.register(shutil.rmtree, view, ignore_errors=True)
    os.environ["NUMBA_CACHE_DIR"] = str(view)
    return [f"{path}: not loaded, {why}" for path, why in left]


def _view(root: Path, view: Path) -> list[tuple[Path, str]]:
    """Link the trusted files below `root` into `view`; return the others with the reasons."""
    owner = root.stat().st_uid
    if owner not in (0, system.user_id()):
        return [(root, f"it belongs to user {owner}")]
    if system.others_may(root.stat()):
        return [(root, "others may write into it")]
    left = []
    for path in sorted(root.rglob("*")):
        found, place = path.lstat(), view / path.relative_to(root)
        if not place.parent.is_dir():
            continue  # its folder was left out
        if found.st_uid != owner:
            left.append((path, f"it belongs to user {found.st_uid}"))
        elif stat.S_ISLNK(found.st_mode) or system.others_may(found):
            left.append((path, "others may have written it"))
        elif stat.S_ISDIR(found.st_mode):
            place.mkdir()
        else:
            place.symlink_to(path)
    return left


def drop_stale() -> int:
    """Remove the index files of outdated kernels; return their number.

    Every process starts with this, so source files are read only if one is newer than a kernel.
    Kernels that are nevertheless up to date get the present time stamp, so that they are not
    checked again, except those that another tree shares by a hard link: its sources may differ.
    """
    own = os.environ.get("NUMBA_CACHE_DIR")
    roots = [Path(own)] if own else [PACKAGE / room for room in ROOMS]
    now_ns = time.time_ns()  # file times use the wall clock
    sources = (one for room in ROOMS for one in _files(PACKAGE / room, ".py"))
    last_change_ns = max(one.stat().st_mtime_ns for one in sources)
    newest: dict[tuple[str, str], int] = {}
    dropped = 0
    for index in (one for root in roots for one in _files(root, ".nbi")):
        try:
            found = index.stat()
            if found.st_mtime_ns >= last_change_ns:
                continue
            newest = newest or newest_sources_ns()
            if found.st_mtime_ns < newest.get(_kernel_file(Path(index.path)), 0):
                os.unlink(index.path)
                dropped += 1
            elif found.st_nlink == 1:
                os.utime(index.path, ns=(now_ns, now_ns), follow_symlinks=False)
        except OSError:
            continue  # another process was faster, or this one may not clean the cache
    return dropped


def _files(folder: Path | str, suffix: str) -> Iterator[os.DirEntry[str]]:
    """Yield the files below a folder with this suffix; none if the folder does not exist. Every
    process does this as it starts; it takes a third of the time of Path.rglob."""
    with suppress(OSError), os.scandir(folder) as entries:
        for one in entries:
            if one.is_dir(follow_symlinks=False):
                yield from _files(one.path, suffix)
            elif one.name.endswith(suffix):
                yield one


def load_lightly() -> None:
    """Make numba load its type support, such as that for cffi, only when it compiles, not when it
    loads a kernel from disk, and assume that scipy.linalg exists. Call it before the first kernel
    is called; it imports numba.

    Otherwise core and gateway need 0.4 s more CPU time to start. scipy is a dependency; a kernel
    that multiplies matrices imports what it needs when it runs.
    """
    from numba.core import caching
    from numba.core.runtime import rtsys
    from numba.np import linalg

    def load_overload(self: Any, signature: Any, target: Any) -> Any:
        rtsys.initialize(target)
        return self._load_overload(signature, target)

    caching.Cache.load_overload = load_overload
    linalg.ensure_blas = linalg.ensure_lapack = lambda: None
