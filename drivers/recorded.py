"""Raw exchanges with a unit, recorded with their times; `dehyst probe` keeps them in this form."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from dehyst.drivers.serial_port import SerialPort


@dataclass(frozen=True)
class RecordedExchange:
    """One command and everything received after it. Times in s from the start of the probe."""

    sent: bytes
    sent_at_s: float
    received: tuple[tuple[float, bytes], ...]

    @property
    def reply(self) -> bytes:
        """Return all bytes of the reply."""
        return b"".join(data for _, data in self.received)

    def to_dict(self) -> dict[str, Any]:
        """Convert to the fixture file's form: bytes as Latin-1 text."""
        return {
            "sent": self.sent.decode("latin-1"),
            "sent_at_s": round(self.sent_at_s, 6),
            "received": [[round(at_s, 6), d.decode("latin-1")] for at_s, d in self.received],
        }


def record_exchange(
    port: SerialPort,
    sent: bytes,
    waits_s: tuple[float, float],
    clock: Callable[[], float],
    start_s: float = 0.0,
) -> RecordedExchange:
    """Send bytes and record everything received until the line is quiet. waits_s: longest wait for
    the first byte, and the silence that ends the reply; start_s: time 0 of the record."""
    sent_at_s = clock() - start_s
    port.write(sent)
    received: list[tuple[float, bytes]] = []
    while True:
        data = port.read_until_deadline(clock() + waits_s[bool(received)])
        if not data:
            return RecordedExchange(sent, sent_at_s, tuple(received))
        received.append((clock() - start_s, data))
