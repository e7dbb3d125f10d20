"""The reply framing of firmware from 1.09 on: a reply is everything up to the prompt ">"."""

from dataclasses import dataclass

from dehyst.drivers.mdt693b.exchange import Ack, Exchange, Refused, ReplyEvent

ERROR_TEXTS = (b"CMD_NOT_DEFINED", b"CMD_ARG_INVALID")


@dataclass(frozen=True)
class Modern:
    """A Framing, see dialects.py. prompt: ends every reply; errors: texts before the prompt when a
    command is refused."""

    name: str = "modern"
    prompt: bytes = b">"
    errors: tuple[bytes, ...] = ERROR_TEXTS
    padding: bytes = b"\r"
    ends_in_silence: bool = False

    def parse(self, x: Exchange) -> list[ReplyEvent] | None:
        """Parse everything up to the prompt."""
        assert x.form is not None
        end = x.buffer.find(self.prompt)
        if end < 0:
            # Some firmware may answer a set with a bare "!" (unconfirmed), without a prompt.
            if x.form.pattern is None and x.without_echo(x.buffer).rstrip(b"\r") == b"!":
                x.form, x.buffer = None, b""
                return [Refused(b"!")]
            return None
        frame, x.buffer = x.buffer[:end], x.buffer[end + len(self.prompt) :]
        payload = x.without_echo(frame).rstrip(b"\r")
        if payload == b"!" or payload.endswith(self.errors):
            if not x.barrier:
                x.form = None
            return [Refused(payload, late=x.barrier)]
        if not payload and not x.answers(payload):
            return [Ack(late=True)]  # a query is never answered like this
        if x.barrier:
            return x.finish_barrier(payload)
        return [x.finish(payload)]

    def at_silence(self, x: Exchange) -> list[ReplyEvent]:
        """Return nothing: silence ends no reply here."""
        return []

    def late(self, text: bytes) -> list[ReplyEvent]:
        """Return the events of frames that no command is waiting for."""
        events: list[ReplyEvent] = []
        *frames, rest = text.split(self.prompt)
        for frame in [f.strip(b"\r") for f in frames]:
            if frame == b"!" or frame.endswith(self.errors):
                events.append(Refused(frame, late=True))
            elif not frame:
                events.append(Ack(late=True))
        if rest.strip(b"\r") == b"!":
            events.append(Refused(b"!", late=True))
        return events

    def recognises(self, reply: bytes) -> bool:
        """Return whether this is "CMD_NOT_DEFINED>" after an empty line."""
        return any(error in reply for error in self.errors) or reply.endswith(self.prompt)
