"""Run the model on its own input, every row of every recording in the file's order, before claims
are made. Recordings that no model of this class can follow are refused with a reason."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dehyst.models.cascade.figures import describe
from dehyst.models.cascade.history import replay
from dehyst.models.errors import BadRecording
from dehyst.models.identify.data.rows import Rows
from dehyst.models.identify.plausibility.recordings import measure_line
from dehyst.models.identify.tuning import TUNING
from dehyst.models.model import Model
from dehyst.models.recording import Bools, Floats, Recording
from dehyst.models.signals.drive_segments import (
    BUTTERFLY,
    count_reversing_segments,
    find_jumps_at_turns,
)
from dehyst.models.signals.error_size import rms
from dehyst.models.signals.joined import Ints
from dehyst.models.signals.jumps import measure_share_in_jumps
from dehyst.models.signals.rounding import quantum

REFUSED_BUTTERFLY = f"{BUTTERFLY}; keep the drive on one side of the turning points"

TURN, JUMP, REPEATED = 0.04, 0.07, 0.07
"""Of a turn with friction: the travel after it, as a fraction of the drive's range; by how much the
displacement moves further than the drive, as a fraction of its range, where creep, rate and
resonance leave 0.05; least width of the loop, which shows that it repeats."""
SAME_SIGNAL = 1e-9
"""Residual of a straight line through the drive, as a fraction of the rms of the displacement,
below which the displacement is a copy of the drive."""
IN_JUMPS, FEWEST_JUMPS = 0.15, 4
"""Largest share of its travel that a reading may make in jumps: gauges with outliers, hum and
polled readings reach 0.03, and stick-slip begins at 0.2; number of jumps that is not chance."""
ROUNDED, EXACT = 0.5, 1e-3
"""Residual of that line over the sum of both columns' steps, if they are written with few digits;
largest step, as a fraction of the range, that is taken for rounding and not for a coarse gauge."""
LEVELS, FEWEST_AT_A_LEVEL = 20, 3
"""Number of drive levels at which rising and falling readings are compared; least number of
readings of each."""
ROWS_BEFORE = 8
"""Rows from which a row of a drive follows: those of four sines of any frequency determine it."""
AT_THE_STOP = 3
"""Number of drive levels, after the first, on which a displacement that has come to a stop shows no
slope: 15 % of the drive's range. A stage that saturates keeps a third of its mean slope."""
WIDTH = 2.8
"""Width of an ellipse over the rms distance of its points from its axis, 2 sqrt 2."""
SCATTERED = 0.5
"""Scatter of the readings of one direction, as a fraction of the widest distance, above which no
loop repeats."""
FOLLOWS = 0.25
"""Least share of the variance of a butterfly that level and direction of the drive explain. White
noise gives 0, a butterfly at one amplitude more than 0.9."""


@dataclass(frozen=True)
class OwnInput:
    """Residual of the model in one recording [displacement unit]: rms of all its rows, of those
    that were fitted, and of the others (NaN if there are none); span: range of its displacement."""

    name: str
    rows: int
    fitted_rows: int
    rms: float
    fitted_rms: float
    other_rms: float
    span: float


def simulate_own_input(
    model: Model, rows: Sequence[Rows], used: Sequence[Bools]
) -> tuple[OwnInput, ...]:
    """Simulate each whole recording, without lone glitches of its drive, after the history that
    fits it best. used: (N,) rows of each
    that were fitted. Each recording but the first has its own offset, the mean over its fitted
    rows."""
    found = []
    for place, (one, fitted) in enumerate(zip(rows, used, strict=True)):
        driven = ~np.isnan(one.u)
        error = np.full(one.u.size, np.nan)
        own = one.y[driven]
        error[driven] = own - replay(model, one.t_s[driven], one.u[driven], {}, own).predicted
        known = ~np.isnan(error)
        fit, others = known & fitted, known & ~fitted
        if place and fit.any():
            error = error - float(error[fit].mean())
        found.append(
            OwnInput(
                one.name,
                int(known.sum()),
                int(fit.sum()),
                rms(error[known]),
                rms(error[fit]),
                rms(error[others]),
                float(np.ptp(one.y[known])) if known.any() else 0.0,
            )
        )
    return tuple(found)


def require_own_input(
    model: Model, rows: Sequence[Rows], used: Sequence[Bools], noise: Sequence[float]
) -> tuple[str, ...]:
    """Return remarks on the rows that were left out. noise: rms of each recording. Raises
    BadRecording if the model cannot follow its own input, or the loop is not of this class."""
    said = []
    unit = model.displacement_unit
    for one, its, sigma in zip(simulate_own_input(model, rows, used), rows, noise, strict=True):
        excess = float(np.sqrt(max(one.rms**2 - sigma**2, 0.0)))
        if excess > TUNING.minor * one.span:
            raise BadRecording(
                f"{one.name}: {_why_outside(model, its)}; over all of its {one.rows} rows "
                f"the best model leaves {one.rms:.4g} {unit} rms, {one.rms / one.span:.0%} of the "
                "displacement's range"
            )
        left_out = one.rows - one.fitted_rows
        if left_out and one.other_rms > TUNING.twice * max(one.fitted_rms, sigma):
            said.append(
                f"{one.name}: left out {left_out} of {one.rows} rows (start, steps, gaps, "
                f"outliers); the model leaves {one.other_rms:.3g} {unit} rms there and "
                f"{one.fitted_rms:.3g} in the others"
            )
        _require_another_signal(one.name, its.u, its.y)
        _require_no_jumps(one.name, its.u, its.y)
        _require_smooth(one.name, its.u, its.y)
        said += _note_stop(one.name, its.u, its.y, unit)
    figures = describe(model)
    _require_narrow(rows[0].name, figures.hysteresis)
    loop = figures.hysteresis * figures.stroke
    size = sum(int(np.count_nonzero(pick)) for pick in used)
    if loop < max(noise) * find_least_loop(size, model.hysteresis.n):
        for its in rows:
            _require_order(its.name, its.u)
        said.append(
            f"no hysteresis: the loop is {loop:.2g} {unit} wide, and {size} rows with this noise "
            "cannot show a narrower one; the model is practically linear in the drive"
        )
    elif figures.hysteresis < TUNING.trace:
        said.append(
            f"hardly any hysteresis: the loop is {loop:.2g} {unit} wide, "
            f"{figures.hysteresis:.2%} of the stroke; the model is practically linear in the drive"
        )
    return tuple(said)


def find_least_loop(rows: int, unknowns: int) -> float:
    """Return the width of the narrowest loop that this many rows show, over the noise rms of one
    row.

    A straight line through an ellipse leaves an rms of its width over WIDTH; a fit of this many
    unknowns reduces the power of white noise by a chi-square with as many degrees of freedom.
    """
    chance = unknowns + 3.0 * np.sqrt(2.0 * unknowns)  # three standard deviations
    return float(min(1.0, WIDTH * np.sqrt(chance / max(1, rows))))


def require_ordinary_loop(recordings: Sequence[Recording]) -> None:
    """Raise BadRecording if the loop itself shows the fault: the displacement reverses within the
    segments of the drive, is a copy of the drive, or has too wide a loop."""
    for one in recordings:
        if one.displacement is None:
            continue
        known = ~np.isnan(one.drive) & ~np.isnan(one.displacement)
        u, y = one.drive[known], one.displacement[known]
        if u.size < TUNING.fewest_rows or not np.ptp(y):
            continue  # too short, or a dead gauge: read_rows reports these
        if is_butterfly(one.drive, one.displacement):
            raise BadRecording(f"{one.name}: {REFUSED_BUTTERFLY}")
        if np.any(np.diff(u) > 0) and np.any(np.diff(u) < 0):
            _require_another_signal(one.name, u, y)
        _require_narrow(one.name, measure_loop_width(u, y))


def _require_another_signal(name: str, u: Floats, y: Floats) -> None:
    """Raise BadRecording if the displacement (N,) is the drive (N,) times a constant, apart from
    rounding."""
    known = ~np.isnan(u) & ~np.isnan(y)
    u, y = u[known], y[known]
    line, step = measure_line(u, y), quantum(y) / float(np.ptp(y)) + quantum(u) / float(np.ptp(u))
    rounding = ROUNDED * step * float(np.ptp(y)) if step < EXACT else 0.0
    if line <= max(SAME_SIGNAL * float(np.std(y)), rounding):
        raise BadRecording(
            f"{name}: the displacement is the drive times a constant, without noise: both columns "
            "hold the same signal; give the column of the gauge (--columns y=...)"
        )


def _require_no_jumps(name: str, u: Floats, y: Floats) -> None:
    """Raise BadRecording if the displacement (N,) jumps ahead at the turns of the drive, as it does
    with dry friction."""
    known = ~np.isnan(u) & ~np.isnan(y)
    u, y = u[known], y[known]
    size = float(np.ptp(np.quantile(y, [0.02, 0.98])))  # without outliers
    if not size or measure_loop_width(u, y) < REPEATED:
        return
    jumps = find_jumps_at_turns(u, y, TURN) / size
    if jumps.size > 1 and float(np.median(jumps)) > JUMP:
        raise BadRecording(
            f"{name}: where the drive reverses, the displacement jumps by {np.median(jumps):.0%} "
            "of its range, as with dry friction: no invertible hysteresis does this; look for a "
            "part that rubs or is loose"
        )


def _require_smooth(name: str, u: Floats, y: Floats) -> None:
    """Raise BadRecording if the displacement (N,) makes part of its travel in jumps while the drive
    moves smoothly, as with stick-slip or ferroelectric switching."""
    known = ~np.isnan(u) & ~np.isnan(y)
    share, count = measure_share_in_jumps(u[known], y[known])
    if share > IN_JUMPS and count >= FEWEST_JUMPS:
        raise BadRecording(
            f"{name}: {share:.0%} of the displacement's travel occurs in {count} jumps while the "
            "drive moves smoothly, as with stick-slip or ferroelectric switching: no invertible "
            "loop does this; look for a part that rubs or is loose, or reduce the drive"
        )


def _require_order(name: str, u: Floats) -> None:
    """Raise BadRecording if no row of a drive (N,) follows from those before it: if no hysteresis
    is visible either, the rows are not in time order."""
    u = u[~np.isnan(u)]
    size = float(np.median(np.abs(np.diff(u)))) / float(np.ptp(u))
    if size < TUNING.small:
        return
    before = np.lib.stride_tricks.sliding_window_view(u - u.mean(), ROWS_BEFORE + 1)
    weights, *_ = np.linalg.lstsq(before[:, :-1], before[:, -1], rcond=None)
    left = before[:, -1] - before[:, :-1] @ weights
    if float(left @ left) > TUNING.half * float(before[:, -1] @ before[:, -1]):
        raise BadRecording(
            f"{name}: the drive jumps by {size:.0%} of its range from row to row, successive rows "
            "are unrelated, and no hysteresis is visible: the rows are not in time order; sort "
            "them by time, or record a drive that moves steadily"
        )


def _note_stop(name: str, u: Floats, y: Floats, unit: str) -> list[str]:
    """Return a remark if the displacement (N,) stays where it is while the drive (N,) continues to
    an end of its range."""
    known = ~np.isnan(u) & ~np.isnan(y)
    u, y = u[known], y[known]
    level, way = _levels(u), np.sign(np.gradient(u))
    mean = float(np.polyfit(level, y, 1)[0])
    for ahead, end in ((1.0, "up"), (-1.0, "down")):
        at = level if ahead > 0.0 else LEVELS - 1 - level  # 0 is where the way begins
        here = [y[(at == k) & (way == ahead)] for k in range(LEVELS)]
        places = np.array([np.median(part) for part in here if part.size >= FEWEST_AT_A_LEVEL])
        if places.size < LEVELS // 2:
            continue
        places = places[-AT_THE_STOP - 1 :]
        slope = float(np.polyfit(np.arange(places.size), places, 1)[0])
        if abs(slope) < TUNING.minor * abs(mean):
            return [
                f"{name}: the displacement stays at about {places[-1]:.4g} {unit} while the drive "
                f"goes on {end}: a stop, or the end of the gauge's range; the model does not hold "
                "there; record a drive that ends before it"
            ]
    return []


def _require_narrow(name: str, width: float) -> None:
    if width > TUNING.half:
        raise BadRecording(
            f"{name}: the loop is {width:.0%} of the stroke wide; a piezo below its "
            "coercive field stays below a third. It is driven through its coercive field, rubs "
            "against something, or its reading lags: reduce the drive, or look for friction and lag"
        )


def measure_loop_width(u: Floats, y: Floats) -> float:
    """Return the largest distance between falling and rising readings at one drive, over the range
    of y; u, y: (N,) without gaps. 0 if y does not repeat: then a drive level has no typical
    reading."""
    if u.size < 4 * LEVELS or not np.ptp(u) or not np.ptp(y):  # too few rows to a level
        return 0.0
    level, rises = _levels(u), np.gradient(u) > 0.0
    widths, within = [], []
    for at in range(1, LEVELS - 1):
        up, down = y[(level == at) & rises], y[(level == at) & ~rises]
        if min(up.size, down.size) >= FEWEST_AT_A_LEVEL:
            widths.append(abs(float(np.median(up) - np.median(down))))
            within += [float(np.std(up)), float(np.std(down))]
    if not widths or float(np.median(within)) > SCATTERED * max(widths):
        return 0.0
    return max(widths) / float(np.ptp(y))


def _levels(u: Floats) -> Ints:
    """Return the level (N,) of each value of a drive that is not constant."""
    return np.minimum(((u - u.min()) / np.ptp(u) * LEVELS).astype(int), LEVELS - 1)


def _follows(u: Floats, y: Floats) -> bool:
    """Return whether level and direction of the drive (N,) explain a part of the reading (N,)."""
    at = 2 * _levels(u) + (np.gradient(u) > 0.0)
    count = np.bincount(at)
    left = y - (np.bincount(at, y) / np.maximum(count, 1))[at]
    free = max(y.size - int(np.count_nonzero(count)), 1)  # each mean follows a part of the noise
    return float(left @ left) / free < (1.0 - FOLLOWS) * float(np.var(y))


def _why_outside(model: Model, rows: Rows) -> str:
    """Explain why no model of this class follows a recording, as far as its segments show it."""
    if is_butterfly(rows.u, rows.y):
        return REFUSED_BUTTERFLY
    if describe(model).hysteresis > TUNING.half:
        return (
            "the displacement jumps and then stays constant, as with dry friction or ferroelectric "
            "switching: no invertible hysteresis does this"
        )
    return (
        "hysteresis of the drive cannot produce this displacement: another input moves the stage, "
        "the times or the columns are wrong, or the stage changed during the recording"
    )


def is_butterfly(u: Floats, y: Floats) -> bool:
    """Return whether the displacement (N,) follows the drive (N,), and reverses within most of its
    long segments."""
    known = ~np.isnan(u) & ~np.isnan(y)
    u, y = u[known], y[known]
    if u.size < 2 or not np.ptp(u) or not np.ptp(y):
        return False
    ways, backs = count_reversing_segments(u, y, float(np.ptp(u)), float(np.ptp(y)))
    return ways > 0 and backs > 0.5 * ways and _follows(u, y)
