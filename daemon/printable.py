"""Make untrusted text safe to show on a terminal, without control sequences, and to write."""

LONGEST_LINE = 900
"""Characters of a line on the screen; a longer one is an input that was quoted whole."""
NO_FILE_NAME = "ends with a slash, as the name of a folder does; give the name of a file"
"""Why a name with a slash at its end is refused: pathlib would drop the slash."""
LONGEST_QUOTE = 60
"""Characters of a wrong value that an error quotes."""


def printable(text: str) -> str:
    """Return the text with every control character, escape and direction mark escaped."""
    return "".join(
        c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text
    )


def in_utf8(text: str) -> str:
    """Return the text with what UTF-8 has no bytes for escaped, as in a file name that is not
    UTF-8."""
    return text.encode("utf-8", "backslashreplace").decode()


def one_line(text: str) -> str:
    """Return a text as one line for the screen: escaped, and shortened in the middle if long."""
    line = printable(" ".join(text.split()))
    return line if len(line) <= LONGEST_LINE else f"{line[:300]} ... {line[-300:]}"


def brief(text: str) -> str:
    """Return a value as an error quotes it: shortened if it is long."""
    return text if len(text) <= LONGEST_QUOTE else f"{text[:LONGEST_QUOTE]}..."
