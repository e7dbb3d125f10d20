"""Pictures of an identification, each as PNG bytes."""

from typing import Any

import numpy as np
from scipy.signal import welch

from dehyst.daemon.plotting import figure, png
from dehyst.models.coverage import SIZE_EDGES, Coverage
from dehyst.models.identify import Identification
from dehyst.models.recording import Floats, Recording

MEASURED, MODEL, UP, DOWN = "#444444", "#d1495b", "#1f77b4", "#e08e0b"
POINTS = 6000
CYCLES_SHOWN = 3


def _thin(*columns: Any) -> list[Any]:
    step = 1 + columns[0].size // POINTS
    return [c[::step] for c in columns]


def time_and_loop(result: Identification, recording: Recording, number: int) -> bytes:
    """Measured and model over a few cycles, and over the drive."""
    fig, (time, loop) = figure(1, 2, (12, 4.2), (1.5, 1))
    y = _measured(recording)
    model = y - result.residuals[number]
    start, stop = _few_cycles(recording, result, number)
    part = slice(start, stop)
    t, m, w = _thin(recording.t_s[part], y[part], model[part])
    time.plot(t, m, ".", color=MEASURED, ms=2.5, label="measured")
    time.plot(t, w, color=MODEL, lw=1.2, label="model")
    time.set(xlabel="time, s", ylabel=f"displacement, {recording.displacement_unit}",
             title="a few cycles")  # fmt: skip
    time.legend(loc="upper right")
    u, m, w = _thin(recording.drive[part], y[part], model[part])
    loop.plot(u, m, ".", color=MEASURED, ms=2.5)
    loop.plot(u, w, color=MODEL, lw=1.2)
    loop.set(xlabel=f"drive, {recording.drive_unit}", title="the same over the drive",
             ylabel=f"displacement, {recording.displacement_unit}")  # fmt: skip
    return png(fig)


def residual(result: Identification, recording: Recording, number: int) -> bytes:
    """The residual over time, over the drive by direction, and its spectrum."""
    fig, axes = figure(1, 3, (13, 4.0), (1.3, 1, 1.1))
    error = result.residuals[number]
    unit, scale = _small_unit(recording.displacement_unit, float(np.nanstd(error)))
    e = error * scale
    noise = result.noise_rms * scale
    over_time, over_drive, spectrum = axes
    used = result.used[number]
    t, shown, kept = _thin(recording.t_s, e, used)
    over_time.plot(t[~kept], shown[~kept], ".", color="#bbbbbb", ms=2, label="not fitted")
    over_time.plot(t[kept], shown[kept], ".", color=MODEL, ms=2, label="fitted")
    over_time.axhspan(-2 * noise, 2 * noise, color="#2e8b57", alpha=0.18, lw=0, label="2 x noise")
    _limits(over_time, e[used])
    over_time.set(xlabel="time, s", ylabel=f"measured - model, {unit}", title="over time")
    over_time.legend(loc="upper right", fontsize=8)
    _over_drive(over_drive, recording, e, used, unit)
    _spectrum(spectrum, recording, e, noise, unit)
    return png(fig)


def _over_drive(axis: Any, recording: Recording, e: Floats, used: Any, unit: str) -> None:
    step = np.gradient(np.nan_to_num(recording.drive, nan=0.0))
    for way, color, label in ((step > 0, UP, "drive rising"), (step < 0, DOWN, "drive falling")):
        at = used & way
        u, shown = _thin(recording.drive[at], e[at]) if at.any() else (e[:0], e[:0])
        axis.plot(u, shown, ".", color=color, ms=1.5, alpha=0.35)
        if at.sum() > 200:
            edges = np.quantile(recording.drive[at], np.linspace(0, 1, 31))
            index = np.clip(np.searchsorted(edges, recording.drive[at]) - 1, 0, 29)
            mean = [np.mean(e[at][index == i]) if np.any(index == i) else np.nan for i in range(30)]
            axis.plot(0.5 * (edges[1:] + edges[:-1]), mean, color=color, lw=2, label=label)
    _limits(axis, e[used])
    axis.set(xlabel=f"drive, {recording.drive_unit}", title=f"over the drive, {unit}")
    axis.legend(loc="upper right", fontsize=8)


def _spectrum(axis: Any, recording: Recording, e: Floats, noise: float, unit: str) -> None:
    rate = 1.0 / recording.period_s
    known = np.where(np.isnan(e), 0.0, e)
    size = int(min(known.size, 8192))
    f, power = welch(known, rate, nperseg=size)
    axis.loglog(f[1:], np.sqrt(power[1:]), color=MODEL, lw=1)
    axis.axhline(noise * np.sqrt(2.0 / rate), color="#2e8b57", lw=2, alpha=0.7)
    axis.text(0.02, 0.04, "green: white noise of the estimated size", transform=axis.transAxes,
              fontsize=8, color="#2e8b57")  # fmt: skip
    axis.set(xlabel="frequency, Hz", title=f"spectrum, {unit}/√Hz")


def coverage(covered: Coverage, unit: str) -> bytes:
    """Drive against rate, and the sizes of the travels between turns."""
    fig, (plane, sizes) = figure(1, 2, (11, 3.8), (1.2, 1))
    counts = np.where(covered.cells > 0, covered.cells, np.nan).T
    image = plane.pcolormesh(covered.drive_edges, covered.rate_edges, np.log10(counts),
                             cmap="viridis")  # fmt: skip
    plane.set(xlabel=f"drive, {unit}", ylabel=f"rate, {unit}/s", facecolor="#f3d9d9",
              title=f"{covered.covered:.0%} of the cells covered (pink: never)")  # fmt: skip
    plane.grid(False)
    fig.colorbar(image, ax=plane, label="log10 samples")
    sizes.hist(covered.sizes * 100, bins=np.linspace(0, 101, 41), color=UP)
    for edge in SIZE_EDGES[1:-1]:
        sizes.axvline(edge * 100, color="#999999", lw=0.8, ls="--")
    sizes.set(xlabel="travel between two turns, % of the range", ylabel="how often",
              title="sizes of the loops")  # fmt: skip
    return png(fig)


def slopes(result: Identification) -> bytes:
    """Slopes after a reversal with their 95 % intervals."""
    fig, (axis,) = figure(1, 1, (8, 3.6))
    h = result.model.hysteresis
    n, rate = h.n, result.model.validity.rate_max
    parts = [("", slice(0, n), UP)]
    if result.shape.rate:
        at = f"{rate:.3g} {result.model.drive_unit}/s"
        parts = [(f"at +{at}", slice(0, n), UP), (f"at -{at}", slice(n, 2 * n), DOWN)]
    for label, part, color in parts:
        slope, error = result.params.slopes[part], 1.96 * result.errors.slopes[part]
        axis.errorbar(h.r, slope, error, fmt="o-", ms=4, color=color, capsize=3, lw=1, label=label)
    smallest = h.r[h.r > 0].min() if np.any(h.r > 0) else 1.0
    axis.set_xscale("symlog", linthresh=float(smallest))
    top = float(np.max(result.params.slopes))
    axis.set_ylim(-0.05 * top, 1.4 * top)
    axis.set(xlabel=f"threshold, {result.model.drive_unit}", ylabel="slope dz/du",
             title="slope after a reversal, by threshold passed")  # fmt: skip
    if result.shape.rate:
        axis.legend(fontsize=8)
    return png(fig)


def orders(result: Identification) -> bytes:
    """Held-out error against the number of operators."""
    fig, (axis,) = figure(1, 1, (8, 3.0))
    count, rms = np.array(result.orders).T
    unit, scale = _small_unit(result.model.displacement_unit, float(np.min(rms)))
    axis.plot(count, rms * scale, "o-", ms=3, color=UP)
    axis.axvline(result.model.hysteresis.n, color=MODEL, lw=1.5)
    axis.set_ylim(0, min(float(rms.max()), 3 * float(rms.min())) * scale)
    axis.set(xlabel="operators", ylabel=f"rms, {unit}", title="held out, by number of operators")
    return png(fig)


def _measured(recording: Recording) -> Floats:
    return recording.drive if recording.displacement is None else recording.displacement


def _small_unit(unit: str, size: float) -> tuple[str, float]:
    return ("nm", 1e3) if unit == "um" and size < 1.0 else (unit, 1.0)


def _limits(axis: Any, e: Floats) -> None:
    top = 1.3 * float(np.nanquantile(np.abs(e), 0.999)) if e.size else 1.0
    axis.set_ylim(-top, top) if top > 0 else None


def _few_cycles(recording: Recording, result: Identification, number: int) -> tuple[int, int]:
    """Rows of the last few cycles that were fitted; a cycle by the strongest line of the drive."""
    at = np.flatnonzero(result.used[number])
    if at.size < 16:
        return 0, recording.size
    u = np.nan_to_num(recording.drive[at[0] : at[-1] + 1], nan=float(np.nanmean(recording.drive)))
    power = np.abs(np.fft.rfft(u - u.mean()))
    power[0] = 0.0
    cycle = u.size / max(1, int(np.argmax(power)))
    return max(int(at[0]), int(at[-1] - CYCLES_SHOWN * cycle)), int(at[-1]) + 1
