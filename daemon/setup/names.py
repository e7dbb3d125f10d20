"""The steps' names, for the command line, which imports the steps themselves only when needed."""

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
