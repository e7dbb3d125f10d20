"""Recordings made ready for the diagnosis: joined, cut at gaps, with rows to leave out.

Times, drive, displacement and channels of all recordings stand in one array each; `starts`
marks where a recording (or the part behind a gap) begins. `rows` are the samples the fits
count; the states of all operators run through every sample.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from dehyst.models.diagnosis.tuning import TUNING
from dehyst.models.errors import BadRecording
from dehyst.models.recording import Recording
from dehyst.models.signals.joined import Bools, Data, Floats, Ints


def prepare(recordings: Sequence[Recording]) -> Data:
    """Join recordings of one stage. Raises BadRecording where they cannot be diagnosed."""
    if not recordings:
        raise BadRecording("no recording given; the diagnosis needs at least one")
    shared = set(recordings[0].channels)
    for one in recordings[1:]:
        shared &= set(one.channels)
    pieces: list[dict[str, NDArray]] = []
    part = block = 0
    units = {(_units(one)) for one in recordings}
    if len(units) > 1:
        raise BadRecording("the recordings have different units; diagnose one stage at a time")
    for index, one in enumerate(recordings):
        if one.displacement is None:
            raise BadRecording(
                f"{one.name}: no displacement column (y_um, ...); a diagnosis compares with it"
            )
        t, u, y = (np.asarray(a, dtype=float) for a in (one.t_s, one.drive, one.displacement))
        good = np.isfinite(t) & np.isfinite(u) & np.isfinite(y)
        raw = np.flatnonzero(good)
        if raw.size < TUNING.least_samples:
            raise BadRecording(
                f"{one.name}: only {raw.size} usable samples; at least {TUNING.least_samples} are "
                "needed"
            )
        channels = {
            k: _filled(np.asarray(one.channels[k], dtype=float))[raw] for k in sorted(shared)
        }
        t, u, y = t[raw], u[raw], y[raw]
        dt = float(np.median(np.diff(t)))
        cut = np.r_[True, np.diff(t) > 1.9 * dt]
        pieces.append(
            {
                "t": t,
                "u": u,
                "y": y,
                "dt": np.full(raw.size, dt),
                "rec": np.full(raw.size, index),
                "starts": cut,
                "part": part + np.cumsum(cut) - 1,
                "rows": _known_history(u, cut),
                "block": block + _cut_evenly(raw.size, TUNING.time_blocks),
                "fold": _cut_evenly(raw.size, TUNING.folds * TUNING.fold_pieces) % TUNING.folds,
                "raw": raw,
                **{"ch_" + k: v for k, v in channels.items()},
            }
        )
        part += int(cut.sum())
        block += TUNING.time_blocks
    joined = {k: np.concatenate([p[k] for p in pieces]) for k in pieces[0]}
    drive_unit, unit = next(iter(units))
    data = Data(
        names=tuple(one.name for one in recordings),
        t=joined["t"],
        dt=joined["dt"],
        u=joined["u"],
        y=joined["y"],
        rec=joined["rec"],
        part=joined["part"],
        starts=joined["starts"],
        rows=joined["rows"],
        block=joined["block"],
        fold=joined["fold"],
        channels={
            k: joined["ch_" + k]
            for k in sorted(shared)
            if np.all(np.isfinite(joined["ch_" + k])) and np.ptp(joined["ch_" + k]) > 0
        },
        drive_unit=drive_unit,
        unit=unit,
        raw_index=joined["raw"],
    )
    if data.span <= 0:
        raise BadRecording("the drive never moves; a diagnosis needs a moving drive")
    if np.ptp(data.y) <= 0:
        raise BadRecording("the displacement never moves; nothing can be diagnosed")
    return data


def turns(data: Data) -> int:
    """How often the drive turns round after a move of a tenth of its range, in all recordings."""
    count = 0
    for p in np.unique(data.part):
        u = data.u[data.part == p]
        high = low = float(u[0])
        direction = 0
        for v in u[:: max(1, u.size // 4000)]:
            high, low = max(high, v), min(low, v)
            if direction >= 0 and high - v > 0.1 * data.span:
                count += direction > 0
                direction, low = -1, v
            elif direction <= 0 and v - low > 0.1 * data.span:
                count += direction < 0
                direction, high = 1, v
    return count


def _units(one: Recording) -> tuple[str, str]:
    return one.drive_unit, one.displacement_unit


def _filled(x: Floats) -> Floats:
    """A slow channel's missing samples hold the last known value."""
    good = np.isfinite(x)
    if good.all() or not good.any():
        return x
    return np.interp(np.arange(x.size), np.flatnonzero(good), x[good])


def _cut_evenly(size: int, pieces: int) -> Ints:
    """(size,) the piece that each sample is in, when so many of equal length follow each other."""
    return np.arange(size) * pieces // size


def _known_history(u: Floats, cut: Bools) -> Bools:
    """False at the head of each part until the drive has swept most of its range.

    A part that starts at the lowest drive is taken as de-energised and counted from the start.
    At most a third of a part is left out.
    """
    rows = np.ones(u.size, dtype=bool)
    span = float(np.ptp(u))
    bounds = np.r_[np.flatnonzero(cut), u.size]
    for a, b in pairwise(bounds):
        if u[a] - u.min() < 0.02 * span:
            continue
        x = u[a:b]
        swept = np.maximum.accumulate(x) - np.minimum.accumulate(x)
        head = int(np.searchsorted(swept, 0.6 * span))
        rows[a : a + min(head, (b - a) // 3)] = False
    return rows
