"""How each firmware of the emulated MDT693B writes its replies, byte by byte: one row each.

Recorded: the replies in tests/drivers/mdt693b/test_golden.py. Everything else follows the same
style by assumption; the two that matter to a driver are switches (`range_error` of the knobs,
`compatibility_only`). A firmware with other words is a row; one with another framing is a class
and a row. The driver's side is drivers/mdt693b/dialects.py.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class ReplyStyle:
    """The style with a prompt behind each reply, firmware from 1.09 on.

    firmware: its number, as id? shows it; unknown: what it says to a command that it does not
    know; decimals: of a voltage; knows_xyz: whether it has xyzvoltage; restored: its answer to
    restore.
    """

    firmware: str
    prompt: bytes = b">"
    unknown: bytes = b"CMD_NOT_DEFINED"
    decimals: int = 2
    knows_xyz: bool = True
    restored: bytes = b">"

    def ok(self) -> bytes:
        """A set was carried out."""
        return self.prompt

    def not_defined(self) -> bytes:
        """A command that the unit does not know, the empty line included."""
        return self.unknown + self.prompt

    def bad_argument(self, text: bytes) -> bytes:
        """An argument that cannot be used. text: the error that a unit with a prompt writes."""
        return text + self.prompt

    def line(self, payload: str, star: bool = True, trailer: bool = False) -> bytes:
        """A payload with its CR. Without a prompt only: star: "*" before it; trailer: "*" after
        it."""
        return payload.encode("latin-1") + b"\r" + self.prompt

    def bare(self, payload: str) -> bytes:
        """A payload that firmware without a prompt ends without a CR (the axis limits)."""
        return payload.encode("latin-1") + b"\r" + self.prompt

    def volts(self, volts: float) -> str:
        """One voltage as the ADC reads it, padded to six characters."""
        return f"{volts:6.{self.decimals}f}"

    def limit(self, volts: float) -> str:
        """An axis limit: 0 without decimals, others with those of the dialect."""
        return "0" if volts == 0.0 else f"{volts:.{self.decimals}f}"


@dataclass(frozen=True)
class AcknowledgedFirst(ReplyStyle):
    """The style with an acknowledgement in front of each reply, firmware up to 1.06."""

    prompt: bytes = b""
    unknown: bytes = b"!"
    decimals: int = 1
    knows_xyz: bool = False
    restored: bytes = b"**"

    def ok(self) -> bytes:
        """A set was carried out."""
        return b"*"

    def bad_argument(self, text: bytes) -> bytes:
        """The same as for an unknown command."""
        return self.unknown

    def line(self, payload: str, star: bool = True, trailer: bool = False) -> bytes:
        """A payload with its CR; see ReplyStyle."""
        return (b"*" if star else b"") + payload.encode("latin-1") + b"\r" + b"*" * trailer

    def bare(self, payload: str) -> bytes:
        """A payload without a CR."""
        return b"*" + payload.encode()


DIALECTS: dict[str, ReplyStyle] = {
    "1.05": AcknowledgedFirst("1.05"),
    "1.06": AcknowledgedFirst("1.06"),
    "1.09": ReplyStyle("1.09"),
    "1.10": ReplyStyle("1.10"),
}
