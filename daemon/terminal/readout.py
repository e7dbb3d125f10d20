"""The large read-out of a stage: seven-segment figures of three rows, plain characters alone."""

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
    """ROWS lines that show digits, point and minus sign large. Raises KeyError for others."""
    return [" ".join(SEGMENTS[mark][row] for mark in text) for row in range(ROWS)]


def readout(measured: float, target: float, volts: float, unit: str) -> Table:
    """Measured place, large; target, error and output beside it. Displacements in `unit` from the
    set-point origin, NaN: none; volts: V."""
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
