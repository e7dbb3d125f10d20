"""Settings of a driver: declared once, validated strictly, listed with their meaning.

A driver declares its settings as a class, one line per key, with the unit in the key's name:

    class MyGaugeSettings(Settings, frozen=True):
        driver = "mygauge"
        port: Annotated[str, Meta(description="path of the serial port")]
        timeout_s: Annotated[float, Meta(gt=0, description="longest wait for a reply")] = 0.1

        def check(self) -> None: ...        # rules between keys: `raise self.wrong("port", ...)`

and makes them with `read_settings(MyGaugeSettings, table)`. The only conversion is from a whole
number to a float. No key is ignored, and NaN and infinity are refused everywhere. An object made in
Python is checked in the same way, so unchecked settings do not exist.
"""

import math
from collections.abc import Mapping
from typing import Any, ClassVar, TypeVar

import msgspec
from msgspec import inspect, structs

from dehyst.drivers.interface import DriverConfigError

UNITS = {"s": "s", "v": "V", "mv": "mV", "um": "um", "hz": "Hz", "k": "K", "decade": "decade"}
UNITS |= {"bits": "bits", "bytes": "bytes", "unit": "unit"}

Kind = TypeVar("Kind", bound="Settings")


class Settings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Base class of all settings. driver: the driver's name in error messages."""

    driver: ClassVar[str] = "driver"

    def __post_init__(self) -> None:
        """Raise DriverConfigError unless every value is allowed."""
        for field in structs.fields(type(self)):
            _checked(type(self), field, getattr(self, field.name))
        self.check()

    def check(self) -> None:
        """Check rules between several keys; a subclass that has such rules overrides it."""

    def wrong(self, key: str, allowed: str) -> DriverConfigError:
        """Return the error for a key that breaks a rule between keys; allowed: e.g. "below
        timeout_s"."""
        return _wrong(type(self), key, getattr(self, key), allowed)


class SettingKey(msgspec.Struct, frozen=True):
    """One setting as it is listed. type: what is allowed, in words; default: None if the key is
    required or has no default value; unit: "" for none."""

    name: str
    type: str
    required: bool
    default: Any
    unit: str
    meaning: str


def read_settings(kind: type[Kind], table: Mapping[str, Any]) -> Kind:
    """Read settings from a configuration table. Raises DriverConfigError with one sentence that
    names the driver, the key, the given value, what is allowed, and the known keys."""
    values = read_values(kind, table)
    for field in structs.fields(kind):
        if field.required and field.name not in values:
            raise DriverConfigError(
                f"{kind.driver}: the setting {field.name} is missing; it must be "
                f"{allowed_words(field)}; {_known(kind)}"
            )
    return kind(**values)


def read_values(kind: type[Settings], table: Mapping[str, Any]) -> dict[str, Any]:
    """Return only the given keys, each checked individually; errors as in read_settings."""
    fields = {field.name: field for field in structs.fields(kind)}
    values = {}
    for key, value in table.items():
        if key not in fields:
            raise DriverConfigError(
                f"{kind.driver}: unknown setting {key!r} (given: {value!r}); {_known(kind)}"
            )
        values[key] = _checked(kind, fields[key], value)
    return values


def list_keys(kind: type[Settings]) -> list[SettingKey]:
    """Return every key in the order of declaration."""
    return [
        SettingKey(
            name=field.name,
            type=allowed_words(field),
            required=field.required,
            default=_default(field),
            unit=unit_in_name(field.name),
            meaning=_plain_type(field)[1],
        )
        for field in structs.fields(kind)
    ]


def _default(field: structs.FieldInfo) -> Any:
    if field.required:
        return None
    made = field.default_factory  # of a table or a list
    return field.default if made is msgspec.NODEFAULT else made()


def unit_in_name(name: str) -> str:
    """Return the unit at the end of a name: "um per V" for scale_um_per_v; "" for none."""
    words = name.split("_")
    unit = ""
    while words and words[-1] in UNITS:
        unit = UNITS[words.pop()] + (f" {unit}" if unit else "")
        if not words or words[-1] != "per":
            break
        words.pop()
        unit = f"per {unit}"
    return unit


def allowed_words(field: structs.FieldInfo) -> str:
    """Return what a key accepts, in words: "a number, above 0 and at most 10". A type that states
    them itself, as one with a pattern does, has them as its title."""
    whole = inspect.type_info(field.type)
    stated = whole.extra_json_schema if isinstance(whole, inspect.Metadata) else None
    return (stated or {}).get("title") or _words(_plain_type(field)[0])


def _checked(kind: type[Settings], field: structs.FieldInfo, value: Any) -> Any:
    if isinstance(value, float):
        value = float(value)  # also turns a numpy float into a plain one
    try:
        value = msgspec.convert(value, field.type)
    except msgspec.ValidationError:
        raise _wrong(kind, field.name, value, allowed_words(field)) from None
    if isinstance(value, float) and not math.isfinite(value):
        raise _wrong(kind, field.name, value, allowed_words(field))
    return value


def _wrong(kind: type[Settings], key: str, value: Any, allowed: str) -> DriverConfigError:
    return DriverConfigError(f"{kind.driver}: {key} = {value!r} must be {allowed}; {_known(kind)}")


def _known(kind: type[Settings]) -> str:
    return f"known settings: {', '.join(field.name for field in structs.fields(kind))}"


def _plain_type(field: structs.FieldInfo) -> tuple[inspect.Type, str]:
    """Return the type, without None and without its description, and the description."""
    found = inspect.type_info(field.type)
    if isinstance(found, inspect.UnionType):
        some = tuple(t for t in found.types if not isinstance(t, inspect.NoneType))
        found = some[0] if len(some) == 1 else inspect.UnionType(some)
    if isinstance(found, inspect.Metadata):
        return found.type, (found.extra_json_schema or {}).get("description", "")
    return found, ""


def _words(kind: inspect.Type) -> str:
    match kind:
        case inspect.BoolType():
            return "true or false"
        case inspect.LiteralType(values=values):
            *first, last = [f'"{v}"' if isinstance(v, str) else str(v) for v in values]
            return " or ".join([*([", ".join(first)] if first else []), last])
        case inspect.IntType():
            return "a whole number" + _range(kind)
        case inspect.FloatType():
            return "a number" + _range(kind)
        case inspect.StrType(min_length=least):
            return "a string" + (" that is not empty" if least else "")
        case inspect.UnionType(types=types):
            return ", or ".join(_words(t) for t in types)
        case inspect.VarTupleType(item_type=inspect.StrType()):
            return "a list of strings"
        case inspect.VarTupleType():
            return "a list of strings and numbers"
        case inspect.DictType():
            return "a table"
        case _:
            return type(kind).__name__.removesuffix("Type").lower()


def _range(kind: inspect.IntType | inspect.FloatType) -> str:
    if kind.ge is not None and kind.le is not None:
        return f" from {kind.ge:g} to {kind.le:g}"
    ends = [f"above {kind.gt:g}"] if kind.gt is not None else []
    ends += [f"at least {kind.ge:g}"] if kind.ge is not None else []
    ends += [f"below {kind.lt:g}"] if kind.lt is not None else []
    ends += [f"at most {kind.le:g}"] if kind.le is not None else []
    return f", {' and '.join(ends)}" if ends else ""
