"""Builds and parses the key expressions of the bus; no other module does.

    {base}/@v1/{name}/pubsub/{subject}/{source}   published: telemetry, status, set-points ...
    {base}/@v1/{name}/rpc/{method}                asked and answered: commands, model, history ...
    {base}/@v1/{name}/alive                       liveliness token of a running gateway

`name` is the controller; `source` is the publisher (the daemon, or a client's number). The grammar
follows keelson's. `@v1` is the version of the grammar and of the messages: zenoh matches a chunk
that begins with @ only verbatim, so `dehyst/**` does not match it and a subscriber must name the
version that it understands.
"""

import re
from dataclasses import dataclass

from dehyst.models.errors import BadInput

VERSION = "@v1"
OLDER = ("@v0",)
"""Versions that are answered only with a message. @v0 belongs to dehyst 0.1.0, whose readers refuse
unknown fields."""
DAEMON = "daemon"
"""The `source` of everything that the daemon itself publishes."""

_CHUNK = re.compile(r"[a-z0-9_-]{1,63}")
_METHODS = ("command", "status", "model", "configuration", "history", "events", "doctor", "report")


@dataclass(frozen=True)
class ParsedKey:
    """One parsed key. space: "pubsub", "rpc" or "alive"; subject and source are "" if the space has
    none (for rpc, subject is the method)."""

    name: str
    space: str
    subject: str = ""
    source: str = ""


@dataclass(frozen=True)
class Keys:
    """The keys of one controller. base: first chunks; name: the controller, or "*" for all."""

    base: str
    name: str

    def __post_init__(self) -> None:
        for chunk in self.base.split("/"):
            _check(chunk, "the base of the keys")
        if self.name != "*":
            _check(self.name, "a controller's name")

    @property
    def root(self) -> str:
        """Return the prefix of all keys of this controller."""
        return f"{self.base}/{VERSION}/{self.name}"

    def pubsub(self, subject: str, source: str = DAEMON) -> str:
        """Return the key of a published subject; "*" as source: from any publisher."""
        return f"{self.root}/pubsub/{_check(subject, 'a subject')}/{_wild(source)}"

    def setpoints(self) -> str:
        """Return the key expression of set-points in every unit from every client."""
        return f"{self.root}/pubsub/setpoint_$*/*"

    def rpc(self, method: str) -> str:
        """Return the key of a method; "*": all of them."""
        if method != "*" and method not in _METHODS:
            raise BadInput(f"rpc {method!r}: the methods are {', '.join(_METHODS)}")
        return f"{self.root}/rpc/{method}"

    def alive(self) -> str:
        """Return the key of the liveliness token."""
        return f"{self.root}/alive"

    def older(self) -> list[tuple[str, str]]:
        """Return (liveliness token, key expression of all queries) of this controller for each
        older version."""
        roots = [f"{self.base}/{version}/{self.name}" for version in OLDER]
        return [(f"{root}/alive", f"{root}/rpc/*") for root in roots]

    def parse(self, key: str) -> ParsedKey:
        """Return the parts of a key under the same base. Raises BadInput for anything else."""
        prefix = f"{self.base}/{VERSION}/"
        if not key.startswith(prefix) or len(key) > 500:
            raise BadInput(f"key {key[:80]!r}: does not begin with {prefix}")
        match key[len(prefix) :].split("/"):
            case [name, "pubsub", subject, source]:
                parsed = ParsedKey(name, "pubsub", subject, source)
            case [name, "rpc", method]:
                parsed = ParsedKey(name, "rpc", method)
            case [name, "alive"]:
                parsed = ParsedKey(name, "alive")
            case _:
                raise BadInput(f"key {key[:80]!r}: not in the grammar NAME/pubsub/SUBJECT/SOURCE")
        for chunk in (parsed.name, parsed.subject, parsed.source):
            if chunk:
                _check(chunk, "a chunk of a key")
        return parsed


def _check(chunk: str, what: str) -> str:
    if not _CHUNK.fullmatch(chunk):
        raise BadInput(
            f"{what} may hold a-z, 0-9, _ and -, up to 63 characters, not {chunk[:80]!r}"
        )
    return chunk


def _wild(chunk: str) -> str:
    return chunk if chunk == "*" else _check(chunk, "a source")
