"""One look for every picture. matplotlib without a display and without global state."""

import io
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

STYLE: Any = {
    "font.size": 10,
    "axes.titlesize": 11,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "axes.axisbelow": True,
    "figure.facecolor": "white",
}


def figure(
    rows: int,
    columns: int,
    size: tuple[float, float],
    widths: tuple[float, ...] | None = None,
) -> tuple[Figure, Any]:
    """(figure, flat array of axes). size in inches; widths: relative widths of the columns."""
    with mpl.rc_context(STYLE):
        fig = Figure(figsize=size, layout="constrained")
        FigureCanvasAgg(fig)
        axes = fig.subplots(rows, columns, squeeze=False, width_ratios=widths)
    return fig, np.ravel(axes)


def png(fig: Figure, dpi: int = 110) -> bytes:
    """The picture as PNG bytes, without anything that changes from run to run."""
    out = io.BytesIO()
    fig.savefig(out, format="png", dpi=dpi, metadata={"Software": ""})
    return out.getvalue()


def save(fig: Figure, path: Path) -> None:
    """Write the picture as PNG."""
    path.write_bytes(png(fig))
