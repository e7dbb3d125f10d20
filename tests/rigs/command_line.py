"""A command in this process, as a shell runs it."""

from dehyst.daemon.main import main


def exit_status(words: list[str]) -> int:
    """Run a command; return its exit status, also where the parser of arguments ends it."""
    try:
        return main(words)
    except SystemExit as ended:
        return ended.code if isinstance(ended.code, int) else 1
