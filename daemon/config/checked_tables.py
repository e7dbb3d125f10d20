"""Check the tables of a configuration key by key, so that an error is in the user's words: the key
as the file has it, what was written, and what is allowed, with bounds and unit."""

import json
from collections.abc import Mapping
from typing import Any

import msgspec
from msgspec import structs

from dehyst.daemon.config.keys import NOT_WRITTEN, is_table, section_class
from dehyst.daemon.printable import brief
from dehyst.drivers.settings import allowed_words, unit_in_name
from dehyst.models.errors import BadInput


def check_tables(
    kind: type[msgspec.Struct],
    tables: Mapping[str, Any],
    where: str,
    *,
    section: str = "",
    whole: bool = True,
    only: tuple[str, ...] = (),
) -> None:
    """Check every key of `tables` against the section class `kind`. where: file name, and the axis
    if there are several; section: the tables' own name, "" for the top of the file; whole: a key
    without a default must be there; only: the keys that may be there, () for all of `kind`. Raises
    BadInput, which names the first wrong key: unknown ones first, then values, then missing
    ones."""
    fields = {f.name: f for f in structs.fields(kind) if not only or f.name in only}
    known = [key for key in fields if (kind, key) not in NOT_WRITTEN]
    for key in tables:
        if key not in fields:
            raise BadInput(
                f"{where}: unknown key {_joined(section, key)}; known keys "
                f"{f'of [{section}]' if section else 'at top level'}: {', '.join(known)}"
            )
    for key, field in fields.items():
        name = _joined(section, key)
        if key in tables:
            _check_value(field, tables[key], where, name, whole)
        elif whole and field.required:
            raise BadInput(f"{where}: {_missing(field, name)}")


def _check_value(field: structs.FieldInfo, value: Any, where: str, name: str, whole: bool) -> None:
    inner = section_class(field.type)
    if inner is None:
        try:
            msgspec.convert(value, field.type, strict=True)
        except msgspec.ValidationError:
            raise BadInput(
                f"{where}: {name} = {_quoted(value)} must be {_allowed(field)}"
            ) from None
        return
    several = is_table(field.type)
    head = f"{name}.NAME" if several else name
    if several and isinstance(value, dict):
        parts = {_joined(name, part): table for part, table in value.items()}
    else:
        parts = {name: value}
    for own, table in parts.items():
        if not isinstance(table, dict):
            raise BadInput(f"{where}: {own} = {_quoted(table)} must be a table: [{head}]")
        check_tables(inner, table, where, section=own, whole=whole)


def _missing(field: structs.FieldInfo, name: str) -> str:
    inner = section_class(field.type)
    if inner is None:
        return f"the key {name} is missing; it must be {_allowed(field)}"
    needed = ", ".join(f.name for f in structs.fields(inner) if f.required)
    return f"the section [{name}] is missing; it needs {needed}"


def _allowed(field: structs.FieldInfo) -> str:
    unit = unit_in_name(field.name)
    return allowed_words(field) + (f" ({unit})" if unit else "")


def _joined(section: str, key: str) -> str:
    """Return a key as TOML has it: with the name of its section, and in quotes where it needs
    them."""
    bare = key.replace("_", "").replace("-", "")
    shown = key if bare.isascii() and bare.isalnum() else json.dumps(key)
    return f"{section}.{shown}" if section else shown


def _quoted(value: Any) -> str:
    """Return a value as TOML writes it, shortened if it is long."""
    if isinstance(value, dict):
        return "{...}"
    return brief(json.dumps(value, ensure_ascii=False, default=str))
