"""The clocks, in one place: monotonic for every deadline, wall clock only to label records."""

import time

NS = 1_000_000_000


def monotonic_ns() -> int:
    """Nanoseconds of CLOCK_MONOTONIC; never steps when the wall clock is set."""
    return time.monotonic_ns()


def wall_ns() -> int:
    """Nanoseconds since 1970 by the wall clock; may step."""
    return time.time_ns()


def sleep_s(seconds: float) -> None:
    """Sleep; for threads that have no deadline."""
    time.sleep(seconds)
