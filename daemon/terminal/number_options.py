"""Types for argparse of the options that take a number: NaN and infinity are refused, and so is a
number larger than any quantity of a stage or its devices."""

import argparse
import math
import re
from collections.abc import Callable

from dehyst.daemon.printable import brief

LARGEST = 1e12
"""Largest value of any option, in its unit. A rate in nm/s over a metre in a millisecond is 1e12; a
larger number is a slip, and its square would overflow further on."""
LARGEST_WHOLE = 2**63 - 1
"""Largest whole number: those on the bus have 64 bits."""


def number(text: str) -> float:
    """Parse a finite number of at most LARGEST."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        advice = "write it without a unit"
        if re.fullmatch(r"\s*[-+]?\d+,\d+\s*", text):
            advice = f"write {text.strip().replace(',', '.')}, with a point"
        raise argparse.ArgumentTypeError(f"{brief(repr(text))} is not a finite number; {advice}")
    if abs(value) > LARGEST:
        raise argparse.ArgumentTypeError(
            f"{brief(text)} is larger than any quantity of a stage or its devices ({LARGEST:g})"
        )
    return value


def whole(text: str) -> int:
    """Parse a whole number of at most 64 bits."""
    try:
        value = int(text)
    except ValueError:  # also for one of thousands of digits
        raise argparse.ArgumentTypeError(
            f"{brief(repr(text))} is not a whole number; write it without a unit"
        ) from None
    if abs(value) > LARGEST_WHOLE:
        raise argparse.ArgumentTypeError(f"{brief(text)} is larger than {LARGEST_WHOLE}")
    return value


def finite(text: str) -> float:
    """Parse a finite number of a command to the daemon."""
    try:
        return number(text)
    except argparse.ArgumentTypeError as error:
        raise argparse.ArgumentTypeError(
            f"{error} (targets are in the daemon's displacement unit, times in seconds)"
        ) from None


def positive(text: str) -> float:
    """Parse a finite number greater than 0."""
    value = finite(text)
    if value <= 0:
        raise argparse.ArgumentTypeError("must be greater than 0")
    return value


def within(low: float, high: float) -> Callable[[str], float]:
    """Return a function that parses a number from low to high."""

    def parse(text: str) -> float:
        value = finite(text)
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"must be from {low:g} to {high:g}")
        return value

    return parse


def natural(text: str) -> int:
    """Parse a whole number of at least 0."""
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{brief(repr(text))} is not a whole number of at least 0")
    return whole(text)
