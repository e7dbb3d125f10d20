"""The console of rich on stdout, which leaves the end of the process to the command line."""

from typing import NoReturn

from rich.console import Console


class StdoutConsole(Console):
    """A console on stdout. A reader that has gone, as in `| head`, ends the command as it does
    without rich: with exit status 0."""

    def on_broken_pipe(self) -> NoReturn:
        """Raise the BrokenPipeError that is being handled; rich would end the process with 1."""
        raise BrokenPipeError
