"""The grammar of the General Command Set 2.0 (PI manual PZ250E and the manuals of E-709, E-727).

A line is a command word and its arguments, separated by blanks and ended by LF. Single control
characters are commands that need no LF and are answered even while a line is being received. An
answer of several lines has a blank before each LF except the last. A command that fails gives no
answer; `ERR?` reports the code once.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from enum import IntEnum

LONGEST = 1 << 16
"""Longest line [characters]; motion programs send `WAV ... PNT` in shorter pieces."""
CONTROL = frozenset((4, 5, 7, 9, 24))
"""Single characters that are commands: status, motion, ready, wave generators, stop."""


class GcsCode(IntEnum):
    """GCS error codes that `ERR?` reports."""

    NO_ERROR = 0
    PARAM_SYNTAX = 1
    UNKNOWN_COMMAND = 2
    COMMAND_TOO_LONG = 3
    NO_SERVO = 5
    OUT_OF_LIMITS = 7
    STOP = 10
    INVALID_AXIS = 15
    PARAM_OUT_OF_RANGE = 17
    PARAM_COUNT = 24
    INVALID_NUMBER = 25
    COMMUNICATION = 52
    UNKNOWN_PARAMETER = 54
    WAVE_TOO_LARGE = 67
    DIFFERENT_LENGTH = 70
    WAVE_GENERATOR_ACTIVE = 73
    NO_WAVE_SELECTED = 75


class GcsError(Exception):
    """Raised when a command fails. code: the GCS error code; why: text for the log."""

    def __init__(self, code: GcsCode, why: str) -> None:
        super().__init__(why)
        self.code, self.why = code, why


@dataclass(frozen=True)
class GcsCommand:
    """One command: its word in upper case (`#24` for a control character) and its arguments."""

    word: str
    args: tuple[str, ...] = ()


class Splitter:
    """Splits the bytes of one connection into commands, however they arrive."""

    def __init__(self) -> None:
        self._line = bytearray()
        self._too_long = False

    def feed(self, data: bytes) -> Iterator[GcsCommand]:
        """Yield the commands that these bytes complete, in order. Raises nothing: a line that is
        too long becomes the command "" without arguments."""
        for byte in data:
            if byte in CONTROL:
                yield GcsCommand(f"#{byte}")
            elif byte in b"\r\n":
                line, too_long = bytes(self._line), self._too_long
                self._line.clear()
                self._too_long = False
                if too_long:
                    yield GcsCommand("")
                elif words := line.decode("cp1252", "replace").split():
                    yield GcsCommand(words[0].upper(), tuple(words[1:]))
            elif len(self._line) >= LONGEST:
                self._too_long = True
            else:
                self._line.append(byte)


def parse_number(text: str) -> float:
    """Parse a finite number. Raises GcsError."""
    try:
        value = float(text)
    except ValueError:
        raise GcsError(GcsCode.INVALID_NUMBER, f"{text!r} is not a number") from None
    if not abs(value) < float("inf"):
        raise GcsError(GcsCode.INVALID_NUMBER, f"{text!r} is not finite")
    return value


def integer(text: str, low: int, high: int, what: str) -> int:
    """Parse an integer (hexadecimal with 0x) within low..high. Raises GcsError."""
    try:
        value = int(text, 16) if text.lower().startswith("0x") else int(text)
    except ValueError:
        raise GcsError(GcsCode.PARAM_SYNTAX, f"{what} {text!r} is not a whole number") from None
    if not low <= value <= high:
        raise GcsError(GcsCode.PARAM_OUT_OF_RANGE, f"{what} {value} is not within {low} to {high}")
    return value


def groups(args: Sequence[str], size: int) -> list[tuple[str, ...]]:
    """Return the arguments in groups of `size`, at least one group. Raises GcsError."""
    if not args or len(args) % size:
        raise GcsError(GcsCode.PARAM_COUNT, f"{len(args)} arguments, expected a multiple of {size}")
    return [tuple(args[i : i + size]) for i in range(0, len(args), size)]


def join_lines(texts: Iterable[str]) -> str:
    """Return an answer with one line per text."""
    return " \n".join(texts) + "\n"
