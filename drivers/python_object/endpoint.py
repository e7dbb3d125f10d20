"""A method or an attribute of an object, found by name, with one interface to write or read it."""

import inspect
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from dehyst.drivers.interface import DriverConfigError, ProtocolError


def setter(owner: Any, name: str, arguments: Sequence[Any]) -> Callable[[float], None]:
    """Return a function that does `owner.name(*arguments, number)` or `owner.name = number`.

    Raises DriverConfigError if nothing has this name.
    """
    holder, last = _find(owner, name)
    if not _is_attribute(holder, last):
        method = _method(holder, last, name)
        return lambda value: _no_coroutine(method(*arguments, value), name)
    if arguments:
        raise DriverConfigError(f"python: {name} is an attribute and takes no arguments")
    return lambda value: setattr(holder, last, value)


def getter(owner: Any, name: str, arguments: Sequence[Any]) -> Callable[[], Any]:
    """Return a function that reads `owner.name(*arguments)` or `owner.name`. Raises as `setter`."""
    holder, last = _find(owner, name)
    if not _is_attribute(holder, last):
        method = _method(holder, last, name)
        return lambda: method(*arguments)
    if arguments:
        raise DriverConfigError(f"python: {name} is an attribute and takes no arguments")
    return lambda: getattr(holder, last)


def one_number_of(value: Any, name: str) -> float:
    """Return the number, or the only number in a list, an array or a table by axes; NaN stays NaN.

    Raises ProtocolError for anything else.
    """
    found = value
    if isinstance(found, Mapping):
        found = list(found.values())
    if hasattr(found, "tolist"):  # a numpy number or array
        found = found.tolist()
    while isinstance(found, list | tuple) and len(found) == 1:
        found = found[0]
    if isinstance(found, bool) or not isinstance(found, int | float):
        if inspect.iscoroutine(found):
            found.close()  # otherwise it would be reported as never awaited
        raise ProtocolError(f"python: {name} returned {value!r:.80}, which is not one number")
    return float(found)


def _find(owner: Any, name: str) -> tuple[Any, str]:
    """Return the object that holds the last part of a dotted name, and that part."""
    *path, last = name.split(".")
    for part in path:
        owner = getattr(owner, part, None)
    if owner is None or (not hasattr(type(owner), last) and not hasattr(owner, last)):
        raise DriverConfigError(f"python: the object has no {name}")
    return owner, last


def _is_attribute(holder: Any, last: str) -> bool:
    """Return whether it is set and read, not called. A property is not read to find this out,
    because that may query the unit."""
    of_type = inspect.getattr_static(type(holder), last, None)
    if of_type is not None and inspect.isdatadescriptor(of_type):
        return True
    return not callable(getattr(holder, last))


def _method(holder: Any, last: str, name: str) -> Callable[..., Any]:
    method: Callable[..., Any] = getattr(holder, last)
    if inspect.iscoroutinefunction(method):
        raise DriverConfigError(
            f"python: {name} is asynchronous; choose a method that returns when it is done"
        )
    return method


def _no_coroutine(result: Any, name: str) -> None:
    """Raise ProtocolError for a coroutine: not started, so the write would never happen."""
    if inspect.iscoroutine(result):
        result.close()
        raise ProtocolError(
            f"python: {name} is asynchronous and wrote nothing; choose a method that returns when "
            "it is done"
        )
