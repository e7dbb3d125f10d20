"""Pictures of a diagnosis: errors before and after, where the misfit sits, its spectrum.

Every function returns a PNG as bytes. The colours stay the same throughout: the hysteresis model
alone grey, the augmented model blue, the noise green.
"""

import io
from collections.abc import Callable
from typing import Any

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.signal import welch

from dehyst.models.diagnosis import Diagnosis, View
from dehyst.models.recording import Floats

GREY, BLUE, NOISE = "#9a9a9a", "#1f5fbf", "#2e8b57"
MODELS = (
    ("base", GREY, "hysteresis model alone"),
    ("augmented", BLUE, "augmented model"),
)
STYLE: Any = {"font.size": 10, "axes.grid": True, "grid.alpha": 0.3, "axes.spines.top": False,
         "axes.spines.right": False}  # fmt: skip
MOST_POINTS = 4000
MOST_VIEWS = 4
STILL = 1e-3  # share of the drive's range within 20 ms below which the drive holds


def _png(figure: Figure) -> bytes:
    out = io.BytesIO()
    figure.savefig(out, format="png", dpi=100, metadata={"Software": ""})
    plt.close(figure)
    return out.getvalue()


def scale(diagnosis: Diagnosis) -> tuple[float, str]:
    """Factor and unit in which small displacements are shown: nanometres for micrometres."""
    return (1e3, "nm") if diagnosis.unit == "um" else (1.0, diagnosis.unit)


def written(unit: str) -> str:
    """A unit as it is written: the columns' v is V, um stays."""
    return "V" + unit[1:] if unit == "v" or unit.startswith("v/") else unit.replace("/v", "/V")


def errors(diagnosis: Diagnosis) -> bytes:
    """Per recording: the error over time, and a close look where the gain is greatest."""
    views = diagnosis.views[:MOST_VIEWS]
    k, unit = scale(diagnosis)
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(
            len(views), 2, figsize=(12, 0.6 + 2.7 * len(views)), squeeze=False,
            width_ratios=(2, 1), layout="constrained",
        )  # fmt: skip
        for row, view in zip(axes, views, strict=True):
            _error_over_time(row[0], view, diagnosis.noise, k, unit)
            _close_look(row[1], view, diagnosis.unit)
        handles: list[Artist] = [plt.Line2D([], [], color=c, lw=2) for _, c, _ in MODELS]
        handles.append(plt.Rectangle((0, 0), 1, 1, color=NOISE, alpha=0.35))
        labels = [*(m[2] for m in MODELS), "noise, two sigma"]
        figure.legend(handles, labels, loc="outside upper left", ncols=3, frameon=False)
    return _png(figure)


def _envelope(ax: Axes, t: Floats, e: Floats, color: str) -> None:
    """A long error as the band between its extremes, a short one as a line."""
    if e.size <= MOST_POINTS:
        ax.plot(t, e, color=color, lw=0.8)
        return
    each = -(-e.size // (MOST_POINTS // 4))
    cut = (e.size // each) * each
    blocks = e[:cut].reshape(-1, each)
    with np.errstate(all="ignore"):
        ax.fill_between(
            t[:cut:each], np.nanmin(blocks, 1), np.nanmax(blocks, 1), color=color, lw=0.4
        )


def _error_over_time(ax: Axes, view: View, noise: float, k: float, unit: str) -> None:
    before, after = view.displacement - view.base, view.displacement - view.augmented
    _envelope(ax, view.t_s, k * before, GREY)
    _envelope(ax, view.t_s, k * after, BLUE)
    ax.axhspan(-2 * k * noise, 2 * k * noise, color=NOISE, alpha=0.35, lw=0, zorder=3)
    rms = [k * float(np.sqrt(np.mean(e[view.held_out] ** 2))) for e in (before, after)]
    ax.set_title(
        f"{view.name}: error {rms[0]:.3g} {unit} before, {rms[1]:.3g} {unit} after", loc="left"
    )
    limit = k * float(np.quantile(np.abs(before), 0.999)) * 1.15
    ax.set_ylim(-limit, limit) if limit > 0 else None
    ax.set_xlabel("time / s")
    ax.set_ylabel(f"measured - model / {unit}")


def _close_look(ax: Axes, view: View, unit: str) -> None:
    """The stretch of 2 % in which the augmented model gains most."""
    gain = (view.displacement - view.base) ** 2 - (view.displacement - view.augmented) ** 2
    width = max(60, min(gain.size // 50, 1500))
    sums = np.convolve(np.where(np.isfinite(gain), gain, 0.0), np.ones(width), "valid")
    start = int(np.argmax(sums)) if sums.size else 0
    part = slice(start, start + width)
    t = view.t_s[part]
    ax.plot(t, view.displacement[part], ".", color="black", ms=2, label="measured")
    for name, color, label in MODELS:
        ax.plot(t, getattr(view, name)[part], color=color, lw=1.5, label=label)
    ax.set_title("where it helps most", loc="left")
    ax.set_xlabel("time / s")
    ax.set_ylabel(f"displacement / {unit}")
    ax.ticklabel_format(useOffset=False)


def spectrum(diagnosis: Diagnosis) -> bytes:
    """Amplitude density of the errors against the noise floor, all recordings together."""
    k, unit = scale(diagnosis)
    with plt.rc_context(STYLE):
        figure, ax = plt.subplots(figsize=(12, 3.6), layout="constrained")
        longest = max(diagnosis.views, key=lambda v: v.t_s.size)
        views = [v for v in diagnosis.views if 4 * v.t_s.size >= longest.t_s.size]
        for name, color, label in MODELS:
            f, p = _banded(*_mean_spectrum(views, name))
            ax.loglog(f, k * np.sqrt(p), color=color, lw=1.6, label=label)
        period = float(np.median(np.diff(longest.t_s)))
        flat = k * diagnosis.noise * np.sqrt(2 * period)
        ax.axhline(flat, color=NOISE, lw=2, alpha=0.7, label="noise, if white")
        ax.set_xlabel("frequency / Hz")
        ax.set_ylabel(f"error / ({unit} / sqrt(Hz))")
        ax.legend(frameon=False, ncols=4, loc="upper right")
    return _png(figure)


def _mean_spectrum(views: list[View], name: str) -> tuple[Floats, Floats]:
    size = max(256, min(8192, min(v.t_s.size for v in views)))
    total, f = None, np.zeros(0)
    for v in views:
        e = v.displacement - getattr(v, name)
        e = np.where(np.isfinite(e), e, 0.0)
        period = float(np.median(np.diff(v.t_s)))
        f, p = welch(e, 1 / period, nperseg=min(size, e.size), detrend="constant")
        total = p if total is None else total[: p.size] + p[: total.size]
    assert total is not None
    return f[: total.size], total / len(views)


def _banded(f: Floats, p: Floats) -> tuple[Floats, Floats]:
    """Means over 24 bands a decade, so that lines stay and grass goes."""
    band = np.round(24 * np.log10(f[1:])).astype(int)
    _, index, count = np.unique(band, return_inverse=True, return_counts=True)
    return np.bincount(index, f[1:]) / count, np.bincount(index, p[1:]) / count


def locate(diagnosis: Diagnosis) -> bytes:
    """Rms of the error by time, drive and direction, rate, time since the turn and in holds."""
    _, unit = scale(diagnosis)
    views = diagnosis.views
    drive = np.concatenate([v.drive for v in views])
    span = float(np.ptp(drive)) or 1.0
    rate = np.concatenate([np.abs(_rate(v)) for v in views])
    since = np.concatenate([_since_turn(v, span) for v in views])
    held = np.concatenate([_in_hold(v, span) for v in views])
    rising = np.concatenate([_last_direction(v) for v in views]) > 0
    clock, edge = [], 0.0
    for v in views:
        clock.append(v.t_s - v.t_s[0] + edge)
        edge += float(v.t_s[-1] - v.t_s[0])
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(2, 3, figsize=(12, 6.4), layout="constrained")
        place = np.concatenate(clock)
        _panel(
            axes[0, 0], diagnosis, place, np.linspace(0, place[-1], 31), "time, all recordings / s"
        )
        volts = np.linspace(drive.min(), drive.max(), 16)
        volts_unit = written(diagnosis.drive_unit)
        label = f"drive / {volts_unit}"
        _panel(axes[0, 1], diagnosis, drive, volts, f"{label}, moving up", rising)
        _panel(axes[0, 2], diagnosis, drive, volts, f"{label}, moving down", ~rising)
        top = float(np.quantile(rate, 0.9999)) or 1.0
        _panel(
            axes[1, 0], diagnosis, rate, np.geomspace(max(top * 1e-4, 1e-9), top, 16),
            f"rate / ({volts_unit}/s)",
        )  # fmt: skip
        _panel(axes[1, 1], diagnosis, since, _log_edges(since), "since the last turn / s")
        _panel(axes[1, 2], diagnosis, held, _log_edges(held), "in a hold since / s", held > 0)
        for ax in axes[:, 0]:
            ax.set_ylabel(f"rms error / {unit}")
        handles, labels = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper left", ncols=4, frameon=False)
    return _png(figure)


def _panel(
    ax: Axes, diagnosis: Diagnosis, place: Floats, edges: Floats, label: str,
    where: np.ndarray | None = None,
) -> None:  # fmt: skip
    """Steps of the rms in each bin for the three models, and the noise."""
    k, _ = scale(diagnosis)
    ok = np.isfinite(place) if where is None else np.isfinite(place) & where
    if edges.size < 2 or ok.sum() < 50:
        ax.text(0.5, 0.5, "these recordings\nhave none", ha="center", va="center",
                transform=ax.transAxes, color="#666666")  # fmt: skip
        ax.set_xlabel(label)
        return
    index = np.digitize(place[ok], edges) - 1
    for name, color, text in MODELS:
        e = np.concatenate([v.displacement - getattr(v, name) for v in diagnosis.views])[ok]
        rms = _rms_in(index, e, edges.size - 1) * k
        ax.stairs(rms, edges, color=color, lw=2, label=text, baseline=None)
    ax.axhline(k * diagnosis.noise, color=NOISE, lw=2, alpha=0.7, label="noise")
    if edges[0] > 0 and edges[-1] / edges[0] > 50:
        ax.set_xscale("log")
    ax.set_ylim(bottom=0)
    ax.set_xlabel(label)


def _rms_in(index: np.ndarray, e: Floats, count: int) -> Floats:
    ok = (index >= 0) & (index < count) & np.isfinite(e)
    number = np.bincount(index[ok], minlength=count)
    power = np.bincount(index[ok], e[ok] ** 2, minlength=count)
    return np.where(number >= 8, np.sqrt(power / np.maximum(number, 1)), np.nan)


def _log_edges(x: Floats) -> Floats:
    good = x[np.isfinite(x) & (x > 0)]
    if good.size < 50:
        return np.zeros(0)
    return np.geomspace(max(good.min(), good.max() * 1e-5), good.max() * 1.0001, 16)


def _rate(view: View) -> Floats:
    return np.gradient(view.drive, view.t_s)


def _last_direction(view: View) -> Floats:
    return _carried(np.sign(np.diff(view.drive, prepend=view.drive[0])), lambda s: s != 0)


def _carried(x: Floats, good: Callable[[Floats], np.ndarray]) -> Floats:
    """Every sample holds the last good value before it."""
    at = np.where(good(x), np.arange(x.size), 0)
    return np.asarray(x[np.maximum.accumulate(at)])


def _since_turn(view: View, span: float) -> Floats:
    direction = _last_direction(view)
    turn = np.r_[True, np.diff(direction) != 0]
    start = np.maximum.accumulate(np.where(turn, np.arange(turn.size), 0))
    return view.t_s - view.t_s[start] + float(np.median(np.diff(view.t_s)))


def _in_hold(view: View, span: float) -> Floats:
    """Time since the drive came to rest; 0 where it moves."""
    moves = np.abs(np.diff(view.drive, prepend=view.drive[0])) > STILL * span / 20
    start = np.maximum.accumulate(np.where(moves, np.arange(moves.size), 0))
    return np.where(moves, 0.0, view.t_s - view.t_s[start])
