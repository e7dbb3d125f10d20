"""Which rows are held out together: stretches of the drive that differ from each other.

A drive that repeats itself tells nothing new in its second cycle: rows held out there are foretold
by any fit, however far it bends. So a recording is cut where the drive turns, each way between two
turns into parts, and parts of ways that begin and end alike are one stretch wherever they come; a
whole stretch is held out. What a model gains must show on stretches that it has not seen.
"""

from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dehyst.models.identify.rows import Rows
from dehyst.models.identify.tuning import TUNING
from dehyst.models.recording import Bools, Floats

Ints = NDArray[np.int64]


def assign_pieces(
    rows: Sequence[Rows], picks: Sequence[Bools], low: float, high: float, parts: int = TUNING.parts
) -> int:
    """Write into each recording's `piece` the stretch of each row; the number of folds.

    Piece p is held out with all pieces that leave the same rest when divided by that number; there
    are TUNING.pieces in every fold, over which gains are compared. parts: of a way; 1: whole ways.
    """
    labels = [_label(one.u, low, high, parts) for one in rows]
    used = np.concatenate([label[pick] for label, pick in zip(labels, picks, strict=True)])
    kinds, sizes = np.unique(used, return_counts=True)
    folds = int(min(TUNING.folds, kinds.size))
    if folds < min(2, parts) + 1:  # the drive does one thing: parts in time have to do
        count = TUNING.folds * TUNING.pieces
        for one in rows:
            one.piece = np.arange(one.u.size, dtype=np.int64) * 2 * count // one.u.size % count
        return TUNING.folds
    filled, piece_of = np.zeros(folds * TUNING.pieces), np.zeros(kinds.size, dtype=np.int64)
    for at in np.argsort(-sizes, kind="stable"):
        fold = int(np.argmin(filled.reshape(TUNING.pieces, folds).sum(axis=0)))
        piece_of[at] = fold + folds * int(np.argmin(filled[fold::folds]))
        filled[piece_of[at]] += sizes[at]
    for one, label in zip(rows, labels, strict=True):
        place = np.minimum(np.searchsorted(kinds, label), kinds.size - 1)
        one.piece = piece_of[place]
    return folds


def _label(u: Floats, low: float, high: float, parts: int) -> Ints:
    """(N,) a number for each row: its way (from where, to where), and which part of it."""
    span = high - low
    starts, ends = _find_ways(u, TUNING.turn * span)
    grid = TUNING.alike * span
    with np.errstate(invalid="ignore"):
        part = np.clip(
            parts * np.abs(u - starts) / np.maximum(np.abs(ends - starts), 1e-300), 0, parts - 0.1
        )
        numbers = [np.floor(np.nan_to_num((x - low) / grid) + 0.5) for x in (starts, ends)]
    base = 4 * int(np.ceil(1.0 / TUNING.alike))
    return ((numbers[0] * base + numbers[1]) * parts + np.nan_to_num(part) // 1).astype(np.int64)


@njit(cache=True, nogil=True)
def _find_ways(u: Floats, band: float) -> tuple[Floats, Floats]:
    """(N,) where the way of each row began and where it ends; turns smaller than band are none."""
    starts, ends = np.zeros(u.size), np.zeros(u.size)
    first = 0
    while first < u.size and np.isnan(u[first]):
        first += 1
    if first == u.size:
        return starts, ends
    origin = extreme = u[first]
    begin = turn = first  # the way's first row, and the row of its extreme
    direction = 0.0
    for i in range(first, u.size):
        if np.isnan(u[i]):
            continue
        if direction == 0.0:
            if abs(u[i] - origin) > band:
                direction = 1.0 if u[i] > origin else -1.0
                extreme, turn = u[i], i
        elif (u[i] - extreme) * direction >= 0.0:
            extreme, turn = u[i], i
        elif (extreme - u[i]) * direction > band:
            starts[begin : turn + 1], ends[begin : turn + 1] = origin, extreme
            origin, begin = extreme, turn + 1
            extreme, turn = u[i], i
            direction = -direction
    starts[begin:], ends[begin:] = origin, extreme
    return starts, ends
