"""The large read-out of a stage: seven-segment digits of three rows in plain characters."""

from rich.table import Table
from rich.text import Text

ROWS = 3
SEGMENTS = {
    "0": (" _ ", "| |", "|_|"),
    "1": ("   ", "  |", "  |"),
    "2": (" _ ", " _|", "|_ "),
    "3": (" _ ", " _|", " _|"),
    "4": ("   ", "|_|", "  |"),
    "5": (" _ ", "|_ ", " _|"),
    "6": (" _ ", "|_ ", "|_|"),
    "7": (" _ ", "  |", "  |"),
    "8": (" _ ", "|_|", "|_|"),
    "9": (" _ ", "|_|", " _|"),
    "-": ("   ", " _ ", "   "),
    "+": ("   ", " _ ", "   "),
    ".": (" ", " ", "."),
    " ": ("   ", "   ", "   "),
}


def large(text: str) -> list[str]:
    """Return ROWS lines with the text in large digits, points and signs. Raises KeyError for other
    characters."""
    return [" ".join(SEGMENTS[mark][row] for mark in text) for row in range(ROWS)]


def readout(measured: float, target: float, volts: float, unit: str) -> Table:
    """Return the measured displacement in large digits, with target, error and output to its right.
    Displacements in `unit` from the set-point origin, NaN if there is none; volts [V]."""
    known = measured == measured
    figure = large(f"{measured:.4f}" if known else "-.----")
    figure[-1] += f" {unit}"
    table = Table.grid(padding=(0, 4))
    table.add_column()
    table.add_column()
    error = f"{measured - target:+.4f} {unit}" if known and target == target else "-"
    beside = (
        f"target  {f'{target:.4f} {unit}' if target == target else '-'}",
        f"error   {error}",
        f"output  {volts:.3f} V",
    )
    for row, words in zip(figure, beside, strict=True):
        table.add_row(Text(row, style="bold"), Text(words))
    return table
