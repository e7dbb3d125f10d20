"""The serial language of the Thorlabs MDT693B / MDT694B, without any port: bytes in, events out.

The unit speaks one of two reply dialects, by firmware:

            legacy, firmware <= 1.06          modern, firmware >= 1.09
    reply   [echo] ("*" [payload CR] | "!")   [echo] [payload CR] ">"
    set ok  *                                 >
    query   *[  24.8]\\r                       [  0.24]\\r>
    error   !                                 CMD_NOT_DEFINED>

Modern framing is regular: a reply ends with ">". Legacy framing is not: some queries put no CR
behind the payload, some no "*" before it, some a second "*" after it, and nothing marks the end
of the several lines of "id?". So a legacy reply ends with its bracket line where the query has
no trailer (the voltage reads), and otherwise with silence, which the caller reports by calling
`silence()`. NUL bytes are dropped and LF counts as CR: both are seen on real lines.

The caller sends one command at a time:

    codec = Mdt693bCodec(Dialect.MODERN)
    port.write(codec.send("xvoltage=12.500"))
    for event in codec.receive(port.read()): ...      # Ack

An acknowledgement is never invented: an Ack comes from an acknowledging byte with nothing but
the echo before it, and one byte gives at most one event.
"""

import re
from dataclasses import dataclass
from enum import Enum

from dehyst.drivers.mdt693b_forms import Ends, Form, form_of

TERMINATOR = b"\r"
ERROR_TEXTS = (b"CMD_NOT_DEFINED", b"CMD_ARG_INVALID")


class Dialect(Enum):
    """How the firmware frames its replies."""

    LEGACY = "legacy"
    MODERN = "modern"


@dataclass(frozen=True)
class Ack:
    """A command was carried out. late: it belongs to an earlier command than the last sent."""

    late: bool = False


@dataclass(frozen=True)
class Refused:
    """The unit answered with an error; text is b"!" or what it wrote. late: as in Ack."""

    text: bytes
    late: bool = False


@dataclass(frozen=True)
class Data:
    """The answer to a query. payload: what lies between echo and prompt, CR between lines;
    value: the payload without brackets and padding."""

    payload: bytes
    value: str


@dataclass(frozen=True)
class Garbled:
    """Bytes that are no reply to what was sent."""

    raw: bytes


Event = Ack | Refused | Data | Garbled


class Mdt693bCodec:
    """One side of the conversation. dialect: see `detect_dialect`."""

    def __init__(self, dialect: Dialect) -> None:
        self.dialect = dialect
        self._buffer = b""
        self._sent = b""
        self._form: Form | None = None
        self._barrier = False

    @property
    def waiting(self) -> bool:
        """Whether a reply to the last command is outstanding."""
        return self._form is not None

    @property
    def unparsed(self) -> bytes:
        """Bytes received that have not made an event yet."""
        return self._buffer

    def send(self, command: str, barrier: bool = False) -> bytes:
        """The bytes of `command`; from now on its reply is expected. What was received and not
        understood until now is forgotten: look at `unparsed` first.

        barrier: only the answer to this query ends it; acknowledgements and errors before it are
        late ones of earlier commands (the unit works in order). ValueError when `command` is no
        query, or one whose answer may be blank: they could not be told from late replies.
        """
        form = form_of(command)
        if barrier and (form.pattern is None or form.blank):
            raise ValueError(f"{command!r} cannot be a barrier: its answer is not unmistakable")
        self._sent = command.encode("ascii")
        self._form = form
        self._barrier = barrier
        self._buffer = b""
        return self._sent + TERMINATOR

    def receive(self, data: bytes) -> list[Event]:
        """Events that `data` completes, in order. Bytes behind the reply stay in `unparsed`
        until silence() or the next send()."""
        self._buffer += data.replace(b"\0", b"").replace(b"\n", b"\r")
        parse = self._legacy if self.dialect is Dialect.LEGACY else self._modern
        events: list[Event] = []
        while self._form is not None:
            found = parse()
            if found is None:
                break
            events += found
        return events

    def silence(self) -> list[Event]:
        """The line has been quiet: whatever is in the buffer is complete, unless it is no more
        than the echo, behind which the reply is still to come."""
        events: list[Event] = []
        if self._form is not None and self._sent.lower().startswith(
            self._buffer.strip(b"\r").lower()
        ):
            return events
        if self._form is not None and self.dialect is Dialect.LEGACY:
            events = self._legacy_at_silence(self._form)
        # CR and a trailing "*" after a finished legacy reply are part of its framing.
        rest = self._buffer.strip(b"\r*" if self.dialect is Dialect.LEGACY else b"\r")
        self._buffer = b""
        if rest and not events:
            events.append(Garbled(rest))
        return events

    # -- modern: everything up to the prompt

    def _modern(self) -> list[Event] | None:
        assert self._form is not None
        end = self._buffer.find(b">")
        if end < 0:
            # Some firmware may answer a set with a bare "!" (unconfirmed): it needs no prompt.
            if self._form.pattern is None and self._strip_echo(self._buffer) == b"!":
                self._form, self._buffer = None, b""
                return [Refused(b"!")]
            return None
        frame, self._buffer = self._buffer[:end], self._buffer[end + 1 :]
        payload = self._strip_echo(frame)
        if payload == b"!" or payload.endswith(ERROR_TEXTS):
            if not self._barrier:
                self._form = None
            return [Refused(payload, late=self._barrier)]
        if not payload and not self._answers(payload):
            return [Ack(late=True)]  # a query never answers so
        if self._barrier:
            return self._at_barrier(payload)
        return [self._finish(payload)]

    # -- legacy: acknowledge first

    def _legacy(self) -> list[Event] | None:
        assert self._form is not None
        text = self._strip_echo(self._buffer)
        if self._form.ends is Ends.ACK:
            if not text:
                return None
            if text[:1] in (b"*", b"!"):
                self._form, self._buffer = None, text[1:]
                return [Ack() if text[:1] == b"*" else Refused(b"!")]
            return None  # an echo still to come, or garbage: silence() or the time-out tells
        if self._form.ends is Ends.LINE:
            line = re.search(rb"\[[^\[\]\r]*\]\r", text)
            if line is not None:
                before, payload = text[: line.start()], line.group()[:-1]
                self._buffer = text[line.end() :]
                junk = before.strip(b"*!\r")
                garbled: list[Event] = [Garbled(junk)] if junk else []
                return [*_late(before, own=1), *garbled, self._finish(payload)]
        return None

    def _legacy_at_silence(self, form: Form) -> list[Event]:
        text = self._strip_echo(self._buffer)
        if form.ends is Ends.ACK or not text.strip(b"\r"):
            return []  # nothing, or bytes that do not acknowledge
        marks = text[: len(text) - len(text.lstrip(b"*!\r"))]
        payload = text[len(marks) :].strip(b"\r*")
        self._buffer = b""
        if not payload and b"!" in marks and not self._barrier:
            self._form = None
            return [*_late(marks[: marks.rindex(b"!")], own=0), Refused(b"!")]
        if not payload and not form.blank:
            return _late(marks, own=0)
        events = _late(marks, own=1)
        return events + (self._at_barrier(payload) if self._barrier else [self._finish(payload)])

    # -- shared

    def _at_barrier(self, payload: bytes) -> list[Event]:
        """The barrier's answer stands at the end; before it, late answers and noise."""
        assert self._form is not None
        assert self._form.pattern is not None
        own = re.search(rb"(?:%s)\Z" % self._form.pattern.pattern, payload)
        if own is None or not self._answers(own.group()):
            return [Garbled(payload)]
        earlier = payload[: own.start()].strip(b"\r*")
        return [*([Garbled(earlier)] if earlier else []), self._finish(own.group())]

    def _answers(self, payload: bytes) -> bool:
        form = self._form
        if form is None or form.pattern is None:
            return form is not None and not payload
        return form.pattern.fullmatch(payload) is not None and (bool(payload) or form.blank)

    def _finish(self, payload: bytes) -> Event:
        """End the reply with `payload`: an event of the kind that the command calls for."""
        form, answers = self._form, self._answers(payload)
        self._form = None
        if not answers or form is None:
            return Garbled(payload)
        if form.pattern is None:
            return Ack()
        match = form.pattern.fullmatch(payload)
        assert match is not None
        return Data(payload, match.group("value").decode("ascii", "replace").strip())

    def _strip_echo(self, text: bytes) -> bytes:
        text = text.lstrip(b"\r")
        if self._sent and text[: len(self._sent)].lower() == self._sent.lower():
            text = text[len(self._sent) :]
        return text.strip(b"\r") if self.dialect is Dialect.MODERN else text.lstrip(b"\r")


def _late(marks: bytes, own: int) -> list[Event]:
    """The acknowledgements and errors in `marks`, without the last `own` acknowledgements."""
    events: list[Event] = []
    stars = marks.count(b"*")
    for mark in marks:
        if mark == ord("*") and stars > own:
            stars -= 1
            events.append(Ack(late=True))
        elif mark == ord("!"):
            events.append(Refused(b"!", late=True))
    return events


def late_replies(dialect: Dialect, raw: bytes) -> list[Event]:
    """Acknowledgements and errors in bytes that came in unasked."""
    text = raw.replace(b"\0", b"").replace(b"\n", b"\r")
    if dialect is Dialect.LEGACY:
        return _late(b"".join(re.findall(rb"\*(?!\[)|!", text)), own=0)
    events: list[Event] = []
    *frames, rest = text.split(b">")
    for frame in [f.strip(b"\r") for f in frames]:
        if frame == b"!" or frame.endswith(ERROR_TEXTS):
            events.append(Refused(frame, late=True))
        elif not frame:
            events.append(Ack(late=True))
    if rest.strip(b"\r") == b"!":
        events.append(Refused(b"!", late=True))
    return events


def detect_dialect(reply: bytes) -> Dialect | None:
    """The dialect, from everything that came back after an empty line; None if it cannot be
    told. The empty line earns an error: "!" or "CMD_NOT_DEFINED>"."""
    text = reply.replace(b"\0", b"").strip(b"\r\n")
    if any(error in text for error in ERROR_TEXTS) or text.endswith(b">"):
        return Dialect.MODERN
    if text.endswith((b"!", b"*")):
        return Dialect.LEGACY
    return None
