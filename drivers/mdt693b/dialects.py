"""The reply dialects of the MDT693B, one row each; a Framing defines what a row must implement.

            legacy, firmware <= 1.06          modern, firmware >= 1.09
    reply   [echo] ("*" [payload CR] | "!")   [echo] [payload CR] ">"
    set ok  *                                 >
    query   *[  24.8]\\r                       [  0.24]\\r>
    error   !                                 CMD_NOT_DEFINED>

To add a dialect with another prompt or other error words, add a row here. To add another framing,
add a file next to legacy.py and modern.py, and a row here. The emulated unit has its own table of
dialects in drivers/emulated/mdt693b_dialects.py.
"""

from enum import Enum
from typing import Protocol

from dehyst.drivers.mdt693b.exchange import Exchange, ReplyEvent
from dehyst.drivers.mdt693b.legacy import Legacy
from dehyst.drivers.mdt693b.modern import Modern


class Framing(Protocol):
    """How a firmware encodes its replies as bytes.

    name: for logs; padding: bytes at the ends of a reply that have no meaning; ends_in_silence: a
    reply may end without any mark. In every input, NUL bytes have been removed and LF replaced by
    CR.
    """

    @property
    def name(self) -> str: ...

    @property
    def padding(self) -> bytes: ...

    @property
    def ends_in_silence(self) -> bool: ...

    def parse(self, x: Exchange) -> list[ReplyEvent] | None:
        """Take the reply from the buffer and return its events; None if more is to come."""
        ...

    def at_silence(self, x: Exchange) -> list[ReplyEvent]:
        """Return the events of a reply that only silence ends."""
        ...

    def late(self, text: bytes) -> list[ReplyEvent]:
        """Return the acknowledgements and errors in unsolicited bytes, marked late."""
        ...

    def recognises(self, reply: bytes) -> bool:
        """Return whether the dialect answers an empty line like this. The first row that returns
        True is used."""
        ...


class Dialect(Enum):
    """The rows of the table. `framing` implements each of them."""

    MODERN = Modern()
    LEGACY = Legacy()

    @property
    def framing(self) -> Framing:
        """Return the dialect's implementation."""
        return self.value

    @classmethod
    def named(cls, name: str) -> "Dialect":
        """Return the row of this name."""
        return next(dialect for dialect in cls if dialect.framing.name == name)
