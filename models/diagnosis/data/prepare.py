"""Prepare recordings for the diagnosis: lay them on their sampling grid, join them, mark rows to
leave out.

A missing row stays missing: on the grid the drive is interpolated between its neighbours, so that
every operator runs through it, and no fit counts it. After a stall of the recorder the drive's path
is not known, and the rows that follow are left out until the stage has settled. After a long gap
the recording starts again, in another part.

Times, drive, displacement and channels of all recordings are in one array each; `starts` marks
where a part begins. `rows` are the samples that the fits count; the states of all operators run
through every sample.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from dehyst.models.diagnosis.tuning import TUNING
from dehyst.models.errors import BadRecording, DehystError
from dehyst.models.identify.data.rows import check_scale, read_rows
from dehyst.models.identify.setup import set_up
from dehyst.models.identify.start import start_agrees
from dehyst.models.recording import Recording, typical_step
from dehyst.models.signals.joined import Bools, Data, Floats, Ints
from dehyst.models.signals.lone import lone_readings, readings_on_curves
from dehyst.models.signals.pasts import FRESH
from dehyst.models.signals.repeats import find_repeats

FIRST_WAY = 0.8  # of the drive's range: end of the first sweep
JITTER = 1.001  # periods per period that passes: above, jitter was rounded up to whole ones
ALIKE = (0.5, 1.5)  # times the shortest step, between which a step counts as one period
TIGHT = 0.1  # of the shortest step: largest standard deviation of the steps of one period
MIXED = 1.3  # times the shortest step: a typical step above is a mean of one and several periods
AT_LOWEST = 0.02  # of the drive's range: a part that begins within it begins at the lowest drive
SWEPT = 0.6  # of the drive's range: once swept, the rows of a part count
MISSED = "missed"  # channel of the daemon's recordings: 1 where the sample came late


@dataclass(frozen=True)
class GriddedRecording:
    """One recording on its sampling grid: arrays (n,).

    raw: row of the recording, -1 where there is none; cut: a part begins; known: the reading exists
    and the drive's path to it is known.
    """

    t: Floats
    u: Floats
    y: Floats
    raw: Ints
    cut: Bools
    known: Bools
    dt: float
    missing: int
    repeats: int
    frozen: int
    lone: int
    stalls: int


def lay_on_grid(one: Recording) -> GriddedRecording:
    """Lay a recording on the grid of its sampling period. Raises BadRecording where there are too
    few usable samples."""
    assert one.displacement is not None
    t, u, y = (np.asarray(a, dtype=float) for a in (one.t_s, one.drive, one.displacement))
    again, frozen = find_repeats(y, u)
    y = np.where(again | frozen, np.nan, y)
    lone = lone_readings(y, u) & ~readings_on_curves(y)
    y = np.where(lone, np.nan, y)
    raw = np.flatnonzero(np.isfinite(t) & np.isfinite(u))
    repeats, wild, stuck = (int(np.count_nonzero(x[raw])) for x in (again, lone, frozen))
    there = int(np.count_nonzero(np.isfinite(y[raw])))
    if there < TUNING.least_samples:
        raise BadRecording(
            f"{one.name}: only {there} usable samples; at least {TUNING.least_samples} are needed"
        )
    late = one.channels.get(MISSED)
    dt = _period(np.diff(t[raw]), typical_step(t))
    steps = np.maximum(np.round(np.diff(t[raw]) / dt), 1.0)
    near = steps <= TUNING.stall
    if np.sum(steps[near]) > JITTER * np.sum(np.diff(t[raw])[near]) / dt + 2:  # 2: rounding
        steps[near] = 1.0  # the time stamps jitter, the samples do not
    long = steps > TUNING.long_gap
    place = np.r_[0, np.cumsum(np.where(long, 1.0, steps))].astype(np.int64)
    n = int(place[-1]) + 1
    grid = np.arange(n)
    laid_raw = np.full(n, -1, dtype=np.int64)
    laid_raw[place] = raw
    reading = np.full(n, np.nan)
    reading[place] = y[raw]
    known = np.isfinite(reading)
    cut = np.zeros(n, dtype=bool)
    cut[0] = True
    cut[place[1:][long]] = True
    stalled = (steps > TUNING.stall) & ~long
    held_up = np.zeros(n, dtype=bool)
    for at, size in zip(place[1:][stalled], steps[stalled], strict=True):
        held_up[at : at + max(TUNING.settling, int(size))] = True
    if late is not None:
        for at in place[np.nan_to_num(late[raw]) > 0]:
            held_up[at : at + TUNING.settling] = True
    reading = np.interp(grid, np.flatnonzero(known), reading[known])
    return GriddedRecording(
        t=np.interp(grid, place, t[raw]),
        u=np.interp(grid, place, u[raw]),
        y=reading,
        raw=laid_raw,
        cut=cut,
        known=known & ~held_up,
        dt=dt,
        # in a pause no readings are missing
        missing=int(np.count_nonzero(~known)) - repeats - wild - stuck,
        repeats=repeats,
        frozen=stuck,
        lone=wild,
        stalls=int(np.count_nonzero(steps > TUNING.stall)),
    )


def _period(steps: Floats, typical: float) -> float:
    """Return the sampling period [s]: that of the short steps, where these are of one length; the
    typical step is a mean of one and two periods where every third row is missing. It is not used
    where most of that grid would be empty."""
    shortest = float(np.quantile(steps, 0.1))  # not the least: jitter shortens some
    low, high = ALIKE
    alike = steps[(steps > low * shortest) & (steps < high * shortest)]
    tight = float(np.std(alike)) < TIGHT * shortest
    tight &= float(np.mean(steps)) < TUNING.few_of_grid * shortest
    return float(np.mean(alike)) if tight and typical > MIXED * shortest else typical


def prepare(recordings: Sequence[Recording], virgin: bool = True) -> Data:
    """Join recordings of one stage. virgin: a part that begins at the lowest drive was de-energised
    before. Raises BadRecording where they cannot be diagnosed."""
    if not recordings:
        raise BadRecording("no recording given; the diagnosis needs at least one")
    shared = set(recordings[0].channels) - {MISSED}
    for one in recordings[1:]:
        shared &= set(one.channels)
    pieces: list[dict[str, Any]] = []  # keyed by field names of Data
    channels: dict[str, list[Floats]] = {k: [] for k in sorted(shared)}
    part = block = missing = repeats = frozen = lone = stalls = 0
    lowest = min(_lowest_drive(one) for one in recordings)
    units = {(_units(one)) for one in recordings}
    if len(units) > 1:
        raise BadRecording("the recordings have different units; diagnose one stage at a time")
    for index, one in enumerate(recordings):
        if one.displacement is None:
            raise BadRecording(
                f"{one.name}: no displacement column (y_um, ...); a diagnosis compares with it"
            )
        check_scale(one)
        laid = lay_on_grid(one)
        n = laid.u.size
        there = laid.raw >= 0
        missing, stalls = missing + laid.missing, stalls + laid.stalls
        repeats, lone = repeats + laid.repeats, lone + laid.lone
        frozen += laid.frozen
        for k, pieces_of_it in channels.items():
            values = _filled(np.asarray(one.channels[k], dtype=float))[laid.raw[there]]
            pieces_of_it.append(np.interp(np.arange(n), np.flatnonzero(there), values))
        first = np.zeros(n, dtype=np.int64)
        first[0] = FRESH
        history = _known_history(laid.u, laid.cut, lowest if virgin else -np.inf)
        pieces.append(
            {
                "t": laid.t,
                "u": laid.u,
                "y": laid.y,
                "dt": np.full(n, laid.dt),
                "rec": np.full(n, index),
                "starts": laid.cut,
                "forgets": first,
                "part": part + np.cumsum(laid.cut) - 1,
                "rows": history & laid.known,
                "heads": ~history & laid.known,
                "block": block + _cut_evenly(n, TUNING.time_blocks),
                "fold": _groups(laid.u),
                "raw_index": laid.raw,
            }
        )
        part += int(laid.cut.sum())
        block += TUNING.time_blocks
    arrays: dict[str, Any] = {k: np.concatenate([p[k] for p in pieces]) for k in pieces[0]}
    joined = {k: np.concatenate(some) for k, some in channels.items()}
    drive_unit, unit = next(iter(units))
    data = Data(
        names=tuple(one.name for one in recordings),
        **arrays,
        channels={k: c for k, c in joined.items() if np.all(np.isfinite(c)) and np.ptp(c) > 0},
        drive_unit=drive_unit,
        unit=unit,
        missing=missing,
        repeats=repeats,
        frozen=frozen,
        lone=lone,
        stalls=stalls,
    )
    if data.span <= 0:
        raise BadRecording("the drive never moves; a diagnosis needs a moving drive")
    if np.ptp(data.y) <= 0:
        raise BadRecording("the displacement never moves; nothing can be diagnosed")
    return data


def _units(one: Recording) -> tuple[str, str]:
    return one.drive_unit, one.displacement_unit


def _filled(x: Floats) -> Floats:
    """Return a slow channel with its missing samples interpolated."""
    good = np.isfinite(x)
    if good.all() or not good.any():
        return x
    return np.interp(np.arange(x.size), np.flatnonzero(good), x[good])


def _cut_evenly(size: int, pieces: int) -> Ints:
    """Return (size,) the index of the piece of each sample, for that number of consecutive pieces
    of equal length."""
    return np.arange(size) * pieces // size


def _groups(u: Floats) -> Ints:
    """Return (n,) the cross-validation group of each sample, -1 where it is in none: the first
    sweep over the drive's range occurs once, and nothing else predicts it."""
    out = _cut_evenly(u.size, TUNING.folds * TUNING.time_blocks) % TUNING.folds
    swept = np.maximum.accumulate(u) - np.minimum.accumulate(u)
    head = int(np.searchsorted(swept, FIRST_WAY * float(swept[-1])))
    out[: min(head, u.size // 4)] = -1  # at most a quarter: the rest must be predicted
    return out


def were_de_energised(recordings: Sequence[Recording]) -> bool:
    """Return whether what begins at the lowest drive looks as if the stage had been de-energised
    before (dehyst.models.identify.start); True where that cannot be decided."""
    try:
        setups = [set_up([read_rows(one)], monotone=True) for one in recordings]
        return all(start_agrees(setup, rate=False) for setup in setups)
    except (DehystError, ValueError):  # also where a drive has no rows
        return True


def _lowest_drive(one: Recording) -> float:
    """Return the lowest drive of a recording; inf where there is none."""
    known = one.drive[np.isfinite(one.drive)]
    return float(known.min()) if known.size else np.inf


def _known_history(u: Floats, cut: Bools, lowest: float) -> Bools:
    """Return rows that are False at the head of each part until the drive has swept most of its
    range.

    lowest: a part that starts there was de-energised, and counts from the start. At most a third of
    a part is left out.
    """
    rows = np.ones(u.size, dtype=bool)
    span = float(np.ptp(u))
    bounds = np.r_[np.flatnonzero(cut), u.size]
    for a, b in pairwise(bounds):
        if abs(u[a] - lowest) < AT_LOWEST * span:
            continue
        x = u[a:b]
        swept = np.maximum.accumulate(x) - np.minimum.accumulate(x)
        head = int(np.searchsorted(swept, SWEPT * span))
        rows[a : a + min(head, (b - a) // 3)] = False
    return rows
