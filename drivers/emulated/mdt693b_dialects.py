"""How each firmware of the emulated MDT693B writes its replies, byte by byte: one row each.

The replies in tests/drivers/mdt693b/test_golden.py are recorded. All others are assumed to follow
the same style; the two that matter to a driver are switches (`range_error` of the knobs,
`compatibility_only`). A firmware with other words needs a row; one with another framing a class and
a row. The driver's counterpart is drivers/mdt693b/dialects.py.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class ReplyStyle:
    """The style with a prompt after each reply, firmware from 1.09 on.

    firmware: its number, as id? shows it; unknown: the reply to an unknown command; decimals: of a
    voltage; knows_xyz: whether it has xyzvoltage; restored: its answer to restore.
    """

    firmware: str
    prompt: bytes = b">"
    unknown: bytes = b"CMD_NOT_DEFINED"
    decimals: int = 2
    knows_xyz: bool = True
    restored: bytes = b">"

    def ok(self) -> bytes:
        """Return the reply to a set that was carried out."""
        return self.prompt

    def not_defined(self) -> bytes:
        """Return the reply to an unknown command, including the empty line."""
        return self.unknown + self.prompt

    def bad_argument(self, text: bytes) -> bytes:
        """Return the reply to an invalid argument. text: the error of a unit with a prompt."""
        return text + self.prompt

    def line(self, payload: str, star: bool = True, trailer: bool = False) -> bytes:
        """Return a payload with its CR. Without a prompt only: star: "*" before, trailer: "*" after
        it."""
        return payload.encode("latin-1") + b"\r" + self.prompt

    def bare(self, payload: str) -> bytes:
        """Return a payload that firmware without a prompt ends without a CR (the axis limits)."""
        return payload.encode("latin-1") + b"\r" + self.prompt

    def volts(self, volts: float) -> str:
        """Format one voltage as the ADC reads it, padded to six characters."""
        return f"{volts:6.{self.decimals}f}"

    def limit(self, volts: float) -> str:
        """Format an axis limit: 0 without decimals, others with the dialect's decimals."""
        return "0" if volts == 0.0 else f"{volts:.{self.decimals}f}"


@dataclass(frozen=True)
class AcknowledgedFirst(ReplyStyle):
    """The style with an acknowledgement before each reply, firmware up to 1.06."""

    prompt: bytes = b""
    unknown: bytes = b"!"
    decimals: int = 1
    knows_xyz: bool = False
    restored: bytes = b"**"

    def ok(self) -> bytes:
        """Return the reply to a set that was carried out."""
        return b"*"

    def bad_argument(self, text: bytes) -> bytes:
        """Return the same reply as to an unknown command."""
        return self.unknown

    def line(self, payload: str, star: bool = True, trailer: bool = False) -> bytes:
        """Return a payload with its CR; see ReplyStyle."""
        return (b"*" if star else b"") + payload.encode("latin-1") + b"\r" + b"*" * trailer

    def bare(self, payload: str) -> bytes:
        """Return a payload without a CR."""
        return b"*" + payload.encode()


DIALECTS: dict[str, ReplyStyle] = {
    "1.05": AcknowledgedFirst("1.05"),
    "1.06": AcknowledgedFirst("1.06"),
    "1.09": ReplyStyle("1.09"),
    "1.10": ReplyStyle("1.10"),
}
