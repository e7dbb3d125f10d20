"""Choose the structure that recordings support: without outliers, next to a straight drift, and
static where their drives have one rate; fit it to all rows, or the next best where that fails."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from dehyst.models.identify.data.rows import Rows
from dehyst.models.identify.equations import Shape
from dehyst.models.identify.final import Fitted, fit_all
from dehyst.models.identify.identified import Options
from dehyst.models.identify.plausibility.recordings import measure_line, rms
from dehyst.models.identify.search import Search
from dehyst.models.identify.setup import FitSetup
from dehyst.models.identify.structure import TriedStructure, choose_structure, list_shapes
from dehyst.models.identify.tuning import TUNING
from dehyst.models.recording import Bools
from dehyst.models.signals.drive_segments import (
    DriveSegments,
    find_drive_segments,
    find_one_period,
    repeats_one_loop,
)

WITH_TIME = 0.8
"""Correlation of the sizes of the drive's segments with their order from which a drift is hidden:
0.95 for a decaying sine, near 0 for one that grows and shrinks."""


class Shown(NamedTuple):
    """What the drives of the recordings can show: with one period, no rate-dependence; with loops
    of one size too, no lag."""

    rates: bool
    lags: bool


class Choice(NamedTuple):
    """The chosen structure, with the rows that remained. setup: without the drift; notes: what was
    left out; shown: what the drives can show; drives: the segments of each recording's; ramp: the
    straight drift that was subtracted [displacement/s]."""

    setup: FitSetup
    search: Search
    tried: list[TriedStructure]
    best: TriedStructure
    notes: list[str]
    shown: Shown
    drives: Sequence[DriveSegments]
    ramp: float = 0.0


def make_choice(setup: FitSetup, options: Options, progress: Callable[[str], None]) -> Choice:
    """Choose the structure of a model of these recordings."""
    drives = _find_segments(setup.rows, setup.span)
    period_s = find_one_period(drives)
    lags = not repeats_one_loop(drives)
    if lags:
        rich = _choose_without_drift(setup, options, progress, Shown(True, True), drives)
        if period_s is None:
            return _without_vague_lag(rich, options, progress)
        if rich.best.has_lag and _outlasts_drift(rich, period_s):
            rich.notes.append(
                "only one rate: lag, delay or resonance may be part of the loop's shape instead; "
                "a second recording at another rate, or one with a step, decides which"
            )
            return rich  # with a lag the stage is dynamic: then its weights may be, too
    shown = Shown(rates=False, lags=lags)
    found = _choose_without_drift(setup, options, progress, shown, drives)
    kept = found.best.lag is not None and _outlasts_drift(found, period_s)
    hidden = "rate-dependence cannot be distinguished from the hysteresis"
    left = f"only one rate: {hidden}, and the model has none"
    if not kept:
        left = f"lag, delay, resonance and {hidden}, and the model is static"
        left = f"only {'one rate' if shown.lags else 'one loop at one rate'}: {left}"
        if found.best.lag is not None:
            shown = Shown(rates=False, lags=False)
            found = _choose(found.setup, options, progress, shown, drives, found.ramp, found.notes)
    if options.rate is None:
        found.notes.append(f"{left}; add a second recording at another rate, or one with a step")
    return found


def _without_vague_lag(found: Choice, options: Options, progress: Callable[[str], None]) -> Choice:
    """Choose again without a lag where it removes less than a third of the misfit beyond the noise:
    in a stage of another class it then imitates a part of the loop's shape."""
    best = found.best
    if not best.has_lag or found.search.compare_without_lag(best, found.tried) < TUNING.most:
        return found
    shown = found.shown._replace(lags=False)
    static = _choose(found.setup, options, progress, shown, found.drives, found.ramp, found.notes)
    static.notes.append(
        "a lag or delay would remove less than a third of the residual, and the loop's shape may "
        "do the same: the model has neither; a recording with a step shows whether there is one"
    )
    return static


def _choose_without_drift(
    setup: FitSetup,
    options: Options,
    progress: Callable[[str], None],
    shown: Shown,
    drives: Sequence[DriveSegments],
) -> Choice:
    """Choose the structure, next to a straight drift where the rows left out are then predicted
    better."""
    found = _choose(setup, options, progress, shown, drives)
    if ramp := _find_ramp(found):
        rest = without_ramp(found.setup, ramp)
        flat = _choose(rest, options, progress, shown, drives, ramp, found.notes)
        if flat.best.held_rms**2 < (1.0 - TUNING.minor) * found.best.held_rms**2:
            return flat
    return found


def _choose(
    setup: FitSetup,
    options: Options,
    progress: Callable[[str], None],
    shown: Shown,
    drives: Sequence[DriveSegments],
    ramp: float = 0.0,
    known: Sequence[str] = (),
) -> Choice:
    """Choose the structure, again without the outliers that it shows. ramp: the drift that was
    subtracted; known: notes on what was left out before."""
    notes, wild = list(known), 0
    wanted = list_shapes(options.rate, options.saturation, options.bias)
    if setup.rate_max <= 0.0 or (not shown.rates and options.rate is None):
        wanted = [s for s in wanted if not s.rate]
    for left in range(TUNING.rounds, -1, -1):
        search = Search(setup, wanted, progress, shown.lags, bool(ramp))
        tried = search.run()
        best = search.choose(tried)
        errors = setup.residuals(search.r, best.shape, best.params, best.offset, best.lag)
        fewer, count = setup.without_outliers(errors) if left else (setup, 0)
        if not count:
            break
        setup, wild = fewer, wild + count
        if count <= 1e-3 * errors[0].size:  # of the rows: so few hardly change the choice
            break
    if wild:
        notes.append(f"{wild} isolated displacement outliers were left out")
    if not any((c.shape, c.offset, c.lag) == (best.shape, best.offset, best.lag) for c in tried):
        tried = [*tried, best]  # its lag was refined
    return Choice(setup, search, tried, best, notes, shown, drives, ramp)


def _find_ramp(found: Choice) -> float:
    """Return the straight drift of a single recording [displacement/s], 0 if it shows none. With
    several recordings, each has its own offset."""
    drives = found.drives
    if len(drives) != 1 or drives[0].sizes.size < 2 or not shows_drift(drives):
        return 0.0
    (ways,), best = drives, found.best
    if 0 not in best.shape.powers:  # dropped, as a stage at rest needs none
        constant = best.params._replace(c=np.concatenate([[0.0], best.params.c]))
        shape = replace(best.shape, powers=(0, *best.shape.powers))
        best = replace(best, shape=shape, params=constant)
    return found.search.find_ramp(best, 2.0 * float(np.median(ways.durations)))


def _outlasts_drift(found: Choice, period_s: float | None) -> bool:
    """Return whether the chosen dynamics predict next to a drift too."""
    return period_s is not None and found.search.outlasts_drift(found.best, found.tried, period_s)


def shows_drift(drives: Sequence[DriveSegments]) -> bool:
    """Return whether a drift can be distinguished from an offset that depends on the size of the
    loops: not if their size grows or shrinks all the time."""
    sizes = np.concatenate([one.sizes for one in drives])
    if sizes.size < 2 or not np.ptp(sizes):
        return True
    return bool(abs(np.corrcoef(np.arange(sizes.size), sizes)[0, 1]) <= WITH_TIME)


def fit_chosen(
    chosen: Choice, options: Options, progress: Callable[[str], None], notes: list[str]
) -> tuple[TriedStructure, Fitted]:
    """Fit the chosen structure to all rows; where that fails, the best of the simpler or other
    ones. If all fail, return the one that leaves least."""
    setup, search, best = chosen.setup, chosen.search, chosen.best
    line = _measure_lines(setup, search.picks)
    rest: list[TriedStructure] = list(chosen.tried)
    others = rest  # after a fit has failed, no further power is tried
    failed: list[tuple[float, TriedStructure, Fitted]] = []
    while True:
        progress(f"fitting {best.shape.name} to all rows")
        fitted = fit_all(setup, best, search.r, options.order, others)
        shape, left = fitted.shape, measure_left(best, fitted, search.picks)
        strays = left > min(TUNING.twice * best.held_rms, line)
        margin = fitted.setup.margin(fitted.r, shape, fitted.params, best.offset)
        turns = margin < TUNING.small and options.monotone
        if not (strays or turns):
            return best, fitted
        if not turns:
            failed.append((left, best, fitted))
        why = "did not converge on all rows" if strays else "would be non-monotone within the reach"
        lag = f" with a {best.lag.kind}" if best.lag is not None else ""
        notes.append(f"{shape.name}{lag}: {why} and was not chosen")
        others = []
        kind, size = (best.shape.rate, best.lag is None), len(shape.powers)
        same = [c for c in rest if (c.shape.rate, c.lag is None) == kind]
        fewer = [c for c in same if len(c.shape.powers) < size]
        rest = [c for c in rest if (c.shape.rate, c.lag is None) != kind]
        choice = rest if strays else fewer
        rest = rest if strays else [*rest, *fewer]
        if not choice and shape.powers != (0,):  # the user fixed the saturation: a straight line
            straight = [Shape(shape.rate, (0,))]
            choice = Search(setup, straight, progress, chosen.shown.lags).run()
        if not choice or len(failed) > TUNING.rounds:
            if failed:
                _, best, fitted = min(failed, key=lambda one: one[0])
            return best, fitted
        best = choose_structure(choice)


def _measure_lines(setup: FitSetup, picks: Sequence[Bools]) -> float:
    """Return the rms residual of the picked rows about a straight line for each recording."""
    powers = [
        float(np.count_nonzero(k)) * measure_line(one.u[k], one.y[k]) ** 2
        for one, pick in zip(setup.rows, picks, strict=True)
        if (k := pick & ~np.isnan(one.u)).any()
    ]
    return float(np.sqrt(sum(powers) / count_picked(picks)))


def count_picked(picks: Sequence[Bools]) -> int:
    """Return the number of picked rows of all recordings."""
    return sum(int(np.count_nonzero(pick)) for pick in picks)


def measure_left(best: TriedStructure, fitted: Fitted, picks: Sequence[Bools]) -> float:
    """Return the rms residual of the picked rows."""
    setup, shape = fitted.setup, fitted.shape
    errors = setup.residuals(fitted.r, shape, fitted.params, best.offset, best.lag)
    each = [error[pick] for error, pick in zip(errors, picks, strict=True)]
    return rms(np.concatenate(each))


def without_ramp(setup: FitSetup, ramp: float) -> FitSetup:
    """Return the setup with a straight line [displacement/s] from its start on subtracted from the
    displacement: the start is that of a stage at rest."""
    rows = [replace(one, y=one.y - ramp * (one.t_s - one.t_s[0])) for one in setup.rows]
    return replace(setup, rows=rows)


def _find_segments(rows: Sequence[Rows], span: float) -> list[DriveSegments]:
    """Return the segments of each recording's drive."""
    known = [~np.isnan(one.u) for one in rows]
    return [
        find_drive_segments(one.t_s[k], one.u[k], span) for one, k in zip(rows, known, strict=True)
    ]
