"""Text from elsewhere as a terminal may show it: nothing in it is a command to the terminal."""


def printable(text: str) -> str:
    """The text with every control character, escape and direction mark written out."""
    return "".join(
        c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text
    )
