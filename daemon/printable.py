"""Make untrusted text safe to show on a terminal, without control sequences, and to write."""


def printable(text: str) -> str:
    """Return the text with every control character, escape and direction mark escaped."""
    return "".join(
        c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text
    )


def in_utf8(text: str) -> str:
    """Return the text with what UTF-8 has no bytes for escaped, as in a file name that is not
    UTF-8."""
    return text.encode("utf-8", "backslashreplace").decode()


def how_many(count: int, one: str, many: str = "") -> str:
    """Return a count with its noun: how_many(2, "row") is "2 rows". many: the plural, where it is
    not formed with an s."""
    return f"{count} {one}" if count == 1 else f"{count} {many or one + 's'}"
