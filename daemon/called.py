"""The wrapper of every function of `import dehyst`: it checks the arguments, and names parameters
in error messages."""

import inspect
import os
import types
from collections.abc import Callable, Mapping, Sequence
from functools import cache, wraps
from pathlib import Path
from typing import Any, NamedTuple, ParamSpec, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import ArrayLike

from dehyst.daemon.option_words import in_callers_words
from dehyst.daemon.printable import NO_FILE_NAME, brief
from dehyst.models.errors import BadInput, DehystError

P = ParamSpec("P")
R = TypeVar("R")


def python_function(work: Callable[P, R]) -> Callable[P, R]:
    """Wrap a function of the API. An argument that is not of the type that its parameter declares
    raises BadInput with the parameter's name, and every DehystError names parameters where the
    command line would name options."""

    signature = inspect.signature(work)

    @wraps(work)
    def checked(*args: P.args, **more: P.kwargs) -> R:
        try:
            given = signature.bind(*args, **more)
        except TypeError:  # an unknown or a missing parameter
            return work(*args, **more)
        for name, value in given.arguments.items():
            if name in _hints(work):
                given.arguments[name] = _checked(name, value, _hints(work)[name])
        try:
            return work(*given.args, **given.kwargs)
        except DehystError as error:
            said = in_callers_words(str(error), work.__name__)
            if said != str(error):
                error.args = (said, *error.args[1:])
            raise

    return checked


@cache
def _hints(work: Callable[..., Any]) -> dict[str, tuple[Any, ...]]:
    """Return the types that each parameter takes, without the parameters that take anything."""
    found = {}
    for name, hint in get_type_hints(work).items():
        union = hint not in TAKES and get_origin(hint) in (Union, types.UnionType)
        kinds = tuple(
            one if one in TAKES else get_origin(one)
            for one in (get_args(hint) if union else (hint,))
        )
        if name != "return" and all(kind in TAKES for kind in kinds):
            found[name] = kinds
    return found


def _checked(name: str, value: Any, kinds: tuple[Any, ...]) -> Any:
    """Return the value as one of these types. Raises BadInput."""
    if isinstance(value, np.generic) or (isinstance(value, np.ndarray) and value.ndim == 0):
        value = value.item()
    if not any(TAKES[kind].takes(value) for kind in kinds):
        allowed = ", or ".join(TAKES[kind].words for kind in kinds)
        raise BadInput(f"{name}={brief(repr(value))}: must be {allowed}")
    if name == "path" and isinstance(value, str) and value.endswith("/"):
        raise BadInput(f"{name}={brief(repr(value))}: {NO_FILE_NAME}")
    return value


class Takes(NamedTuple):
    """What a parameter of one type takes. words: for messages; takes: whether it takes a value."""

    words: str
    takes: Callable[[Any], bool]


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _are_numbers(values: Any) -> bool:
    try:
        return not np.iscomplexobj(values) and np.asarray(values, np.float64).ndim > 0
    except (TypeError, ValueError, OverflowError):
        return False


def _are_strings(values: Any) -> bool:
    return all(isinstance(one, str) for one in values)


TAKES: dict[Any, Takes] = {
    bool: Takes("True or False", lambda value: isinstance(value, bool)),
    int: Takes("a whole number", lambda v: isinstance(v, int) and not isinstance(v, bool)),
    float: Takes("a number", _is_number),
    str: Takes("a string", lambda value: isinstance(value, str)),
    Path: Takes("a path", lambda value: isinstance(value, os.PathLike)),
    type(None): Takes("None", lambda value: value is None),
    tuple[str, str]: Takes(
        "two strings, such as ('v', 'um')",
        lambda v: isinstance(v, tuple | list) and len(v) == 2 and _are_strings(v),
    ),
    Sequence[str]: Takes(
        "a list of strings", lambda v: isinstance(v, Sequence) and _are_strings(v)
    ),
    Mapping: Takes(
        "a dict keyed by name", lambda value: isinstance(value, Mapping) and _are_strings(value)
    ),
    Callable: Takes("a function", callable),
    ArrayLike: Takes("numbers, one for each point", _are_numbers),
}
