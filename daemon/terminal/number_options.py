"""Types of the options that take a number, for argparse: NaN and infinity are no numbers here."""

import argparse
import math
from collections.abc import Callable


def finite(text: str) -> float:
    """Parse a finite number."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(
            f"{text!r} is not a finite number; write it without a unit (targets are in the "
            "daemon's displacement unit, times in seconds)"
        )
    return value


def positive(text: str) -> float:
    """Parse a finite number greater than 0."""
    value = finite(text)
    if value <= 0:
        raise argparse.ArgumentTypeError("must be greater than 0")
    return value


def within(low: float, high: float) -> Callable[[str], float]:
    """Return what parses a number from low to high."""

    def parse(text: str) -> float:
        value = finite(text)
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"must be from {low:g} to {high:g}")
        return value

    return parse


def natural(text: str) -> int:
    """Parse a whole number of at least 0."""
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number of at least 0")
    return int(text)
