"""The contract of the bus: schemas and bytes as committed, and messages of other versions."""

import json
import math
from pathlib import Path
from typing import Any

import msgpack
import msgspec
import pytest

from dehyst.daemon.bus import contract, encoding, messages

SCHEMAS = Path(__file__).resolve().parents[3] / "docs" / "schemas"
KINDS = {contract.name_of_message(kind): kind for kind in contract.MESSAGES}


def vectors(name: str) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = json.loads((SCHEMAS / name).read_text())["vectors"]
    return found


EVERY = [
    pytest.param(one, id=f"{name}-{one['name']}")
    for name in ("vectors.json", "vectors-0.1.0.json")
    for one in vectors(name)
]


def plain(value: Any) -> Any:
    """Return the builtins of JSON, as the vectors write them."""
    if isinstance(value, bytes):
        return {"bin": value.hex()}
    if isinstance(value, dict):
        return {key: plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [plain(one) for one in value]
    if isinstance(value, float) and not math.isfinite(value):
        return {"float": str(value)}
    return value


def is_within(wanted: Any, found: Any) -> bool:
    """Return whether everything that is wanted was found; further fields are ignored."""
    if isinstance(wanted, dict):
        return isinstance(found, dict) and all(
            key in found and is_within(value, found[key]) for key, value in wanted.items()
        )
    if isinstance(wanted, list):
        return len(wanted) == len(found) and all(map(is_within, wanted, found))
    return bool(wanted == found)


def test_the_schemas_are_those_of_the_code() -> None:
    made = contract.schemas()
    committed = {p.stem: json.loads(p.read_text()) for p in SCHEMAS.glob("dehyst.*.json")}
    assert made == committed, "run: python -m dehyst.daemon.bus.contract docs/schemas"


def test_every_field_has_a_meaning_and_every_bin_its_numbers() -> None:
    inner = (messages.GatewayStatus, messages.FoundEffect, messages.ModelOffer)
    for kind in (*contract.MESSAGES, *inner):
        for field in msgspec.structs.fields(kind):
            if field.name != "version":
                assert contract.meaning_of(kind, field.name), (kind.__name__, field.name)


@pytest.mark.parametrize("vector", EVERY)
def test_recorded_bytes_are_read_and_mean_what_they_meant(vector: dict[str, Any]) -> None:
    payload, means = bytes.fromhex(vector["hex"]), vector["means"]
    message = encoding.decode(KINDS[means["schema"]], payload)
    again = plain(msgpack.unpackb(encoding.encode(message)))  # type: ignore[arg-type]
    assert is_within(means, again)


def with_more(value: Any, more: Any) -> Any:
    """Return the message of a later version: one more field in every map."""
    if isinstance(value, dict):
        return {key: with_more(one, more) for key, one in value.items()} | {"of_later": more}
    if isinstance(value, list):
        return [with_more(one, more) for one in value]
    return value


@pytest.mark.parametrize("vector", EVERY)
@pytest.mark.parametrize("more", [None, 3, "x", b"\x00", [1, {"a": 2}]], ids=repr)
def test_fields_of_later_versions_are_passed_over(vector: dict[str, Any], more: Any) -> None:
    now = msgpack.unpackb(bytes.fromhex(vector["hex"]))
    later = with_more(now, more)
    if "rejected" in str(now.keys()) or now["schema"] == "dehyst.status":
        later["gateway"]["rejected"] = now["gateway"]["rejected"]  # a map of names to numbers
        later["missed_by"] = now["missed_by"]
    later["version"] = now["version"] + 5
    kind = KINDS[now["schema"]]
    message = encoding.decode(kind, msgpack.packb(later))
    again = plain(msgpack.unpackb(encoding.encode(message)))  # type: ignore[arg-type]
    assert is_within({**vector["means"], "version": now["version"] + 5}, again)


def test_a_field_that_was_added_has_a_default_and_raised_the_version() -> None:
    for vector in vectors("vectors-0.1.0.json"):
        kind, before = KINDS[vector["means"]["schema"]], set(vector["means"])
        fields = {field.name: field for field in msgspec.structs.fields(kind)}
        added = set(fields) - before
        assert before - {"schema"} <= set(fields), "a field is gone: that breaks readers"
        assert not any(fields[name].required for name in added)
        if added:
            assert fields["version"].default > vector["means"]["version"], vector["name"]


def test_what_is_needed_is_still_needed() -> None:
    """Compatibility is not laxity: a known field that is missing or of another type is refused."""
    good = msgpack.unpackb(bytes.fromhex(vectors("vectors.json")[0]["hex"]))
    for bad in ({**good, "value": "4.5"}, {k: v for k, v in good.items() if k != "value"}):
        with pytest.raises(encoding.BadMessage):
            encoding.decode_command(msgpack.packb(bad))
    for version in (0, -1, "1", 1.5, None):
        with pytest.raises(encoding.BadMessage):
            encoding.decode_command(msgpack.packb({**good, "version": version}))
