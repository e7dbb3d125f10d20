"""Makes zenoh usable in a process that was forked from one that had used it.

zenoh's threads do not exist in the child, and the library waits for them forever: opening a session
there never returns. Objects made before the fork are therefore left untouched in the child, even
when the child ends, and the library is loaded again from a copy in memory: the dynamic linker
treats another file as another library, with its own threads.
"""

import ctypes
import importlib
import importlib.machinery
import importlib.util
import sys
import weakref
from types import ModuleType
from typing import Any, Protocol

from dehyst.drivers import system

NATIVE = "zenoh.zenoh"


class LibrarySession(Protocol):
    """Something that holds objects of the library."""

    def of_the_library(self) -> list[Any]: ...


_sessions: "weakref.WeakSet[Any]" = weakref.WeakSet()
_stale = False


def keep_from_children(session: LibrarySession) -> None:
    """Leave this session's objects untouched in a forked child."""
    _sessions.add(session)


def usable_library(present: ModuleType) -> ModuleType:
    """Return the library that this process can use: the loaded one, or a fresh copy after a fork.
    Raises OSError if there is no memory for it."""
    global _stale
    if not _stale:
        return present
    native = sys.modules[NATIVE].__file__ or ""
    with open(native, "rb") as file:
        content = file.read()
    with system.anonymous_file("zenoh", content) as path:
        for name in [name for name in sys.modules if name.partition(".")[0] == "zenoh"]:
            _never_freed(sys.modules.pop(name))
        finder = _Finder(path)
        sys.meta_path.insert(0, finder)
        try:
            fresh = importlib.import_module("zenoh")
        finally:
            sys.meta_path.remove(finder)
    sys.modules[NATIVE].__file__ = native  # source of the next copy
    _stale = False
    return fresh


class _Finder:
    """Finds the native part of the library at a path."""

    def __init__(self, path: str) -> None:
        self.path = path

    def find_spec(
        self, name: str, path: object = None, target: object = None
    ) -> importlib.machinery.ModuleSpec | None:
        """Return the copy's spec if the native part is requested."""
        if name != NATIVE:
            return None
        loader = importlib.machinery.ExtensionFileLoader(name, self.path)
        return importlib.util.spec_from_file_location(name, self.path, loader=loader)


def _never_freed(thing: Any) -> None:
    ctypes.pythonapi.Py_IncRef(ctypes.py_object(thing))


def _in_child() -> None:
    global _stale
    if NATIVE not in sys.modules:
        return
    _stale = True
    for session in _sessions:
        for thing in session.of_the_library():
            _never_freed(thing)


system.in_forked_child(_in_child)
