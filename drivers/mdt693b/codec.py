"""The serial protocol of the Thorlabs MDT693B / MDT694B, without a port: bytes in, events out.

The unit uses one of several reply dialects, depending on its firmware: see dialects.py. NUL bytes
are dropped and LF counts as CR: both occur on real lines. If only silence ends a reply, the caller
reports it by calling `silence()`.

The caller sends one command at a time:

    codec = Mdt693bCodec(Dialect.MODERN)
    port.write(codec.send("xvoltage=12.500"))
    for event in codec.receive(port.read()): ...      # Ack

An acknowledgement is never invented: an Ack comes from an acknowledging byte with nothing but the
echo before it, and one byte produces at most one event.
"""

from dehyst.drivers.mdt693b.dialects import Dialect
from dehyst.drivers.mdt693b.exchange import Ack, Answer, Exchange, Garbled, Refused, ReplyEvent
from dehyst.drivers.mdt693b.replies import form_of

__all__ = (
    "Ack",
    "Answer",
    "Dialect",
    "Garbled",
    "Mdt693bCodec",
    "Refused",
    "ReplyEvent",
    "detect_dialect",
    "late_replies",
)

TERMINATOR = b"\r"


class Mdt693bCodec:
    """The host's side of the protocol. dialect: see `detect_dialect`."""

    def __init__(self, dialect: Dialect) -> None:
        self.dialect = dialect
        self._exchange = Exchange()

    @property
    def waiting(self) -> bool:
        """Whether a reply to the last command is outstanding."""
        return self._exchange.form is not None

    @property
    def unparsed(self) -> bytes:
        """Bytes received that have not produced an event yet."""
        return self._exchange.buffer

    def send(self, command: str, barrier: bool = False) -> bytes:
        """Return the bytes of `command` and expect its reply from now on. Received bytes that
        produced no event are discarded: look at `unparsed` first.

        barrier: only the answer to this query ends it; acknowledgements and errors before it are
        late ones of earlier commands (the unit answers in order). Raises ValueError when `command`
        is not a query, or is one whose answer may be blank: such answers could not be distinguished
        from late replies.
        """
        form = form_of(command)
        if barrier and (form.pattern is None or form.blank):
            raise ValueError(f"{command!r} cannot be a barrier: its answer is not unmistakable")
        sent = command.encode("ascii")
        self._exchange.begin(sent, form, barrier)
        return sent + TERMINATOR

    def receive(self, data: bytes) -> list[ReplyEvent]:
        """Return the events that `data` completes, in order. Bytes after the reply stay in
        `unparsed` until silence() or the next send()."""
        exchange = self._exchange
        exchange.buffer += _cleaned(data)
        events: list[ReplyEvent] = []
        while exchange.form is not None:
            found = self.dialect.framing.parse(exchange)
            if found is None:
                break
            events += found
        return events

    def silence(self) -> list[ReplyEvent]:
        """Return the events that silence on the line completes: all that is in the buffer, unless
        it is at most the echo, whose reply is still to come."""
        exchange, framing = self._exchange, self.dialect.framing
        if exchange.only_echo:
            return []
        events = framing.at_silence(exchange) if exchange.form is not None else []
        rest = exchange.buffer.strip(framing.padding)
        exchange.buffer = b""
        if rest and not events:
            events.append(Garbled(rest))
        return events


def late_replies(dialect: Dialect, raw: bytes) -> list[ReplyEvent]:
    """Return the acknowledgements and errors in unsolicited bytes."""
    return dialect.framing.late(_cleaned(raw))


def detect_dialect(reply: bytes) -> Dialect | None:
    """Return the dialect, given everything received after an empty line; None if it is unclear. The
    unit answers the empty line with an error: "!" or "CMD_NOT_DEFINED>"."""
    text = reply.replace(b"\0", b"").strip(b"\r\n")
    return next((dialect for dialect in Dialect if dialect.framing.recognises(text)), None)


def _cleaned(data: bytes) -> bytes:
    return data.replace(b"\0", b"").replace(b"\n", b"\r")
