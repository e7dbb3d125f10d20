"""Converts messages to bytes and back, with msgpack as the format and strict checks by msgspec.

A field that is missing, of another type or out of bounds, a payload that is too long, and anything
that is not msgpack raises BadMessage with the reason; unknown fields are ignored. Nothing is ever
unpickled, and no length stated in a message is used before it has been checked.

Samples are sent in batches, one `bin` field per column: raw little-endian numbers, times as int64
nanoseconds. Any language with a msgpack reader can decode them.
"""

from typing import Any, TypeVar

import msgpack
import msgspec
import numpy as np
from numpy.typing import NDArray

from dehyst.daemon.bus.messages import Chunk, Command, Message, TelemetryBatch
from dehyst.daemon.prepared import resolve_classes
from dehyst.daemon.rings.records import TELEMETRY
from dehyst.models.errors import BadInput

MAX_COMMAND_BYTES = 1 << 20
"""Longest payload that the gateway decodes."""
MAX_ANSWERED_BYTES = 8 << 20
"""Longest payload that reaches the gateway, which refuses it with a reason; the transport drops a
longer one, and its sender gets no answer."""
MAX_BATCH_BYTES = 8 << 20
"""Longest payload that a client decodes."""
ENCODING = "application/msgpack"

T = TypeVar("T")
_SILENT: dict[type[Exception], str] = {
    msgpack.FormatError: "its bytes are not msgpack",
    msgpack.StackError: "its maps or lists are nested too deeply",
}
"""Words for the errors of msgpack that have none."""


def _prepare(kind: type[msgspec.Struct]) -> None:
    for one in kind.__subclasses__():
        resolve_classes(one)
        _prepare(one)


_prepare(Message)


class BadMessage(BadInput):
    """A payload that is not a message of this version; the text states what is wrong with it."""


def encode(message: msgspec.Struct) -> bytes:
    """Return the payload of a message."""
    plain = msgspec.to_builtins(message, builtin_types=(bytes,))
    return bytes(msgpack.packb(plain, use_bin_type=True))


def _decode(kind: Any, payload: bytes, limit: int) -> Any:
    if len(payload) > limit:
        raise BadMessage(f"the message is longer than {limit} bytes, the most that is accepted")
    try:
        plain = msgpack.unpackb(payload, raw=False, strict_map_key=True)
        # msgspec would accept a map without them as the expected class
        if isinstance(plain, dict) and not plain.keys() >= {"schema", "version"}:
            raise ValueError("`schema` and `version` must be named")
        return msgspec.convert(plain, kind, strict=True, builtin_types=(bytes,))
    except (
        msgspec.MsgspecError,
        msgpack.UnpackException,
        ValueError,
        RecursionError,
        OverflowError,
        TypeError,
    ) as error:
        why = str(error) or _SILENT.get(type(error), type(error).__name__)
        raise BadMessage(f"not a message of this version of dehyst: {why}"[:400]) from None


def decode_command(payload: bytes) -> Command:
    """Decode a Setpoint, Chunk or Request. Raises BadMessage."""
    command: Command = _decode(Command, payload, MAX_COMMAND_BYTES)
    if isinstance(command, Chunk):
        points(command)
    return command


def decode(kind: type[T], payload: bytes) -> T:
    """Decode a message of one class. Raises BadMessage."""
    message: T = _decode(kind, payload, MAX_BATCH_BYTES)
    return message


def points(chunk: Chunk) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return (offset_ns, value) of a chunk, both (n,). Raises BadMessage if they do not match."""
    size = len(chunk.value)
    if size != len(chunk.offset_ns) or size % 8 or not size:
        raise BadMessage("offset_ns and value must hold the same number of 8-byte numbers")
    if chunk.correction and len(chunk.correction) != size:
        raise BadMessage("correction must hold as many 8-byte numbers as value, or none")
    return np.frombuffer(chunk.offset_ns, "<i8"), np.frombuffer(chunk.value, "<f8")


def corrections(chunk: Chunk) -> NDArray[np.float64]:
    """Return the (n,) learned corrections of a chunk's points, zeros if it has none."""
    if not chunk.correction:
        return np.zeros(len(chunk.value) // 8)
    return np.frombuffer(chunk.correction, "<f8")


_COLUMNS = [name for name in TELEMETRY.names or () if name != "seq"]


def batch(samples: NDArray[Any], run: int, unit: str, wall_offset_ns: int) -> TelemetryBatch:
    """Return a batch of TELEMETRY records, whose sequence numbers must be consecutive."""
    columns: dict[str, Any] = {
        name: np.ascontiguousarray(samples[name]).tobytes() for name in _COLUMNS
    }
    first = int(samples["seq"][0]) if samples.size else 0
    return TelemetryBatch(
        run=run,
        unit=unit,
        wall_offset_ns=wall_offset_ns,
        first_seq=first,
        count=samples.size,
        **columns,
    )


def samples(message: TelemetryBatch) -> NDArray[Any]:
    """Return (count,) TELEMETRY records. Raises BadMessage if a column has another length."""
    out = np.empty(message.count, TELEMETRY)
    out["seq"] = np.arange(message.first_seq, message.first_seq + message.count)
    for name in _COLUMNS:
        column, dtype = getattr(message, name), TELEMETRY[name]
        if len(column) != message.count * dtype.itemsize:
            raise BadMessage(f"column {name} does not hold {message.count} numbers")
        out[name] = np.frombuffer(column, dtype)
    return out
