"""Messages are plain msgpack for other programs and strictly validated here; any payload is a
message or raises BadMessage."""

import pickle
import random

import msgpack
import msgspec
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from dehyst.daemon.bus import encoding, messages
from dehyst.daemon.rings.records import TELEMETRY

ID = st.integers(0, 2**63 - 1)
SETPOINT = st.builds(
    messages.Setpoint,
    client=st.integers(1, 2**63 - 1),
    lease=ID,
    sequence=ID,
    sent_ns=st.integers(-(2**63), 2**63 - 1),
    value=st.floats(),
    unit=st.text(max_size=16),
    allow_unreachable=st.booleans(),
)
LEAF = st.one_of(
    st.none(), st.booleans(), st.integers(-(2**63), 2**64 - 1), st.floats(), st.text(), st.binary()
)
ANY = st.recursive(
    LEAF, lambda c: st.lists(c, max_size=6) | st.dictionaries(st.text(max_size=9), c, max_size=6)
)


def chunk(offsets: np.ndarray, values: np.ndarray, **more: object) -> messages.Chunk:
    fields: dict = {
        "client": 1, "lease": 2, "trajectory": 3, "index": 0, "sent_ns": 0, "unit": "um",
        "offset_ns": offsets.astype("<i8").tobytes(), "value": values.astype("<f8").tobytes(),
    }  # fmt: skip
    return messages.Chunk(**(fields | more))


@given(SETPOINT)
def test_setpoint_round_trip_and_plain_msgpack(message: messages.Setpoint) -> None:
    payload = encoding.encode(message)
    assert encoding.encode(encoding.decode_command(payload)) == payload
    plain = msgpack.unpackb(payload)  # another library reads the same
    assert plain["schema"] == "dehyst.setpoint"
    assert plain["version"] >= 1
    assert plain["sequence"] == message.sequence
    assert encoding.encode(encoding.decode_command(msgpack.packb(plain))) == payload


@given(npst.arrays(TELEMETRY, st.integers(0, 50)))
def test_telemetry_keeps_every_bit(samples: np.ndarray) -> None:
    samples["seq"] = 1000 + np.arange(samples.size)
    payload = encoding.encode(encoding.batch(samples, 7, "um", -5))
    message = encoding.decode(messages.TelemetryBatch, payload)
    assert encoding.samples(message).tobytes() == samples.tobytes() or not samples.size
    plain = msgpack.unpackb(payload)  # as a program in another language reads it
    assert np.array_equal(np.frombuffer(plain["volts"], "<f8"), samples["volts"], equal_nan=True)


@given(st.binary(max_size=400))
@example(b"\xdd\xff\xff\xff\xff")  # an array of 4 billion
@example(b"\xdf\xff\xff\xff\xff")  # a map of 4 billion
@example(b"\xc6\xff\xff\xff\xff")  # 4 GB of bytes
@example(b"\x91" * 400)
@example(b"\x81\xa6schema" * 40)
@example(pickle.dumps(random.Random()))
@example(b"\x80")  # an empty map: without a schema it does not request the whole history
@example(msgpack.packb({"version": 1, "seconds": 1.0}))
@example(msgpack.packb({"schema": "dehyst.history"}))
def test_arbitrary_bytes_are_refused(payload: bytes) -> None:
    with pytest.raises(encoding.BadMessage):
        encoding.decode_command(payload)
    for kind in (messages.TelemetryBatch, messages.Status, messages.HistoryRequest):
        with pytest.raises(encoding.BadMessage):
            encoding.decode(kind, payload)


def test_deep_nesting_is_refused() -> None:
    for bomb in (b"\x91" * 900_000, b"\x81\xa1a" * 300_000):
        with pytest.raises(encoding.BadMessage):
            encoding.decode_command(bomb)


@given(ANY)
def test_arbitrary_objects_are_refused(value: object) -> None:
    with pytest.raises(encoding.BadMessage):
        encoding.decode_command(msgpack.packb(value))


@settings(max_examples=300)
@given(SETPOINT, st.data())
def test_one_field_replaced_is_a_message_or_refused(
    message: messages.Setpoint, data: st.DataObject
) -> None:
    plain = msgpack.unpackb(encoding.encode(message))
    key = data.draw(st.sampled_from(sorted(plain)))
    plain[key] = data.draw(ANY)
    try:
        decoded = encoding.decode_command(msgpack.packb(plain))
    except encoding.BadMessage:
        return
    assert isinstance(decoded, messages.Setpoint)
    assert isinstance(decoded.value, float)
    assert 0 <= decoded.client < 2**63


@given(st.binary(min_size=1, max_size=3), st.integers(0, 10_000), SETPOINT)
def test_damaged_bytes_are_a_message_or_refused(
    damage: bytes, at: int, message: messages.Setpoint
) -> None:
    payload = bytearray(encoding.encode(message))
    at %= len(payload)
    payload[at : at + len(damage)] = damage
    try:
        encoding.decode_command(bytes(payload))
    except encoding.BadMessage:
        return


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"version": 0}, "version"),
        ({"schema": "dehyst.telemetry"}, "schema"),
        ({"value": "1"}, "value"),
        ({"client": -1}, "client"),
        ({"client": 2**63}, "client"),
        ({"unit": "x" * 17}, "unit"),
        ({"allow_unreachable": 1}, "allow_unreachable"),
    ],
)
def test_what_is_wrong_is_named(change: dict, says: str) -> None:
    good = messages.Setpoint(client=1, lease=2, sequence=3, sent_ns=4, value=5.0, unit="um")
    payload = msgpack.packb(msgpack.unpackb(encoding.encode(good)) | change)
    with pytest.raises(encoding.BadMessage, match=says):
        encoding.decode_command(payload)


@pytest.mark.parametrize(
    ("good", "field"),
    [
        (messages.Setpoint(client=1, lease=2, sequence=3, sent_ns=4, value=5.0, unit=""), "client"),
        (messages.Request(client=1, lease=2, sent_ns=4, action="acquire"), "client"),
        (messages.Request(client=1, lease=2, sent_ns=4, action="stop"), "client"),
        (chunk(np.arange(3), np.zeros(3)), "client"),
        (chunk(np.arange(3), np.zeros(3)), "trajectory"),
    ],
)
def test_a_number_that_the_sender_chooses_is_never_0(good: msgspec.Struct, field: str) -> None:
    """It is a bad message: no lease and no order would make it a good one."""
    encoding.decode_command(encoding.encode(good))
    payload = msgpack.packb(msgpack.unpackb(encoding.encode(good)) | {field: 0})
    with pytest.raises(encoding.BadMessage, match=rf">= 1 .*{field}"):
        encoding.decode_command(payload)


@pytest.mark.parametrize("version", [0, -2, 1.0, "1", None])
@pytest.mark.parametrize(
    "good",
    [
        messages.Setpoint(client=1, lease=2, sequence=3, sent_ns=4, value=5.0, unit="um"),
        chunk(np.arange(3), np.zeros(3)),
        messages.Request(client=1, lease=2, sent_ns=4, action="stop"),
    ],
    ids=["setpoint", "chunk", "request"],
)
def test_a_command_whose_version_is_none_is_refused(good: msgspec.Struct, version: object) -> None:
    payload = msgpack.packb(msgpack.unpackb(encoding.encode(good)) | {"version": version})
    with pytest.raises(encoding.BadMessage, match="version"):
        encoding.decode_command(payload)


def test_chunks_must_have_as_many_times_as_targets() -> None:
    good = chunk(np.arange(3), np.zeros(3))
    offsets, values = encoding.points(encoding.decode_command(encoding.encode(good)))
    assert offsets.tolist() == [0, 1, 2]
    assert values.tolist() == [0.0, 0.0, 0.0]
    for bad in (
        chunk(np.arange(3), np.zeros(2)),
        chunk(np.arange(0), np.zeros(0)),
        chunk(np.arange(1), np.zeros(1), offset_ns=b"1234567", value=b"1234567"),
        chunk(np.arange(16_385), np.zeros(16_385)),
    ):
        with pytest.raises(encoding.BadMessage):
            encoding.decode_command(encoding.encode(bad))


@pytest.mark.parametrize(
    ("payload", "says"),
    [
        (b"\xc1\xff\x00", "not msgpack"),
        (b"\x81" * 5000, "nested too deeply"),
        (b"\x91" * 5000, "nested too deeply"),
        (b"", "incomplete"),
        (b"\x81\xa1a", "incomplete"),
    ],
)
def test_bytes_that_cannot_be_decoded_are_refused_with_a_reason(payload: bytes, says: str) -> None:
    with pytest.raises(encoding.BadMessage, match=says):
        encoding.decode_command(payload)


@given(st.binary(max_size=64))
def test_no_refusal_is_without_a_reason(payload: bytes) -> None:
    with pytest.raises(encoding.BadMessage, match=r": \S"):
        encoding.decode_command(payload)


def test_ten_megabytes_are_refused_unread() -> None:
    with pytest.raises(encoding.BadMessage, match="bytes"):
        encoding.decode_command(b"\x00" * 10_000_000)


def test_batches_with_short_columns_or_absurd_numbers_are_refused() -> None:
    samples = np.zeros(4, TELEMETRY)
    plain = msgpack.unpackb(encoding.encode(encoding.batch(samples, 1, "um", 0)))
    for change in ({"volts": b"\0" * 31}, {"count": 5}, {"count": 10**9}, {"first_seq": 2**63}):
        with pytest.raises(encoding.BadMessage):
            encoding.samples(
                encoding.decode(messages.TelemetryBatch, msgpack.packb(plain | change))
            )
