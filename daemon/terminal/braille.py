"""Draw curves in a terminal; each character cell has 2 by 4 braille dots. No library, no state."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from rich.console import Console, ConsoleOptions, RenderResult
from rich.text import Text

# bit of the dot in column x (0, 1) and row y (0..3, from the top): Unicode, braille patterns
_BITS = np.array([[0x01, 0x02, 0x04, 0x40], [0x08, 0x10, 0x20, 0x80]])
_LABEL = 9  # width of the numbers to the left of the plot


@dataclass
class Curve:
    """One curve. values: (n,), NaN is not drawn; colour: a rich colour name."""

    name: str
    values: NDArray[np.float64]
    colour: str


@dataclass
class Plot:
    """Curves over the same x, drawn into the space that rich assigns. x: (n,) [s], ascending."""

    x: NDArray[np.float64]
    curves: list[Curve]
    unit: str

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        width = max(4, options.max_width - _LABEL - 1)
        height = max(2, (options.height or 12) - 1)
        values = np.concatenate([c.values for c in self.curves] or [np.zeros(0)])
        values = values[np.isfinite(values)]
        if self.x.size == 0 or values.size == 0:
            yield Text("nothing to draw yet")
            return
        low, high = float(values.min()), float(values.max())
        if high - low < 1e-9 * max(1.0, abs(high)):
            low, high = low - 0.5, high + 0.5
        cells, owners = self._cells(width, height, low, high)
        for row in range(height):
            label = ""
            if row in (0, height // 2, height - 1):
                label = f"{high - (high - low) * row / (height - 1):.4g}"
            line = Text(f"{label:>{_LABEL}} ")
            for code, owner in zip(cells[row], owners[row], strict=True):
                colour = self.curves[owner].colour if code else ""
                line.append(chr(0x2800 + int(code)), style=colour)
            yield line
        foot = Text(f"{self.unit:>{_LABEL}} {self.x[0]:.3g} to {self.x[-1]:.3g} s  ")
        for curve in self.curves:
            foot.append(f"  {curve.name}", style=curve.colour)
        yield foot

    def _cells(
        self, width: int, height: int, low: float, high: float
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return (height, width) braille bits, and the number of the curve that colours a cell."""
        cells = np.zeros((height, width), np.int64)
        owners = np.zeros((height, width), np.int64)
        span = max(float(self.x[-1] - self.x[0]), 1e-12)
        columns = np.floor((self.x - self.x[0]) / span * (2 * width - 1)).astype(np.int64)
        for number, curve in enumerate(self.curves):
            rows = (high - curve.values) / (high - low) * (4 * height - 1)
            for column in range(2 * width):
                first, end = np.searchsorted(columns, [column, column + 1])
                inside = rows[first:end]
                inside = inside[np.isfinite(inside)]
                if not inside.size:
                    continue
                # the curve's range within one dot's width, drawn as a vertical line
                for dot in range(round(float(inside.min())), round(float(inside.max())) + 1):
                    cells[dot // 4, column // 2] |= _BITS[column % 2, dot % 4]
                    owners[dot // 4, column // 2] = number
        return cells, owners
