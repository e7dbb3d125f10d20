"""Excerpts of recordings that are too long to be fitted whole: some stretches of each, at their
full rate.

Between two stretches only the drive's extremes are kept, so that the memory of its path continues
as it was; filters start again at each stretch, and the samples they need to settle are not counted.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from dehyst.models.diagnosis.tuning import TUNING
from dehyst.models.signals.joined import Data, Ints

STRETCHES = 4  # of each recording that is cut
EXTREMES = 400  # pieces between two stretches, of which the lowest and the highest drive are kept
SETTLES = 0.02  # of a stretch, for filters to settle


def excerpt(data: Data, most: int = TUNING.most_rows) -> Data:
    """Return the same data with at most about `most` samples."""
    if data.n <= most:
        return data
    share = most / data.n
    index, head, between = [], [], []
    for i in range(len(data.names)):
        at = np.flatnonzero(data.rec == i)
        each = max(int(share * at.size / STRETCHES), 1)
        begins = np.linspace(0, at.size - each, STRETCHES).astype(int)
        last = 0
        for begin in begins:
            skipped = _extremes(data, at[last:begin])
            window = at[begin : begin + each]
            settles = np.arange(each) < SETTLES * each
            index += [skipped, window]
            head += [np.ones(skipped.size, bool), settles & (begin > 0)]
            between += [np.ones(skipped.size, bool), np.zeros(each, bool)]
            last = begin + each
    k, cut, apart = np.concatenate(index), np.concatenate(head), np.concatenate(between)
    rec = data.rec[k]
    # filters start again wherever rows were left out, and at every extreme
    starts = data.starts[k] | apart | np.r_[True, np.diff(k) > 1]
    broken = (np.diff(k) > 1) & ~(apart[1:] & apart[:-1]) | (np.diff(data.part[k]) != 0)
    part = np.cumsum(np.r_[True, broken]) - 1
    part = part + np.cumsum(np.r_[False, np.diff(apart.astype(int)) != 0])
    order = np.concatenate([np.arange(int(np.sum(rec == i))) for i in range(len(data.names))])
    size = np.bincount(rec, minlength=len(data.names))[rec]
    kept: dict[str, Any] = {
        name: getattr(data, name)[k] for name in ("t", "dt", "u", "y", "forgets", "raw_index")
    }
    return replace(
        data,
        **kept,
        rec=rec,
        part=part,
        starts=starts,
        rows=data.rows[k] & ~cut,
        heads=data.heads[k] & ~cut,
        block=rec * TUNING.time_blocks
        + np.asarray(order * TUNING.time_blocks // size, dtype=np.int64),
        fold=order * (TUNING.folds * TUNING.time_blocks) // size % TUNING.folds,
        channels={name: c[k] for name, c in data.channels.items()},
    )


def _extremes(data: Data, at: Ints) -> Ints:
    """Return, of consecutive samples, the lowest and the highest drive of each piece, in order."""
    if at.size == 0:
        return at
    pieces = np.array_split(at, min(EXTREMES, at.size))
    found = [j for p in pieces for j in (p[np.argmin(data.u[p])], p[np.argmax(data.u[p])])]
    return np.unique(found)
