"""Shared by the clients that keep a stage where it was sent: how often a set-point is repeated,
which refusals of it are temporary, and stops, which end whatever was requested before them."""

POLL_S = 0.02  # longest wait for telemetry before requests are looked at
REPEATS = 4  # set-points sent within the time in which one expires
IN_PASSING = ("late", "flood")
"""Refusals of one message, not of its request: a computer that stalled sent it late."""
SHARE = 0.002
"""Default tolerance as a fraction of the reach."""


class Stopped(Exception):
    """Raised in a callback to end a trajectory."""


class Stops:
    """Counts the requested stops, so that a flight ends if a stop was requested after it, whether
    the flight has begun or is still waiting for its turn."""

    def __init__(self) -> None:
        self.count = 0

    def add(self) -> None:
        """Count one more stop; may be called from any thread. Of two at once one may be lost, but
        the count still changes."""
        self.count += 1

    def check(self, before: int) -> None:
        """Raise Stopped if more than `before` stops have been requested."""
        if self.count != before:
            raise Stopped
