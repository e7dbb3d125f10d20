"""The reply dialects of the MDT693B, one row each; what a row must do is a Framing.

            legacy, firmware <= 1.06          modern, firmware >= 1.09
    reply   [echo] ("*" [payload CR] | "!")   [echo] [payload CR] ">"
    set ok  *                                 >
    query   *[  24.8]\\r                       [  0.24]\\r>
    error   !                                 CMD_NOT_DEFINED>

To add one with another prompt or other error words: a row here. To add another framing: a file
beside legacy.py and modern.py, and a row here. The emulated unit has its own table of them in
drivers/emulated/mdt693b_dialects.py.
"""

from enum import Enum
from typing import Protocol

from dehyst.drivers.mdt693b.exchange import Exchange, ReplyEvent
from dehyst.drivers.mdt693b.legacy import Legacy
from dehyst.drivers.mdt693b.modern import Modern


class Framing(Protocol):
    """How a firmware puts its replies into bytes.

    name: for logs; padding: bytes at the ends of a reply that mean nothing; ends_in_silence:
    nothing else may mark a reply's end. NUL bytes are gone and LF is CR in all that it is given.
    """

    @property
    def name(self) -> str: ...

    @property
    def padding(self) -> bytes: ...

    @property
    def ends_in_silence(self) -> bool: ...

    def parse(self, x: Exchange) -> list[ReplyEvent] | None:
        """The events of the reply, taken from the buffer; None: more is to come."""
        ...

    def at_silence(self, x: Exchange) -> list[ReplyEvent]:
        """The events of a reply that only silence ends."""
        ...

    def late(self, text: bytes) -> list[ReplyEvent]:
        """Acknowledgements and errors in bytes that came in unasked, marked late."""
        ...

    def recognises(self, reply: bytes) -> bool:
        """Whether this is how the dialect answers an empty line. The first row that says yes
        counts."""
        ...


class Dialect(Enum):
    """The rows. `framing` is what each of them does."""

    MODERN = Modern()
    LEGACY = Legacy()

    @property
    def framing(self) -> Framing:
        """What this dialect does."""
        return self.value

    @classmethod
    def named(cls, name: str) -> "Dialect":
        """The row of this name."""
        return next(dialect for dialect in cls if dialect.framing.name == name)
