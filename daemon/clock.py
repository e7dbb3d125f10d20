"""The clocks in one place: monotonic for deadlines, wall clock only to label records."""

import time

NS = 1_000_000_000


def monotonic_ns() -> int:
    """Return CLOCK_MONOTONIC in nanoseconds; it does not step when the wall clock is set."""
    return time.monotonic_ns()


def wall_ns() -> int:
    """Return the wall clock in nanoseconds since 1970; it may step."""
    return time.time_ns()


def sleep_s(seconds: float) -> None:
    """Sleep. Only for threads without a deadline."""
    time.sleep(seconds)
