"""One command, the part of its reply received so far, and the events made from it."""

import re
from dataclasses import dataclass

from dehyst.drivers.mdt693b.replies import Form


@dataclass(frozen=True)
class Ack:
    """A command was carried out. late: it belongs to an earlier command than the last one sent."""

    late: bool = False


@dataclass(frozen=True)
class Refused:
    """The unit answered with an error; text is b"!" or what the unit wrote. late: as in Ack."""

    text: bytes
    late: bool = False


@dataclass(frozen=True)
class Answer:
    """The answer to a query. payload: the bytes between echo and prompt, CR between lines; value:
    the payload without brackets and padding."""

    payload: bytes
    value: str


@dataclass(frozen=True)
class Garbled:
    """Bytes that are not a reply to what was sent."""

    raw: bytes


ReplyEvent = Ack | Refused | Answer | Garbled


class Exchange:
    """One command and its reply. sent: the command without terminator; form: that of its reply,
    None once the reply is complete; barrier: only the answer to this query ends it; buffer: bytes
    that have produced no event yet."""

    def __init__(self) -> None:
        self.sent = b""
        self.form: Form | None = None
        self.barrier = False
        self.buffer = b""

    def begin(self, sent: bytes, form: Form, barrier: bool) -> None:
        """Start a new command and forget what was received before it."""
        self.sent, self.form, self.barrier, self.buffer = sent, form, barrier, b""

    @property
    def only_echo(self) -> bool:
        """Return whether the buffer may be only the echo, with the reply still to come."""
        begun = self.buffer.strip(b"\r").lower()
        return self.form is not None and self.sent.lower().startswith(begun)

    def without_echo(self, text: bytes) -> bytes:
        """Return the text after the echo and the CRs around it."""
        text = text.lstrip(b"\r")
        if self.sent and text[: len(self.sent)].lower() == self.sent.lower():
            text = text[len(self.sent) :]
        return text.lstrip(b"\r")

    def answers(self, payload: bytes) -> bool:
        """Return whether the payload is a valid answer to the command."""
        form = self.form
        if form is None or form.pattern is None:
            return form is not None and not payload
        return form.pattern.fullmatch(payload) is not None and (bool(payload) or form.blank)

    def finish(self, payload: bytes) -> ReplyEvent:
        """End the reply with `payload`; return the kind of event that the command calls for."""
        form, answers = self.form, self.answers(payload)
        self.form = None
        if not answers or form is None:
            return Garbled(payload)
        if form.pattern is None:
            return Ack()
        match = form.pattern.fullmatch(payload)
        assert match is not None
        return Answer(payload, match.group("value").decode("ascii", "replace").strip())

    def finish_barrier(self, payload: bytes) -> list[ReplyEvent]:
        """End the reply to a barrier: its answer comes last, after late answers and noise."""
        assert self.form is not None
        assert self.form.pattern is not None
        own = re.search(rb"(?:%s)\Z" % self.form.pattern.pattern, payload)
        if own is None or not self.answers(own.group()):
            return [Garbled(payload)]
        earlier = payload[: own.start()].strip(b"\r*")
        return [*([Garbled(earlier)] if earlier else []), self.finish(own.group())]
