"""Exchange commands with an MDT693B over an open port: one at a time, with deadlines, in step.

In step means that every reply to an earlier command has been read, so that the next acknowledgement
can only belong to the next set. After a time-out, a garbled reply or unsolicited bytes this is no
longer certain. The unit answers in order, so a query whose answer cannot be mistaken for anything
else (`vlimit?`) is a barrier: once it is answered, all earlier replies have arrived. No set is sent
before that.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass

from dehyst.drivers.interface import DeviceTimeout, ProtocolError
from dehyst.drivers.mdt693b.codec import (
    Ack,
    Answer,
    Dialect,
    Garbled,
    Mdt693bCodec,
    Refused,
    ReplyEvent,
    detect_dialect,
    late_replies,
)
from dehyst.drivers.mdt693b.tuning import TUNING
from dehyst.drivers.serial_port import SerialPort

MEANINGLESS = b"\0\r\n"
NO_COMMAND = b"#\r"  # spoils a half-received line; causes an error, as an empty line does


class CommandRefused(ProtocolError):
    """The unit answered a command with an error; the conversation stays in step."""


@dataclass
class LateReplies:
    """Replies received for commands that had been given up."""

    acks: int = 0
    refusals: int = 0

    def clear(self) -> None:
        """Reset the counts to zero."""
        self.acks = self.refusals = 0


class Mdt693bLink:
    """The conversation on one port. port: open. timeout_s: longest wait for a reply. idle_s:
    silence that ends a legacy reply. clock: that of the port. Raises DeviceTimeout, DeviceGone and
    ProtocolError; after CommandRefused the link is as before, after the others `in_step` is False
    until `get_in_step()` succeeds."""

    def __init__(
        self,
        port: SerialPort,
        timeout_s: float,
        idle_s: float,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.port = port
        self.timeout_s = timeout_s
        self.idle_s = idle_s
        self.barrier = "vlimit?"
        self.in_step = False
        self.stray_bytes = 0
        self.late = LateReplies()
        self._clock = clock
        self._codec = Mdt693bCodec(Dialect.MODERN)
        self._owed = 0  # barriers sent but not answered
        self._cut_short = False  # a write timed out: the unit may hold half a command

    @property
    def dialect(self) -> Dialect:
        return self._codec.dialect

    def handshake(self) -> None:
        """Find the dialect and switch the echo off, without moving an output. Sends a word that
        is not a command (a half-received command may be left in the unit), an empty line, and
        echo=0."""
        self.drain(self.idle_s)
        self._write(NO_COMMAND + b"\r")
        raw = self._read_to_silence()
        dialect = detect_dialect(raw)
        if dialect is None and not raw:
            raise DeviceTimeout(
                f"{self.port.path}: no answer within {self.timeout_s:g} s; check that this is the "
                "port of an MDT693B, that the unit is on, and that no other program holds the "
                "port"
            )
        if dialect is None:
            raise ProtocolError(
                f"{self.port.path}: an empty line was answered with {raw[:80]!r}, which is not a "
                "reply of an MDT693B; check the port and the baud rate"
            )
        self._codec = Mdt693bCodec(dialect)
        self._owed, self._cut_short, self.in_step = 0, False, True
        try:
            self.ask("echo=0")
        except CommandRefused:
            # The unit knows MDT693A commands only: "E" toggles the echo, seen on the first line.
            if NO_COMMAND[:1] in raw:
                self.get_in_step()
                self.set("E")
        self.drain(self.idle_s)

    def ask(self, command: str) -> Answer:
        """Return the answer to a query."""
        deadline_s = self._clock() + self.timeout_s
        self.get_in_step(deadline_s)
        for event in self._exchange(command, deadline_s):
            if isinstance(event, Answer):
                return event
            self._raise_unless_late(command, event)
        raise self._no_answer(command)

    def set(self, command: str) -> None:
        """Carry out a command, sent once; return when acknowledged. Call get_in_step() first."""
        for event in self._exchange(command, self._clock() + self.timeout_s):
            if isinstance(event, Ack):
                return
            self._raise_unless_late(command, event)
        raise self._no_answer(command)

    def get_in_step(self, deadline_s: float | None = None) -> None:
        """Make sure that no reply is outstanding. Late ones are counted in `late`. Raises
        DeviceTimeout when the barrier is not answered by the deadline."""
        waiting = self._codec.unparsed + self.port.read_available()
        waiting = waiting.strip(MEANINGLESS)
        if waiting:
            self.stray_bytes += len(waiting)
            self.in_step = False
        if self.in_step:
            return
        if deadline_s is None:
            deadline_s = self._clock() + self.timeout_s
        if self._cut_short:
            self.port.write(NO_COMMAND)
            self.late.refusals -= 1  # NO_COMMAND causes one
            self._cut_short = False
        self._owed += 1
        answered = False
        events = late_replies(self.dialect, waiting)
        for event in events + self._exchange(self.barrier, deadline_s, barrier=True):
            self.late.acks += isinstance(event, Ack)
            self.late.refusals += isinstance(event, Refused)
            answered = answered or isinstance(event, Answer)
        if not answered:
            raise DeviceTimeout(
                f"{self.port.path}: the unit did not answer within {self.timeout_s:g} s; whether "
                "it carried out the last command is unknown, and nothing more was sent"
            )
        if self._owed > 1:
            self.drain(self.timeout_s)  # the answers to the earlier barriers may still come
        self._owed = 0
        self.in_step = True

    def drain(self, quiet_s: float) -> bytes:
        """Read and return everything until nothing has come for `quiet_s`."""
        got = b""
        while True:
            more = self.port.read_until_deadline(self._clock() + quiet_s)
            if not more:
                return got
            got += more
            if len(got) > TUNING.most_drained:
                raise ProtocolError(
                    f"{self.port.path}: an endless stream of bytes ({got[:40]!r}...); this is not "
                    "an MDT693B, or the baud rate is wrong"
                )

    def close(self) -> None:
        """Close the port."""
        self.port.close()

    # -- internal

    def _write(self, data: bytes) -> None:
        try:
            self.port.write(data)
        except DeviceTimeout:
            self.in_step, self._cut_short = False, True
            raise

    def _exchange(self, command: str, deadline_s: float, barrier: bool = False) -> list[ReplyEvent]:
        """Send one command; collect events until the reply is complete or time is up."""
        codec = self._codec
        data = codec.send(command, barrier)
        self._write(data)
        events: list[ReplyEvent] = []
        received = False
        while codec.waiting:
            until_s = deadline_s
            if received and codec.dialect.framing.ends_in_silence:
                until_s = min(deadline_s, self._clock() + self.idle_s)
            more = self.port.read_until_deadline(until_s)
            if more:
                received = True
                events += codec.receive(more)
            elif until_s < deadline_s:
                events += codec.silence()
                received = False
            else:
                self.in_step = False
                return events + codec.silence()
        return events

    def _raise_unless_late(self, command: str, event: ReplyEvent) -> None:
        where = f"{self.port.path}: {command!r}"
        if isinstance(event, Garbled):
            self.in_step = False
            raise ProtocolError(f"{where} was answered with {event.raw[:80]!r}")
        if event.late if isinstance(event, Ack | Refused) else True:
            self.in_step = False  # the reply belongs to another command
            if isinstance(event, Refused):
                self.late.refusals += 1
            return
        if isinstance(event, Refused):
            raise CommandRefused(f"{where} was refused: {event.text.decode('ascii', 'replace')}")

    def _no_answer(self, command: str) -> DeviceTimeout:
        self.in_step = False
        return DeviceTimeout(
            f"{self.port.path}: {command!r} was not acknowledged within {self.timeout_s:g} s; "
            "it was not repeated"
        )

    def _read_to_silence(self) -> bytes:
        first = self.port.read_until_deadline(self._clock() + self.timeout_s)
        return first + self.drain(self.idle_s) if first else b""
