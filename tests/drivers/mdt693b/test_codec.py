"""Properties of the MDT693B codec: no input crashes it or makes it invent a reply."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dehyst.drivers.mdt693b.codec import (
    Ack,
    Answer,
    Dialect,
    Garbled,
    Mdt693bCodec,
    Refused,
    late_replies,
)
from dehyst.drivers.mdt693b.modern import ERROR_TEXTS
from dehyst.drivers.mdt693b.replies import FORMS, Ends, form_of

COMMANDS = [*FORMS, "xvoltage=1.000", "xvoltage?", "ymin?", "XV10.0", "xr?", "XL?", "restore"]
PIECES = [b"*", b"!", b">", b"\r", b"\n", b"\0", b"[  1.00]\r", b"[ 100]\r", b"xvoltage=1.000\r"]
PIECES += [*ERROR_TEXTS, b"[", b"]", b"0", b"\xff"]
noise = st.one_of(st.binary(max_size=64), st.lists(st.sampled_from(PIECES)).map(b"".join))
dialects = st.sampled_from(Dialect)
commands = st.sampled_from(COMMANDS)


def cut(data: bytes, places: list[int]) -> list[bytes]:
    edges = [0, *sorted(p % (len(data) + 1) for p in places), len(data)]
    return [data[a:b] for a, b in itertools.pairwise(edges)]


@given(dialects, commands, noise, st.booleans())
def test_nothing_crashes_it_and_one_byte_gives_at_most_one_event(dialect, command, data, barrier):
    form = form_of(command)
    codec = Mdt693bCodec(dialect)
    codec.send(command, barrier and form.pattern is not None and not form.blank)
    events = codec.receive(data) + codec.silence()
    assert len(events) <= len(data)
    marks = data.count(b">") if dialect is Dialect.MODERN else data.count(b"*")
    assert sum(isinstance(e, Ack) for e in events) <= marks
    assert sum(isinstance(e, Ack) and not e.late for e in events) <= 1
    errors = data.count(b"!") + sum(data.count(text) for text in ERROR_TEXTS)
    assert sum(isinstance(e, Refused) for e in events) <= errors


@given(dialects, noise)
def test_an_acknowledgement_has_nothing_before_it(dialect, data):
    """A set is acknowledged only if its mark comes first, apart from the echo and NUL, CR, LF."""
    codec = Mdt693bCodec(dialect)
    codec.send("xvoltage=1.000")
    first = codec.receive(data)[:1]
    if first == [Ack()]:
        mark = b">" if dialect is Dialect.MODERN else b"*"
        before = data[: data.index(mark)].replace(b"xvoltage=1.000", b"", 1)
        assert not before.strip(b"\0\r\n")


@given(dialects, commands, noise, st.lists(st.integers(0, 1000), max_size=6))
def test_events_do_not_depend_on_how_the_bytes_are_cut(dialect, command, data, places):
    if b"!" in data and dialect is Dialect.MODERN:
        return  # a bare "!" counts at once, so its prompt may come after it
    whole, pieces = Mdt693bCodec(dialect), Mdt693bCodec(dialect)
    whole.send(command)
    pieces.send(command)
    events = whole.receive(data)
    assert [e for piece in cut(data, places) for e in pieces.receive(piece)] == events
    assert whole.unparsed == pieces.unparsed
    assert whole.silence() == pieces.silence()


@given(st.floats(0.0, 150.0), st.lists(st.integers(0, 1000)), st.booleans())
def test_readings_come_through_whole(volts, places, echo):
    for dialect, text in (
        (Dialect.LEGACY, f"*[{volts:6.1f}]\r"),
        (Dialect.MODERN, f"[{volts:6.2f}]\r>"),
    ):
        codec = Mdt693bCodec(dialect)
        sent = codec.send("xvoltage?")
        raw = (sent if echo else b"") + text.encode()
        events = [e for piece in cut(raw, places) for e in codec.receive(piece)]
        assert [type(e) for e in events] == [Answer]
        assert abs(float(events[0].value) - volts) <= 0.0500001
        assert not codec.waiting
        assert not codec.unparsed.strip(b"\r")


@given(dialects, st.integers(0, 3), st.integers(0, 3), st.lists(st.integers(0, 1000)))
def test_a_barrier_counts_late_replies_and_ends_only_with_its_own(dialect, acks, errors, places):
    if dialect is Dialect.MODERN:
        raw = b">" * acks + b"CMD_ARG_INVALID>" * errors + b"[ 100]\r>"
    else:
        raw = b"*" * acks + b"!" * errors + b"*[ 100]\r*"
    codec = Mdt693bCodec(dialect)
    codec.send("vlimit?", barrier=True)
    events = [e for piece in cut(raw, places) for e in codec.receive(piece)] + codec.silence()
    assert events[-1] == Answer(b"[ 100]", "100")
    assert events.count(Ack(late=True)) == acks
    assert sum(isinstance(e, Refused) and e.late for e in events) == errors
    assert not codec.waiting


def test_a_late_reading_is_not_taken_for_the_answer_of_a_barrier():
    for dialect, raw in (
        (Dialect.MODERN, b"[  1.00]\r>[ 100]\r>"),
        (Dialect.LEGACY, b"*[   1.0]\r*[ 100]\r*"),
    ):
        codec = Mdt693bCodec(dialect)
        codec.send("vlimit?", barrier=True)
        events = codec.receive(raw) + codec.silence()
        assert [type(e) for e in events] == [Garbled, Answer]
        assert events[-1] == Answer(b"[ 100]", "100")


@pytest.mark.parametrize("command", ["xvoltage=1", "", "serial?"])
def test_only_an_unmistakable_query_can_be_a_barrier(command):
    with pytest.raises(ValueError, match="barrier"):
        Mdt693bCodec(Dialect.MODERN).send(command, barrier=True)


@given(dialects, noise)
def test_stray_bytes_give_no_more_late_replies_than_they_hold(dialect, data):
    events = late_replies(dialect, data)
    assert all(isinstance(e, Ack | Refused) and e.late for e in events)
    assert len(events) <= sum(data.count(mark) for mark in (b"*", b"!", b">"))


def test_late_replies():
    ack, error = Ack(late=True), Refused(b"!", late=True)
    assert late_replies(Dialect.LEGACY, b"\0*\r!*") == [ack, error, ack]
    assert late_replies(Dialect.LEGACY, b"*[  24.8]\r") == []
    assert late_replies(Dialect.MODERN, b">\r>[  0.24]\r>!") == [ack, ack, error]
    refused = Refused(b"CMD_ARG_INVALID", late=True)
    assert late_replies(Dialect.MODERN, b"xvoltage=9\rCMD_ARG_INVALID>") != []
    assert late_replies(Dialect.MODERN, b"CMD_ARG_INVALID>*") == [refused]


def test_a_modern_unit_behind_a_legacy_codec_is_garbled_not_acknowledged():
    codec = Mdt693bCodec(Dialect.LEGACY)
    codec.send("xvoltage=1.000")
    assert codec.receive(b">") == []
    assert codec.silence() == [Garbled(b">")]


def test_a_legacy_unit_behind_a_modern_codec_is_never_acknowledged():
    codec = Mdt693bCodec(Dialect.MODERN)
    codec.send("xvoltage=1.000")
    assert codec.receive(b"*") == []
    assert codec.silence() == [Garbled(b"*")]


def test_every_set_of_both_command_languages_waits_for_an_acknowledgement():
    for command in ("xvoltage=1", "ZVOLTAGE=1", "XV10.5", "yl0", "ZH150", "allvoltage=3", "", "e"):
        assert form_of(command).ends is Ends.ACK, command
    for command in ("XR?", "ymin?", "XL?", "%", "id?", "echo=0", "msvoltage?"):
        assert form_of(command).pattern is not None, command


@pytest.mark.parametrize("dialect", Dialect)
def test_a_mark_behind_anything_but_the_echo_is_no_acknowledgement(dialect):
    mark = b">" if dialect is Dialect.MODERN else b"*"
    for payload in (b"[ 1.00]", b"xvoltage=9.000", b"1", b"ok"):
        codec = Mdt693bCodec(dialect)
        codec.send("xvoltage=1.000")
        events = codec.receive(payload + b"\r" + mark) + codec.silence()
        assert not any(isinstance(event, Ack) for event in events), (payload, events)
        assert any(isinstance(event, Garbled) for event in events), (payload, events)


@pytest.mark.parametrize("command", ["xmin?", "XL?", "sysmin?", "xvoltage?"])
def test_a_negative_number_keeps_its_sign(command):
    codec = Mdt693bCodec(Dialect.MODERN)
    codec.send(command)
    events = codec.receive(b"[-12.50]\r\n>") + codec.silence()
    assert [event.value for event in events if isinstance(event, Answer)] == ["-12.50"]
