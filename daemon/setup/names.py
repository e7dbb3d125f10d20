"""The steps' names, for the command line: what they do is imported when it is done."""

NAMES = (
    "units",
    "limits",
    "configuration",
    "exercise",
    "record",
    "identify",
    "validate",
    "track",
    "service",
)
