"""Pictures of a diagnosis. Each function draws on the given axes and returns a description.

To add one, write its function here and list it in diagnosis.py; to show the misfit over a further
quantity, add one line to `list_places`.
"""

from functools import partial

import numpy as np
from matplotlib.axes import Axes

from dehyst.daemon.report.plotting import (
    BEFORE,
    MEASURED,
    MODEL,
    NOISE,
    Draw,
    add_legend,
    draw_noise_band,
    draw_trace,
    draw_white_noise,
    estimate_density,
    limit_to,
    scale_by_decades,
)
from dehyst.models.arrays import Bools, Floats, Ints
from dehyst.models.diagnosis import Diagnosis, FitView
from dehyst.models.signals.error_size import finite_rms
from dehyst.models.units import pick_unit, spell_unit

MODELS = (("base", BEFORE, "model in use"), ("augmented", MODEL, "augmented model"))
STILL = 0.05  # of the drive's range per second, below which the drive is held
FEW = 50  # least number of samples for a picture


def choose_scale(diagnosis: Diagnosis) -> tuple[float, str]:
    """Return the factor and unit in which the errors of this diagnosis are shown."""
    error = max(finite_rms(v.displacement - v.base) for v in diagnosis.views)
    return pick_unit(diagnosis.unit, max(error, diagnosis.noise))


def draw_model_error(diagnosis: Diagnosis, view: FitView, axes: Axes) -> str:
    """Draw the error of one recording before and after."""
    k, unit = choose_scale(diagnosis)
    said = []
    for (name, color, label), when in zip(MODELS, ("before", "after"), strict=True):
        error = k * (view.displacement - getattr(view, name))
        draw_trace(axes, view.t_s, error, color, label)
        said.append(f"{finite_rms(error[view.counted]):.3g} {unit} {when}")
    draw_noise_band(axes, k * diagnosis.noise)
    limit_to(axes, k * (view.displacement - view.base))
    axes.set(xlabel="time, s", ylabel=f"measured - model, {unit}", title=f"error {', '.join(said)}")
    add_legend(axes)
    return f"Error of {view.name} over time: {', '.join(said)}."


def draw_close_look(diagnosis: Diagnosis, view: FitView, axes: Axes) -> str:
    """Draw the 2 % of the recording in which the augmented model improves most."""
    gain = (view.displacement - view.base) ** 2 - (view.displacement - view.augmented) ** 2
    width = max(60, min(gain.size // 50, 1500))
    sums = np.convolve(np.where(np.isfinite(gain), gain, 0.0), np.ones(width), "valid")
    start = int(np.argmax(sums)) if sums.size else 0
    part = slice(start, start + width)
    axes.plot(view.t_s[part], view.displacement[part], ".", color=MEASURED, ms=3, label="measured")
    for name, color, label in MODELS:
        axes.plot(view.t_s[part], getattr(view, name)[part], color=color, lw=1.4, label=label)
    axes.set(
        xlabel="time, s", ylabel=f"displacement, {diagnosis.unit}", title="where it helps most"
    )
    add_legend(axes)
    return f"Measured and both models of {view.name}, where the augmented model helps most."


def draw_error_spectrum(diagnosis: Diagnosis, axes: Axes) -> str:
    """Draw the amplitude density of the errors against the noise; recordings with the same period
    are combined."""
    k, unit = choose_scale(diagnosis)
    longest = max(diagnosis.views, key=lambda v: v.t_s.size)
    period_s = _period_s(longest)
    alike = [
        v
        for v in diagnosis.views
        if 4 * v.t_s.size >= longest.t_s.size and abs(_period_s(v) / period_s - 1) < 0.01
    ]
    for name, color, label in MODELS:
        errors = [k * (v.displacement - getattr(v, name)) for v in alike]
        axes.plot(*estimate_density(errors, period_s), color=color, lw=1.4, label=label)
    draw_white_noise(axes, k * diagnosis.noise, period_s)
    scale_by_decades(axes, y=True)
    axes.set(xlabel="frequency, Hz", ylabel=f"error, {unit}/√Hz", title="spectrum of the errors")
    add_legend(axes)
    return "Spectrum of the errors before and after, compared with white noise."


def list_loop(diagnosis: Diagnosis) -> list[Draw]:
    """Return pictures of the loop error of the model in use: by drive on both branches with their
    mean, and by the travel since the last reversal."""
    return [partial(_draw_branches, diagnosis), partial(_draw_swings, diagnosis)]


def _draw_branches(diagnosis: Diagnosis, axes: Axes) -> str:
    """Draw the mean error over the drive while rising and while falling, and their mean: the centre
    line."""
    k, unit = choose_scale(diagnosis)
    drive, error, rising = _loop_samples(diagnosis)
    edges = np.linspace(drive.min(), drive.max(), 25)
    centre = 0.5 * (edges[1:] + edges[:-1])
    means = []
    for where, color, label in ((rising, BEFORE, "rising"), (~rising, MODEL, "falling")):
        index = np.digitize(drive[where], edges) - 1
        means.append(k * _mean_in(index, error[where], edges.size - 1))
        axes.plot(centre, means[-1], color=color, lw=2, label=label)
    axes.plot(centre, 0.5 * (means[0] + means[1]), "--", color=MEASURED, label="centre line")
    volts = spell_unit(diagnosis.drive_unit)
    axes.set(
        xlabel=f"drive, {volts}", ylabel=f"mean error, {unit}", title="model in use, by branch"
    )
    add_legend(axes)
    width = float(np.nanmax(np.abs(means[0] - means[1]))) if np.isfinite(means).any() else 0.0
    return (
        "Mean error of the model in use over the drive, rising and falling, and its centre line; "
        f"the branches differ by up to {width:.3g} {unit}."
    )


def _draw_swings(diagnosis: Diagnosis, axes: Axes) -> str:
    """Draw the mean error in the direction of motion over the travel since the last reversal."""
    k, unit = choose_scale(diagnosis)
    _, error, rising = _loop_samples(diagnosis)
    swing = np.concatenate([_swing(v)[v.counted] for v in diagnosis.views])
    top = float(swing.max()) or 1.0
    edges = np.linspace(0.0, top, 16)
    centre = 0.5 * (edges[1:] + edges[:-1])
    sign = np.where(rising, 1.0, -1.0)
    index = np.digitize(swing, edges) - 1
    axes.plot(centre, k * _mean_in(index, sign * error, edges.size - 1), color=BEFORE, lw=2)
    axes.axhline(0.0, color=NOISE, lw=1)
    volts = spell_unit(diagnosis.drive_unit)
    axes.set(
        xlabel=f"travel since the last reversal, {volts}",
        ylabel=f"error, {unit}",
        title="model in use, after a reversal",
    )
    return "Mean error of the model in use by the travel since the last reversal of the drive."


def _loop_samples(diagnosis: Diagnosis) -> tuple[Floats, Floats, Bools]:
    views = diagnosis.views
    drive = np.concatenate([v.drive[v.counted] for v in views])
    error = np.concatenate([(v.displacement - v.base)[v.counted] for v in views])
    rising = np.concatenate([(_last_direction(v) > 0)[v.counted] for v in views])
    return drive, error, rising


def _swing(view: FitView) -> Floats:
    """Return the travel of the drive since its last reversal."""
    return np.abs(view.drive - view.drive[np.maximum(_last_turn(view) - 1, 0)])


def _mean_in(index: np.ndarray, x: Floats, count: int) -> Floats:
    ok = (index >= 0) & (index < count) & np.isfinite(x)
    number = np.bincount(index[ok], minlength=count)
    total = np.bincount(index[ok], x[ok], minlength=count)
    return np.where(number >= 8, total / np.maximum(number, 1), np.nan)


def list_places(diagnosis: Diagnosis) -> list[Draw]:
    """Return pictures of the rms error by time, drive and direction, rate, time since the last
    reversal, and time in holds."""
    views, volts = diagnosis.views, spell_unit(diagnosis.drive_unit)
    drive = np.concatenate([v.drive for v in views])
    span = float(np.ptp(drive)) or 1.0
    rate = np.concatenate([_rate(v) for v in views])
    since = np.concatenate([_since_turn(v) for v in views])
    held = np.concatenate([_in_hold(v, span) for v in views])
    rising = np.concatenate([_last_direction(v) for v in views]) > 0
    time = _one_clock(views)
    top = float(np.quantile(rate, 0.9999)) or 1.0
    by_time = np.linspace(0, time[-1], 31)
    by_drive = np.linspace(drive.min(), drive.max(), 16)
    by_rate = np.geomspace(max(top * 1e-4, 1e-9), top, 16)
    always = np.ones(drive.size, bool)
    return [
        partial(_draw_place, diagnosis, place, edges, label, where)
        for place, edges, label, where in (
            (time, by_time, "time, all recordings, s", always),
            (drive, by_drive, f"drive, moving up, {volts}", rising),
            (drive, by_drive, f"drive, moving down, {volts}", ~rising),
            (rate, by_rate, f"rate, {volts}/s", always),
            (since, _log_edges(since), "time since the last reversal, s", always),
            (held, _log_edges(held), "time in a hold, s", held > 0),
        )
    ]


def _draw_place(
    diagnosis: Diagnosis, place: Floats, edges: Floats, label: str, where: Bools, axes: Axes
) -> str:
    """Draw the held-out rms error of both models in each bin as steps, and the noise."""
    k, unit = choose_scale(diagnosis)
    counted = np.concatenate([v.counted for v in diagnosis.views])
    ok = np.isfinite(place) & where & counted
    axes.set(xlabel=label, title=f"by {label.rsplit(', ', 1)[0]}")
    if edges.size < 2 or ok.sum() < FEW:
        middle = {"ha": "center", "va": "center"}
        axes.text(0.5, 0.5, "no samples in\nthese recordings", middle, transform=axes.transAxes)
        axes.set(xticks=[], yticks=[])
        return f"Rms error by {label}: no samples in these recordings."
    index = np.digitize(place[ok], edges) - 1
    for name, color, text in MODELS:
        error = np.concatenate([v.displacement - getattr(v, name) for v in diagnosis.views])[ok]
        steps = k * np.sqrt(_mean_in(index, error**2, edges.size - 1))
        axes.stairs(steps, edges, color=color, lw=2, label=text, baseline=None)
    axes.axhline(k * diagnosis.noise, color=NOISE, lw=2, alpha=0.7, label="noise")
    if edges[0] > 0 and edges[-1] / edges[0] > 50:
        scale_by_decades(axes)
    axes.set_ylim(bottom=0)
    axes.set_ylabel(f"rms error, {unit}")
    add_legend(axes)
    return f"Rms error by {label}, before and after, compared with the noise."


def _log_edges(x: Floats) -> Floats:
    good = x[np.isfinite(x) & (x > 0)]
    if good.size < FEW:
        return np.zeros(0)
    return np.geomspace(max(good.min(), good.max() * 1e-5), good.max() * 1.0001, 16)


def _period_s(view: FitView) -> float:
    """Return the step of the time stamps [s]; 1 if there is only one row."""
    return float(np.median(np.diff(view.t_s))) if view.t_s.size > 1 else 1.0


def _one_clock(views: tuple[FitView, ...]) -> Floats:
    """Return times [s] that continue from one recording to the next."""
    clock, edge = [], 0.0
    for v in views:
        clock.append(v.t_s - v.t_s[0] + edge)
        edge += float(v.t_s[-1] - v.t_s[0])
    return np.concatenate(clock)


def _last_row(marked: Bools) -> Ints:
    """Return (N,) the last marked row up to each; 0 before the first."""
    return np.maximum.accumulate(np.where(marked, np.arange(marked.size), 0))


def _last_direction(view: FitView) -> Floats:
    direction = np.sign(np.diff(view.drive, prepend=view.drive[0]))
    return np.asarray(direction[_last_row(direction != 0)])


def _last_turn(view: FitView) -> Ints:
    return _last_row(np.r_[True, np.diff(_last_direction(view)) != 0])


def _since_turn(view: FitView) -> Floats:
    return view.t_s - view.t_s[_last_turn(view)] + _period_s(view)


def _rate(view: FitView) -> Floats:
    """Return the magnitude of the drive's rate; 0 if there is only one row."""
    if view.t_s.size < 2:
        return np.zeros(view.t_s.size)
    return np.abs(np.gradient(view.drive, view.t_s))


def _in_hold(view: FitView, span: float) -> Floats:
    """Return the time since the drive came to rest [s]; 0 while it moves."""
    step = np.abs(np.diff(view.drive, prepend=view.drive[0]))
    moves = step > STILL * span * _period_s(view)
    return np.where(moves, 0.0, view.t_s - view.t_s[_last_row(moves)])
