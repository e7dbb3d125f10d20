"""Compiled kernels on disk that are older than what went into them are thrown away.

numba keeps a kernel's machine code as long as the kernel's own file is unchanged. A kernel that
calls another file's kernel, or reads a constant or a record layout from there, would stay as it
was when that file changes. `drop_stale` follows the imports and removes what is out of date.

A cached kernel is a pickle: whoever can write one has code run by all who load it. So the services
load kernels that were written at installation, by another user, and that they cannot write
themselves ($NUMBA_CACHE_DIR, see systemd/). `protect` looks at what is there, takes only what
nobody but its owner could have written, and puts it, as links, into a folder of this process
alone; what must be compiled anew goes there too. Both are called before any kernel is loaded.
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
    """Files by module name without "dehyst."."""
    found = {}
    for room in ROOMS:
        for path in sorted((PACKAGE / room).rglob("*.py")):
            parts = path.relative_to(PACKAGE).with_suffix("").parts
            parts = parts[:-1] if parts[-1] == "__init__" else parts
            found[".".join(parts)] = path
    return found


def _imports(text: str, known: dict[str, Path]) -> set[str]:
    """Modules of this package that a file's text imports."""
    found = set()
    for module, names in _FROM.findall(text):
        found.add(module)
        found |= {f"{module}.{name}" for name in re.findall(r"\w+", names)}
    return {name for name in found if name in known}


def newest_sources_ns() -> dict[tuple[str, str], int]:
    """By folder and file name: when it, or what it imports directly or not, last changed."""
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
    """Folder and file name of the kernel that an index belongs to: numba keeps it in __pycache__
    beside the file, or in $NUMBA_CACHE_DIR in a folder named FOLDER_HASH."""
    folder = index.parent
    beside = folder.name == "__pycache__"
    room = folder.parent.name if beside else folder.name.rpartition("_")[0]
    return room, index.name.partition(".")[0]


def protect() -> list[str]:
    """Where $NUMBA_CACHE_DIR is not this user's own and closed to others: a private view of it, and
    what was left out, for the user."""
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
    """Link what can be trusted below `root` into `view`; what cannot, and why."""
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
    """Remove index files of out-of-date kernels; how many there were.

    Every process begins with this, so files are read only where one is newer than a kernel; kernels
    that are found good nevertheless are marked as looked at: they become as new as this look, but
    for those that another tree shares by a hard link, whose sources may be others.
    """
    own = os.environ.get("NUMBA_CACHE_DIR")
    roots = [Path(own)] if own else [PACKAGE / room for room in ROOMS]
    now_ns = time.time_ns()  # files are dated by the wall clock
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
            continue  # another process was faster, or the cache is not ours to clean
    return dropped


def _files(folder: Path | str, suffix: str) -> Iterator[os.DirEntry[str]]:
    """Files below a folder with this suffix; none where there is no such folder. Every process
    looks for them as it starts: a third of the time that Path.rglob takes."""
    with suppress(OSError), os.scandir(folder) as entries:
        for one in entries:
            if one.is_dir(follow_symlinks=False):
                yield from _files(one.path, suffix)
            elif one.name.endswith(suffix):
                yield one


def load_lightly() -> None:
    """From now on numba takes in all that it can compile, cffi among it, when it compiles, and not
    before it loads a kernel that is on disk; and takes it for granted that scipy.linalg is there.
    Before the first kernel is called; imports numba.

    Else core and gateway take 0.4 s of a processor more to start. scipy is a dependency; a kernel
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
