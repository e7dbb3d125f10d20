"""Objects made from settings; an amplifier and a sensor on one object share it."""

import importlib
import sys
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from dehyst.drivers.interface import DeviceNotFound, DriverConfigError
from dehyst.drivers.python_object.settings import PythonSettings
from dehyst.drivers.shared import Shared, shared_by


def object_of(settings: PythonSettings) -> Shared:
    """Return the Shared of all devices that name the same object with the same arguments.
    Connecting raises DriverConfigError for a wrong name, DeviceNotFound for whatever the factory
    raises."""
    key = repr(("python", settings.object, sorted(settings.arguments.items()), settings.folder))

    def make() -> Any:
        factory = find_factory(settings)
        try:
            made = factory(**settings.arguments)
        except Exception as error:  # whatever other people's code raises
            raise DeviceNotFound(f"python {settings.object}: {describe_error(error)}") from None
        if made is None:
            raise DriverConfigError(f"python: {settings.object} returned no object")
        return made

    def release(made: Any) -> None:
        if settings.close:
            with suppress(Exception):  # the unit may have gone; nothing is left to release
                getattr(made, settings.close)()

    return shared_by(key, make, release)


def find_factory(settings: PythonSettings) -> Callable[..., Any]:
    """Return the function that makes the object. Raises DriverConfigError."""
    module, _, name = settings.object.partition(":")
    if settings.folder and settings.folder not in sys.path:
        sys.path.append(settings.folder)
    try:
        found: Any = importlib.import_module(module)
        for part in name.split("."):
            found = getattr(found, part)
    except Exception as error:  # an import runs other people's code
        raise DriverConfigError(
            f"python: object = {settings.object!r} cannot be imported: {describe_error(error)}; "
            "install its package next to dehyst, or give its folder with the setting folder"
        ) from None
    if not callable(found):
        raise DriverConfigError(f"python: object = {settings.object!r} cannot be called")
    return found


def describe_error(error: Exception) -> str:
    """Return an error of other people's code as one line."""
    return f"{type(error).__name__}: {' '.join(str(error).split())}".rstrip(": ")
