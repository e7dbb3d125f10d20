"""What clients share that keep a stage where it was sent: how often a set-point is repeated, which
refusals of it pass, and the stops that end what was requested before them."""

POLL_S = 0.02
REPEATS = 4  # set-points sent within the time in which one expires
IN_PASSING = ("late", "flood")
"""Refusals of one message, not of what it asks for: a computer that stands still sends it late."""
SHARE = 0.002
"""Default tolerance as a fraction of the reach."""


class Stopped(Exception):
    """Raised in a callback to end a trajectory."""


class Stops:
    """Counts the requested stops, so that a flight ends when one was requested after it was,
    whether the flight has begun or still waits for its turn."""

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
