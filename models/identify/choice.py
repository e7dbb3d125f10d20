"""Choose the structure that recordings support: without outliers, next to a straight drift, and
static where their drives have one rate."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from dehyst.models.identify.data.rows import Rows
from dehyst.models.identify.identified import Options
from dehyst.models.identify.search import Search
from dehyst.models.identify.setup import FitSetup
from dehyst.models.identify.structure import TriedStructure, list_shapes
from dehyst.models.identify.tuning import TUNING
from dehyst.models.signals.drive_segments import (
    DriveSegments,
    find_drive_segments,
    find_one_period,
    repeats_one_loop,
)


class Choice(NamedTuple):
    """The chosen structure, with the rows that remained. setup: without the drift; notes: what was
    left out; static: the drives have one rate, which shows no dynamics; ramp: the straight drift
    that was subtracted [displacement/s]."""

    setup: FitSetup
    search: Search
    tried: list[TriedStructure]
    best: TriedStructure
    notes: list[str]
    static: bool
    ramp: float = 0.0

    def outlasts_drift(self, period_s: float) -> bool:
        """Return whether the chosen dynamics predict next to a drift too."""
        return self.search.outlasts_drift(self.best, self.tried, period_s)


def make_choice(setup: FitSetup, options: Options, progress: Callable[[str], None]) -> Choice:
    """Choose the structure of a model of these recordings."""
    drives = _find_segments(setup.rows, setup.span)
    found = _choose(setup, options, progress, repeats_one_loop(drives))
    if ramp := _find_ramp(found, drives):
        rest = without_ramp(found.setup, ramp)
        flat = _choose(rest, options, progress, found.static, ramp, found.notes)
        if flat.best.held_rms**2 < (1.0 - TUNING.minor) * found.best.held_rms**2:
            found = flat
    period_s = None if found.static else find_one_period(drives)
    dynamic = found.best.lag is not None or (found.best.shape.rate and options.rate is None)
    outlasts = period_s is None or not dynamic or found.outlasts_drift(period_s)
    if not outlasts:
        found = _choose(found.setup, options, progress, True, found.ramp, found.notes)
    if found.static:
        found.notes.append(
            f"{'one loop at one rate' if outlasts else 'one rate, with drift or creep'}: lag, "
            "delay, resonance and rate-dependence cannot be distinguished from the hysteresis, and "
            "the model is static; a second recording at another rate, or one with an edge, "
            "identifies it"
        )
    return found


def _choose(
    setup: FitSetup,
    options: Options,
    progress: Callable[[str], None],
    one_rate: bool,
    ramp: float = 0.0,
    known: Sequence[str] = (),
) -> Choice:
    """Choose the structure, again without the outliers that it shows. one_rate: the recordings
    cannot show dynamics; ramp: the drift that was subtracted; known: notes on what was left out
    before."""
    notes = list(known)
    wanted = list_shapes(options.rate, options.saturation, options.bias)
    if setup.rate_max <= 0.0 or (one_rate and options.rate is None):
        wanted = [s for s in wanted if not s.rate]
    for left in range(TUNING.rounds, -1, -1):
        search = Search(setup, wanted, progress, not one_rate, bool(ramp))
        tried = search.run()
        best = search.choose(tried)
        errors = setup.residuals(search.r, best.shape, best.params, best.offset, best.lag)
        fewer, count = setup.without_outliers(errors) if left else (setup, 0)
        if not count:
            break
        notes.append(f"{count} lone displacement values far off their neighbours were left out")
        setup = fewer
        if count <= 1e-3 * errors[0].size:
            break
    return Choice(setup, search, tried, best, notes, one_rate, ramp)


def _find_ramp(found: Choice, drives: Sequence[DriveSegments]) -> float:
    """Return the straight drift of a single recording [displacement/s], 0 if it shows none. With
    several recordings, each has its own offset."""
    durations = np.concatenate([one.durations for one in drives])
    if len(drives) != 1 or not durations.size or 0 not in found.best.shape.powers:
        return 0.0
    return found.search.find_ramp(found.best, 2.0 * float(np.median(durations)))


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
