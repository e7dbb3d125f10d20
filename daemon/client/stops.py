"""Counts stops, so that a flight ends when one was requested after the flight was, whether the
flight has begun or still waits for its turn."""


class Stopped(Exception):
    """Raised in a callback to end a trajectory."""


class Stops:
    """Counts the requested stops."""

    def __init__(self) -> None:
        self.count = 0

    def add(self) -> None:
        """Count one more; from any thread. Of two at once one may be lost, and the count differs
        all the same."""
        self.count += 1

    def check(self, before: int) -> None:
        """Raise Stopped if one was requested since there were `before`."""
        if self.count != before:
            raise Stopped
