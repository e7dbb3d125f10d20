"""How each firmware of the emulated MDT693B writes its replies, byte by byte.

Recorded: the replies in tests/drivers/test_mdt693b_golden.py. Everything else follows the same
style by assumption; the two that matter to a driver are switches (`range_error` of the knobs,
`compatibility_only`).
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class ReplyStyle:
    """firmware: its number; modern: prompt style; the rest follows from it."""

    firmware: str
    modern: bool

    def ok(self) -> bytes:
        """A set was carried out."""
        return b">" if self.modern else b"*"

    def not_defined(self) -> bytes:
        """A command that the unit does not know, the empty line included."""
        return b"CMD_NOT_DEFINED>" if self.modern else b"!"

    def bad_argument(self, text: bytes) -> bytes:
        """An argument that cannot be used. text: the error that a modern unit writes."""
        return text + b">" if self.modern else b"!"

    def line(self, payload: str, star: bool = True, trailer: bool = False) -> bytes:
        """A payload with its CR. Legacy only: star: "*" before it; trailer: "*" after it."""
        body = payload.encode("latin-1") + b"\r"
        if self.modern:
            return body + b">"
        return (b"*" if star else b"") + body + (b"*" if trailer else b"")

    def bare(self, payload: str) -> bytes:
        """A payload that legacy firmware ends without a CR (the axis limits)."""
        return payload.encode("latin-1") + b"\r>" if self.modern else b"*" + payload.encode()

    def volts(self, volts: float) -> str:
        """One voltage as the ADC reads it, padded to six characters."""
        return f"{volts:6.2f}" if self.modern else f"{volts:6.1f}"

    def limit(self, volts: float) -> str:
        """An axis limit: 0 without decimals, others with those of the dialect."""
        if volts == 0.0:
            return "0"
        return f"{volts:.2f}" if self.modern else f"{volts:.1f}"


DIALECTS = {
    "1.05": ReplyStyle("1.05", modern=False),
    "1.06": ReplyStyle("1.06", modern=False),
    "1.09": ReplyStyle("1.09", modern=True),
    "1.10": ReplyStyle("1.10", modern=True),
}
