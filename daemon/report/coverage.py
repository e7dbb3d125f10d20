"""Pictures of what a drive covers, for the identification report and for `dehyst excite`."""

import numpy as np
from matplotlib.axes import Axes

from dehyst.daemon.report.plotting import MODEL, UNUSED
from dehyst.models.drive_design.coverage import SIZE_EDGES, Coverage
from dehyst.models.units import spell_unit


def draw_drive_and_rate(covered: Coverage, unit: str, axes: Axes) -> str:
    """Draw how often each drive occurs at each rate."""
    counts = np.where(covered.cells > 0, covered.cells, np.nan).T
    image = axes.pcolormesh(
        covered.drive_edges, covered.rate_edges, np.log10(counts), cmap="viridis"
    )
    title = f"{covered.covered:.0%} of the cells covered (grey: none)"
    unit = spell_unit(unit)
    axes.set(xlabel=f"drive, {unit}", ylabel=f"rate, {unit}/s", facecolor="#e3e3e3", title=title)
    axes.grid(False)
    assert axes.figure is not None
    axes.figure.colorbar(image, ax=axes, label="log10 samples")
    return f"How often each drive occurs at each rate in the recordings: {title}."


def draw_loop_sizes(covered: Coverage, axes: Axes) -> str:
    """Draw a histogram of the drive's travel between two reversals."""
    axes.hist(covered.sizes * 100, bins=np.linspace(0, 101, 41).tolist(), color=MODEL)
    for edge in SIZE_EDGES[1:-1]:
        axes.axvline(edge * 100, color=UNUSED, lw=0.8, ls="--")
    axes.set(
        xlabel="travel between two reversals, % of the range",
        ylabel="count",
        title="loop sizes",
    )
    return f"Loop sizes: {covered.sizes.size} travels between reversals of the drive."
