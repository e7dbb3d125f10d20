"""Compiled kernels on disk that are older than what went into them are thrown away.

numba keeps a kernel's machine code as long as the kernel's own file is unchanged. A kernel that
calls another file's kernel, or reads a constant or a record layout from there, would stay as it
was when that file changes. `drop_stale` follows the imports and removes what is out of date; it is
called before any kernel is loaded.
"""

import os
import re
from functools import cache
from pathlib import Path

PACKAGE = Path(__file__).resolve().parent.parent
ROOMS = ("models", "drivers", "daemon")
_FROM = re.compile(r"^from dehyst\.([\w.]+) import (\([^)]*\)|[^\n]*)", re.MULTILINE)


def _sources() -> dict[str, Path]:
    """Files by module name without "dehyst."."""
    found = {}
    for room in ROOMS:
        for path in sorted((PACKAGE / room).rglob("*.py")):
            parts = path.relative_to(PACKAGE).with_suffix("").parts
            found[".".join(parts)] = path
    return found


def _imports(text: str, known: dict[str, Path]) -> set[str]:
    """Modules of this package that a file's text imports."""
    found = set()
    for module, names in _FROM.findall(text):
        found.add(module)
        found |= {f"{module}.{name}" for name in re.findall(r"\w+", names)}
    return {name for name in found if name in known}


def newest_ns() -> dict[str, int]:
    """By file name without ending: when it, or what it imports directly or not, last changed."""
    files = _sources()
    texts = {name: path.read_text(encoding="utf-8") for name, path in files.items()}
    needs = {name: _imports(text, files) for name, text in texts.items()}
    changed = {name: path.stat().st_mtime_ns for name, path in files.items()}

    @cache
    def reach(name: str) -> frozenset[str]:
        seen, todo = {name}, [name]
        while todo:
            for other in needs[todo.pop()] - seen:
                seen.add(other)
                todo.append(other)
        return frozenset(seen)

    newest: dict[str, int] = {}
    for name, path in files.items():
        last = max(changed[other] for other in reach(name))
        newest[path.stem] = max(last, newest.get(path.stem, 0))
    return newest


def drop_stale() -> int:
    """Remove index files of out-of-date kernels; how many there were."""
    own = os.environ.get("NUMBA_CACHE_DIR")
    roots = [Path(own)] if own else [PACKAGE / room for room in ROOMS]
    newest: dict[str, int] = {}
    dropped = 0
    for index in (path for root in roots for path in root.rglob("*.nbi")):
        newest = newest or newest_ns()
        try:
            if index.stat().st_mtime_ns < newest.get(index.name.partition(".")[0], 0):
                index.unlink()
                dropped += 1
        except OSError:
            continue  # another process was faster, or the cache is not ours to clean
    return dropped
