"""Make untrusted text safe to show on a terminal, without control sequences."""


def printable(text: str) -> str:
    """Return the text with every control character, escape and direction mark escaped."""
    return "".join(
        c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text
    )
