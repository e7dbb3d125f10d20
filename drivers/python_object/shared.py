"""Objects that were made from settings: an amplifier and a sensor of one object share it."""

import importlib
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Any
from weakref import WeakValueDictionary

from dehyst.drivers.interface import DeviceNotFound, DriverConfigError
from dehyst.drivers.python_object.settings import PythonSettings


class SharedObject:
    """calls: held during each call of the object. Making one anew holds another lock, so that
    nobody waits for a unit that is lost."""

    def __init__(self, settings: PythonSettings) -> None:
        self.settings = settings
        self.calls = threading.RLock()
        self._making = threading.Lock()
        self._users: set[int] = set()
        self._made: Any = None

    def connect(self, user: int) -> Any:
        """The object, made where there is none. Raises DriverConfigError for a wrong name,
        DeviceNotFound for whatever the factory raises."""
        with self._making:
            if self._made is None:
                factory = find_factory(self.settings)
                try:
                    self._made = factory(**self.settings.arguments)
                except Exception as error:  # whatever somebody else's code raises
                    raise DeviceNotFound(f"python {self.settings.object}: {words(error)}") from None
                if self._made is None:
                    raise DriverConfigError(f"python: {self.settings.object} returned no object")
            self._users.add(user)
            return self._made

    def drop(self, failed: Any) -> None:
        """A call of this object failed: the next to connect makes one anew."""
        with self._making:
            if self._made is failed and failed is not None:
                self._release()

    def release(self, user: int) -> None:
        """Use it no more; the last user closes it."""
        with self._making:
            self._users.discard(user)
            if not self._users and self._made is not None:
                self._release()

    def _release(self) -> None:
        made, self._made = self._made, None
        if self.settings.close:
            with suppress(Exception):  # the unit may have gone; there is nothing left to release
                getattr(made, self.settings.close)()


_objects: WeakValueDictionary[str, SharedObject] = WeakValueDictionary()
_finding = threading.Lock()


def object_of(settings: PythonSettings) -> SharedObject:
    """The same one for all devices that name the same object with the same arguments."""
    key = repr((settings.object, sorted(settings.arguments.items()), settings.folder))
    with _finding:
        found = _objects.get(key)
        if found is None:
            found = _objects[key] = SharedObject(settings)
        return found


def find_factory(settings: PythonSettings) -> Callable[..., Any]:
    """What makes the object. Raises DriverConfigError."""
    module, _, name = settings.object.partition(":")
    if settings.folder and settings.folder not in sys.path:
        sys.path.append(settings.folder)
    try:
        found: Any = importlib.import_module(module)
        for part in name.split("."):
            found = getattr(found, part)
    except Exception as error:  # an import runs somebody else's code
        raise DriverConfigError(
            f"python: object = {settings.object!r} cannot be had: {words(error)}; install its "
            "package where dehyst is installed, or name its folder with the setting folder"
        ) from None
    if not callable(found):
        raise DriverConfigError(f"python: object = {settings.object!r} cannot be called")
    return found


def words(error: Exception) -> str:
    """An error of somebody else's code in one line."""
    return f"{type(error).__name__}: {' '.join(str(error).split())}".rstrip(": ")
