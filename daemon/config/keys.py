"""List every configuration key as the classes in dehyst.daemon.config.sections declare it:
section, type, default, and the docstring below the key."""

import ast
import inspect
from dataclasses import dataclass
from functools import cache
from typing import Any, get_args

import msgspec
from msgspec import structs

from dehyst.daemon.config import sections
from dehyst.drivers.settings import SettingKey, allowed_words, unit_in_name

NOT_WRITTEN = ((sections.Config, "axis"),)
"""Keys that no file contains: the daemon sets them."""


@dataclass(frozen=True)
class ConfigSection:
    """One table of the file. title: the text in its brackets, "" for the top of the file; keys:
    all that are not tables; needed: the file must contain it."""

    title: str
    meaning: str
    keys: tuple[SettingKey, ...]
    needed: bool


def list_config() -> list[ConfigSection]:
    """List every section in the order of the file, with every key."""
    return _sections("", sections.Config, needed=True)


def _sections(title: str, kind: type[msgspec.Struct], needed: bool) -> list[ConfigSection]:
    said = _sentences()[kind.__name__]
    own, below = [], []
    for field in structs.fields(kind):
        if (kind, field.name) in NOT_WRITTEN:
            continue
        inner = section_class(field.type)
        if inner is None:
            default = None if field.required else field.default
            if field.default_factory is not msgspec.NODEFAULT:
                default = field.default_factory()
            meaning = said.get(field.name, "")
            key = SettingKey(
                field.name,
                allowed_words(field),
                field.required,
                default,
                unit_in_name(field.name),
                meaning,
            )
            own.append(key)
        else:
            name = f"{field.name}.NAME" if is_table(field.type) else field.name
            inside = f"{title}.{name}" if title else name
            below += _sections(inside, inner, needed and field.required)
    return [ConfigSection(title, said[""], tuple(own), needed), *below]


def is_table(kind: Any) -> bool:
    """Return whether a field's type is a table of sections, as [channels.NAME]."""
    return getattr(kind, "__origin__", None) is dict


def section_class(kind: Any) -> type[msgspec.Struct] | None:
    """Return the section class in a field's type: alone, optional, or as the values of a dict;
    None if there is none."""
    for one in (kind, *get_args(kind)):
        if isinstance(one, type) and issubclass(one, msgspec.Struct):
            return one
    return None


@cache
def _sentences() -> dict[str, dict[str, str]]:
    """Return, by class name, the docstring below each key, and the class' own docstring under "".
    Subclasses include the keys of their bases."""
    found: dict[str, dict[str, str]] = {}
    for node in ast.parse(inspect.getsource(sections)).body:
        if not isinstance(node, ast.ClassDef):
            continue
        said = {k: v for base in node.bases for k, v in found.get(ast.unparse(base), {}).items()}
        said[""] = " ".join((ast.get_docstring(node) or "").split())
        for key, behind in zip(node.body, node.body[1:], strict=False):
            if isinstance(key, ast.AnnAssign) and isinstance(behind, ast.Expr):
                assert isinstance(behind.value, ast.Constant)
                said[ast.unparse(key.target)] = " ".join(str(behind.value.value).split())
        found[node.name] = said
    return found
