"""Pictures of an identification. Each function draws on the given axes and returns a description.

To add one, write its function here and list it in identification.py.
"""

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from dehyst.daemon.report.choice import name_kind
from dehyst.daemon.report.plotting import (
    DOWN,
    MEASURED,
    MODEL,
    MOST_ROWS,
    NOISE,
    UNUSED,
    UP,
    add_legend,
    draw_noise_band,
    draw_trace,
    draw_white_noise,
    estimate_density,
    limit_to,
    scale_by_decades,
    thin_rows,
)
from dehyst.models.identify import Identification
from dehyst.models.recording import Floats, Recording
from dehyst.models.signals.error_size import Z95, finite_rms
from dehyst.models.units import pick_unit, spell_unit

CYCLES_SHOWN = 3
BINS = 30


def draw_few_cycles(result: Identification, recording: Recording, number: int, axes: Axes) -> str:
    """Draw measurement and model over the last few fitted cycles."""
    part = _last_cycles(recording, result, number)
    y = _measured(recording)
    t, m, w = thin_rows(recording.t_s[part], y[part], y[part] - result.residuals[number][part])
    axes.plot(t, m, ".", color=MEASURED, ms=2.5, label="measured")
    axes.plot(t, w, color=MODEL, lw=1.2, label="model")
    add_legend(axes, 0.18)
    axes.set(
        xlabel="time, s",
        ylabel=f"displacement, {recording.displacement_unit}",
        title="a few cycles",
    )
    return "Measured displacement and the model's over a few cycles."


def draw_hysteresis_loop(
    result: Identification, recording: Recording, number: int, axes: Axes
) -> str:
    """Draw the same cycles over the drive."""
    part = _last_cycles(recording, result, number)
    y = _measured(recording)
    u, m, w = thin_rows(recording.drive[part], y[part], y[part] - result.residuals[number][part])
    axes.plot(u, m, ".", color=MEASURED, ms=2.5, label="measured")
    axes.plot(u, w, color=MODEL, lw=1.2, label="model")
    axes.legend(loc="upper left")
    axes.set(
        xlabel=f"drive, {spell_unit(recording.drive_unit)}",
        title="displacement over the drive",
        ylabel=f"displacement, {recording.displacement_unit}",
    )
    return "The hysteresis loop: measured displacement and the model's over the drive."


def draw_residual_over_time(
    result: Identification, recording: Recording, number: int, axes: Axes
) -> str:
    """Draw the residual over time, with rows that were not fitted in grey."""
    e, noise, unit = _error(result, recording, number)
    used = result.used[number]
    if not used.all():
        draw_trace(axes, recording.t_s, np.where(used, np.nan, e), UNUSED, "not fitted")
    fitted = np.where(used, e, np.nan)
    if used.any():
        draw_trace(axes, recording.t_s, fitted, MODEL, "fitted")
    draw_noise_band(axes, noise)
    limit_to(axes, fitted)
    axes.set(xlabel="time, s", ylabel=f"measured - model, {unit}", title="residual over time")
    add_legend(axes)
    return (
        f"Residual over time: {finite_rms(fitted):.3g} {unit} rms on fitted rows, "
        f"noise {noise:.3g} {unit}."
    )


def draw_residual_over_drive(
    result: Identification, recording: Recording, number: int, axes: Axes
) -> str:
    """Draw the residual over the drive for each direction, with the mean of each as a line."""
    e, _, unit = _error(result, recording, number)
    every = 1 + e.size // MOST_ROWS
    step = recording.drive[2::every] - recording.drive[:-2:every]
    some = slice(1, -1, every)
    drive, e, used = recording.drive[some], e[some], result.used[number][some]
    for way, color, label in ((step > 0, UP, "drive rising"), (step < 0, DOWN, "drive falling")):
        at = used & way
        if not at.any():
            continue
        u, shown = thin_rows(drive[at], e[at])
        axes.plot(u, shown, ".", color=color, ms=1.5, alpha=0.35)
        if at.sum() > 200:
            axes.plot(*_means(drive[at], e[at]), color=color, lw=2, label=label)
    limit_to(axes, e[used])
    axes.set(
        xlabel=f"drive, {spell_unit(recording.drive_unit)}",
        title="residual over the drive",
        ylabel=f"measured - model, {unit}",
    )
    if axes.get_legend_handles_labels()[0]:
        add_legend(axes, 0.18)
    return "Residual over the drive, rising and falling separately; lines are means."


def draw_residual_spectrum(
    result: Identification, recording: Recording, number: int, axes: Axes
) -> str:
    """Draw the residual's spectrum against white noise of the estimated size."""
    e, noise, unit = _error(result, recording, number)
    f, density = estimate_density([e], recording.period_s)
    axes.plot(f, density, color=MODEL, lw=1.4, label="residual")
    draw_white_noise(axes, noise, recording.period_s)
    scale_by_decades(axes, y=True)
    axes.set(xlabel="frequency, Hz", ylabel=f"{unit}/√Hz", title="spectrum of the residual")
    add_legend(axes, 0.18)
    return "Spectrum of the residual, compared with white noise of the estimated level."


def draw_orders(result: Identification, axes: Axes) -> str:
    """Draw the misfit of the fitted rows against the number of operators."""
    count, misfit = np.array(result.orders).T
    scale, unit = pick_unit(result.model.displacement_unit, float(np.min(misfit)))
    chosen = result.model.hysteresis.n
    axes.plot(count, misfit * scale, "o-", ms=3, color=MODEL)
    axes.axvline(chosen, color=MEASURED, lw=1.5, ls="--")
    top = min(float(misfit.max()), 3 * float(misfit.min())) * scale
    if np.isfinite(top) and top > 0.0:
        axes.set_ylim(0, top)
    axes.set(
        xlabel="operators",
        ylabel=f"rms, {unit}",
        title=f"fitted rows, by number of operators (chosen: {chosen})",
    )
    return f"Misfit of the fitted rows by the number of operators; {chosen} were chosen."


def draw_structures(result: Identification, axes: Axes) -> str:
    """Draw the held-out error of the best structure of each kind."""
    bests = {}
    for one in sorted(result.tried, key=lambda c: -c.held_rms):
        bests[name_kind(one)] = one
    own = name_kind(result.chosen)
    bests[own] = result.chosen
    kinds = sorted(bests, key=lambda kind: -bests[kind].held_rms)
    held = np.array([bests[kind].held_rms for kind in kinds])
    scale, unit = pick_unit(result.model.displacement_unit, float(held.min()))
    colors = [MODEL if kind == own else UNUSED for kind in kinds]
    bars = axes.barh(np.arange(held.size), held * scale, color=colors, height=0.7)
    axes.bar_label(bars, fmt="{:.3g}", padding=3, fontsize=8)
    axes.axvline(result.noise_rms * scale, color=NOISE, lw=2, alpha=0.7, label="noise")
    axes.set_yticks(np.arange(held.size), kinds, fontsize=8.5)
    far = 1.15 * float(np.max(held, initial=result.noise_rms)) * scale
    if np.isfinite(far) and far > 0.0:
        axes.set_xlim(0.0, far)
    axes.grid(False, axis="y")
    axes.set(xlabel=f"rms, {unit}", title="held out, by structure (chosen in blue)")
    axes.legend(loc="upper right")
    return f"Held-out error of the best structure of each kind; chosen: {own}."


def draw_slopes(result: Identification, axes: Axes) -> str:
    """Draw the slopes after a reversal with their 95 % intervals."""
    h = result.model.hysteresis
    n = h.n
    parts = [("", slice(0, n), MODEL)]
    if result.shape.rate:
        at = f"{result.rates[-1]:.3g} {spell_unit(result.model.drive_unit)}/s"
        parts = [(f"at up to +{at}", slice(0, n), UP), (f"at up to -{at}", slice(n, 2 * n), DOWN)]
    for label, part, color in parts:
        slope, error = result.params.slopes[part], Z95 * result.errors.slopes[part]
        axes.errorbar(h.r, slope, error, fmt="o-", ms=4, color=color, capsize=3, lw=1, label=label)
    smallest = float(h.r[h.r > 0].min()) if np.any(h.r > 0) else 1.0
    axes.set_xscale("symlog", linthresh=10 ** np.ceil(np.log10(smallest)))
    top = float(np.max(result.params.slopes))
    if np.isfinite(top) and top > 0.0:
        axes.set_ylim(-0.05 * top, 1.4 * top)
    axes.set(
        xlabel=f"threshold, {spell_unit(result.model.drive_unit)}",
        ylabel="slope dz/du",
        title="slope after a reversal, by threshold passed",
    )
    if result.shape.rate:
        axes.legend()
    return "Slope after a reversal by the threshold passed, with 95 % intervals."


def _measured(recording: Recording) -> Floats:
    return recording.drive if recording.displacement is None else recording.displacement


def _error(result: Identification, recording: Recording, number: int) -> tuple[Floats, float, str]:
    """Return (residual (M,), noise rms, unit), all in the unit in which they are shown."""
    residual = result.residuals[number]
    scale, unit = pick_unit(recording.displacement_unit, finite_rms(residual))
    return residual * scale, result.noise_rms * scale, unit


def _means(drive: Floats, error: Floats) -> tuple[Floats, Floats]:
    """Return (bin centres, means) of the error in bins that hold equally many samples."""
    edges = np.quantile(drive, np.linspace(0, 1, BINS + 1))
    index = np.clip(np.searchsorted(edges, drive) - 1, 0, BINS - 1)
    good = np.isfinite(error)
    count = np.bincount(index[good], minlength=BINS)
    total = np.bincount(index[good], error[good], minlength=BINS)
    mean = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    return 0.5 * (edges[1:] + edges[:-1]), mean


def _last_cycles(recording: Recording, result: Identification, number: int) -> slice:
    """Return the rows of the last few fitted cycles; the strongest line of the drive's spectrum
    defines a cycle."""
    at: NDArray[np.intp] = np.flatnonzero(result.used[number])
    if at.size < 16:
        return slice(0, recording.size)
    u = recording.drive[max(int(at[0]), int(at[-1]) + 1 - MOST_ROWS) : at[-1] + 1]
    u = np.nan_to_num(u, nan=float(np.nanmean(u)))
    power = np.abs(np.fft.rfft(u - u.mean()))
    power[0] = 0.0
    cycle = u.size / max(1, int(np.argmax(power)))
    return slice(max(int(at[0]), int(at[-1] - CYCLES_SHOWN * cycle)), int(at[-1]) + 1)
