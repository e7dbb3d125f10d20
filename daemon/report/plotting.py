"""Common style of all pictures. Uses matplotlib without a display and without global state.

A picture is a function that draws on the given axes and returns one sentence that describes it,
used as its alternative text. The same function serves a report, where each picture is shown
separately and must be legible on a phone, and an image file, where several are shown side by side.
"""

import io
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from textwrap import fill
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from dehyst.models.recording import Floats

Draw = Callable[[Axes], str]

# Each colour has one meaning. They can be distinguished by the colour-blind (Okabe and Ito).
MEASURED = "#333333"
MODEL = "#0072b2"  # the picture's own model: identified, augmented, compensating
BEFORE = "#d55e00"  # the reference: the previous model, the linear gain
NOISE = "#009e73"
UP, DOWN = "#a0569b", "#c28a00"  # drive rising, drive falling
UNUSED = "#9a9a9a"

STYLE: Any = {
    "font.size": 10,
    "axes.titlesize": 10.5,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "axes.axisbelow": True,
    "axes.formatter.useoffset": False,
    "figure.facecolor": "white",
    "legend.frameon": False,
    "legend.fontsize": 8.5,
}
SIZE = (4.8, 3.2)  # inches: text stays legible when the picture fills a phone screen
DPI = 160
MOST_POINTS = 4000  # of a curve: several per pixel
MOST_ROWS = 2**21  # of a recording for a spectrum or a mean: copies of all rows fill memory


def draw_picture(draw: Draw) -> tuple[bytes, str]:
    """Return (PNG, description) of one picture."""
    with _style():
        fig, (axes,) = _figure(1, SIZE)
        shows = _draw_on(axes, draw)
        return _png(fig, DPI), shows


def draw_side_by_side(draws: Sequence[Draw], widths: Sequence[float]) -> bytes:
    """Return a PNG of several pictures in a row. widths: relative widths."""
    with _style():
        fig, panels = _figure(len(draws), (4.2 * len(draws), 3.8), widths)
        for draw, axes in zip(draws, panels, strict=True):
            _draw_on(axes, draw)
        return _png(fig, 110)


def draw_rows(rows: Sequence[Sequence[Draw]]) -> bytes:
    """Return a PNG of several rows of pictures; the pictures of a row share its width."""
    with _style():
        fig = Figure(figsize=(11.0, 3.4 * len(rows)), layout="constrained")
        FigureCanvasAgg(fig)
        parts: Any = fig.subfigures(len(rows), 1, squeeze=False)
        for part, draws in zip(parts[:, 0], rows, strict=True):
            panels = np.ravel(part.subplots(1, len(draws), squeeze=False))
            for draw, axes in zip(draws, panels, strict=True):
                _draw_on(axes, draw)
        return _png(fig, 110)


@contextmanager
def _style() -> Iterator[None]:
    """Apply the style. Warnings of numpy and matplotlib while drawing do not concern the reader."""
    with mpl.rc_context(STYLE), warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        yield


def _draw_on(axes: Axes, draw: Draw) -> str:
    """Draw a picture and return its description. If drawing fails, a message takes its place, so
    that a report loses no finding because a recording cannot be drawn."""
    try:
        shows = draw(axes)
        axes.get_tightbbox()  # computes scales and ticks, so that a failure occurs here
    except Exception as error:  # any failure: the other pictures and the text are kept
        says = f"This picture could not be drawn: {str(error) or type(error).__name__}"
        for part in axes.get_children():
            part.set_visible(False)
        axes.set(xscale="linear", yscale="linear")
        axes.text(
            0.5,
            0.5,
            fill(says, 36),
            ha="center",
            va="center",
            transform=axes.transAxes,
            parse_math=False,
        )
        return says
    return shows


def _figure(
    columns: int, size: tuple[float, float], widths: Sequence[float] | None = None
) -> tuple[Figure, Any]:
    fig = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(fig)
    return fig, np.ravel(fig.subplots(1, columns, squeeze=False, width_ratios=widths))


def _png(fig: Figure, dpi: int) -> bytes:
    """Return the PNG without metadata that changes from run to run."""
    out = io.BytesIO()
    fig.savefig(out, format="png", dpi=dpi, metadata={"Software": ""})
    return out.getvalue()


def draw_trace(axes: Axes, t_s: Floats, values: Floats, color: str, label: str) -> None:
    """Draw a curve over time; draw a long one as the band between its extremes, so that no peak is
    lost.

    t_s, values: (M,); NaN values leave a gap.
    """
    if values.size <= MOST_POINTS:
        axes.plot(t_s, values, color=color, lw=0.8, label=label)
        return
    each = -(-values.size // (MOST_POINTS // 4))
    cut = (values.size // each) * each
    blocks = values[:cut].reshape(-1, each)
    low, high = np.fmin.reduce(blocks, 1), np.fmax.reduce(blocks, 1)
    axes.fill_between(t_s[:cut:each], low, high, color=color, lw=0.4, label=label)


def scale_by_decades(axes: Axes, y: bool = False) -> None:
    """Make the x axis logarithmic, and with `y` the y axis too; call after the curves are drawn. An
    axis without positive data stays linear."""
    data = axes.dataLim
    if np.isfinite(data.minposx):
        axes.set_xscale("log")
    if y and np.isfinite(data.minposy):
        axes.set_yscale("log")


def thin_rows(*columns: Any) -> list[Any]:
    """Return every k-th row, at most MOST_POINTS rows."""
    step = 1 + columns[0].size // MOST_POINTS
    return [c[::step] for c in columns]


def draw_noise_band(axes: Axes, noise: float) -> None:
    """Draw the band of two standard deviations of the noise around zero."""
    axes.axhspan(
        -2 * noise, 2 * noise, color=NOISE, alpha=0.35, lw=0, zorder=3, label="noise, two sigma"
    )


def limit_to(axes: Axes, error: Floats) -> None:
    """Set the axis limits to show all but the largest thousandth of an error (M,)."""
    error = error[:: 1 + error.size // MOST_ROWS]
    good = np.abs(error[np.isfinite(error)])
    top = float(np.quantile(good, 0.999)) if good.size else 0.0
    if top > 0:
        axes.set_ylim(-1.2 * top, 1.2 * top)


def estimate_density(errors: Sequence[Floats], period_s: float) -> tuple[Floats, Floats]:
    """Return (frequencies [Hz], amplitude density [unit/sqrt(Hz)]) of errors (M_i,), averaging
    their power.

    Uses Welch's method, then averages in 24 bands per decade, which keeps spectral lines and
    smooths noise. NaN counts as zero. Of a long error, the last MOST_ROWS up to the last known
    value are used. Empty if an error has only one row.
    """
    from scipy.signal import welch  # imported here: it loads all of scipy's statistics

    size = min(8192, *(e.size for e in errors))
    if size < 2:
        return np.zeros(0), np.zeros(0)
    power = []
    for error in errors:
        end = max(size, error.size - int(np.argmax(np.isfinite(error[::-1]))))
        error = error[max(0, end - MOST_ROWS) : end]
        known = np.where(np.isfinite(error), error, 0.0)
        f, p = welch(known, 1 / period_s, nperseg=size, detrend="constant")
        power.append(p[1:])
    mean, f = np.mean(power, axis=0), f[1:]
    _, index, count = np.unique(
        np.round(24 * np.log10(f)).astype(int), return_inverse=True, return_counts=True
    )
    return np.bincount(index, f) / count, np.sqrt(np.bincount(index, mean) / count)


def add_legend(axes: Axes, share: float = 0.3) -> None:
    """Add a legend above the curves, in additional height of this share."""
    low, high = axes.get_ylim()
    if axes.get_yscale() == "log":
        axes.set_ylim(low, high * (high / low) ** share)
    else:
        axes.set_ylim(low, high + share * (high - low))
    axes.legend(loc="upper left", ncols=2)


def draw_white_noise(axes: Axes, noise: float, period_s: float) -> None:
    """Draw the amplitude density that white noise of this rms would have."""
    density = white_density(noise, period_s)
    axes.axhline(density, color=NOISE, lw=2, alpha=0.7, label="noise, if white")


def white_density(noise: float, period_s: float) -> float:
    """Return the amplitude density of white noise of this rms [unit/sqrt(Hz)]."""
    return float(noise * np.sqrt(2 * period_s))
