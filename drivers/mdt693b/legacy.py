"""The reply framing of firmware up to 1.06: acknowledge first; often nothing marks the end.

For some queries there is no CR after the payload, for some no "*" before it, for some a second "*"
after it, and nothing marks the end of the several lines of "id?". So a reply ends with its bracket
line if the query has no trailer (the voltage reads), and otherwise with silence.
"""

import re

from dehyst.drivers.mdt693b.exchange import Ack, Exchange, Garbled, Refused, ReplyEvent
from dehyst.drivers.mdt693b.replies import Ends


class Legacy:
    """A Framing, see dialects.py."""

    name = "legacy"
    padding = b"\r*"  # CR and a trailing "*" after a finished reply are part of it
    ends_in_silence = True

    def parse(self, x: Exchange) -> list[ReplyEvent] | None:
        """Return an acknowledgement, or a bracket line; other replies end with silence."""
        assert x.form is not None
        text = x.without_echo(x.buffer)
        if x.form.ends is Ends.ACK:
            if not text:
                return None
            if text[:1] in (b"*", b"!"):
                x.form, x.buffer = None, text[1:]
                return [Ack() if text[:1] == b"*" else Refused(b"!")]
            return None  # an echo alone, or garbage: silence() or the time-out decides
        if x.form.ends is Ends.LINE:
            line = re.search(rb"\[[^\[\]\r]*\]\r", text)
            if line is not None:
                before, payload = text[: line.start()], line.group()[:-1]
                x.buffer = text[line.end() :]
                junk = before.strip(b"*!\r")
                garbled: list[ReplyEvent] = [Garbled(junk)] if junk else []
                return [*_late(before, own=1), *garbled, x.finish(payload)]
        return None

    def at_silence(self, x: Exchange) -> list[ReplyEvent]:
        """Complete a payload that has no end mark."""
        form = x.form
        assert form is not None
        text = x.without_echo(x.buffer)
        if form.ends is Ends.ACK or not text.strip(b"\r"):
            return []  # nothing, or bytes that do not acknowledge
        marks = text[: len(text) - len(text.lstrip(b"*!\r"))]
        payload = text[len(marks) :].strip(b"\r*")
        x.buffer = b""
        if not payload and b"!" in marks and not x.barrier:
            x.form = None
            return [*_late(marks[: marks.rindex(b"!")], own=0), Refused(b"!")]
        if not payload and not form.blank:
            return _late(marks, own=0)
        events = _late(marks, own=1)
        return events + (x.finish_barrier(payload) if x.barrier else [x.finish(payload)])

    def late(self, text: bytes) -> list[ReplyEvent]:
        """Return the marks that belong to no bracket line."""
        return _late(b"".join(re.findall(rb"\*(?!\[)|!", text)), own=0)

    def recognises(self, reply: bytes) -> bool:
        """Return whether this is "!" after an empty line, or another mark at the end."""
        return reply.endswith((b"!", b"*"))


def _late(marks: bytes, own: int) -> list[ReplyEvent]:
    """Return the acknowledgements and errors in `marks` except the last `own` acknowledgements."""
    events: list[ReplyEvent] = []
    stars = marks.count(b"*")
    for mark in marks:
        if mark == ord("*") and stars > own:
            stars -= 1
            events.append(Ack(late=True))
        elif mark == ord("!"):
            events.append(Refused(b"!", late=True))
    return events
