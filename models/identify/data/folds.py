"""Choose which rows are held out together: stretches of the drive that differ from each other.

The second cycle of a repeating drive contains nothing new: any fit predicts rows held out there,
however overfitted. So a recording is cut at the turns of the drive and each segment between two
turns is cut into parts. Parts of segments that begin and end alike are one stretch wherever they
occur, and a whole stretch is held out. A richer model must gain on stretches that it has not seen.
"""

from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dehyst.models.identify.data.rows import Rows
from dehyst.models.identify.tuning import TUNING
from dehyst.models.recording import Bools, Floats

Labels = NDArray[np.int32]


def assign_pieces(
    rows: Sequence[Rows],
    picks: Sequence[Bools],
    low: float,
    high: float,
    parts: int = TUNING.parts,
) -> int:
    """Write the stretch of each row into each recording's `piece`, and return the number of folds.

    Piece p is held out with all pieces that have the same remainder modulo that number; each fold
    has TUNING.pieces pieces, over which gains are compared. parts: of a segment; 1: whole segments.
    """
    grid = TUNING.minor * (high - low)
    size = TUNING.small * (high - low)
    labels = [_label(one.u, low, grid, parts, size) for one in rows]
    found = [np.bincount(label[pick]) for label, pick in zip(labels, picks, strict=True)]
    counts = np.zeros(max(c.size for c in found), dtype=np.int64)
    for c in found:
        counts[: c.size] += c
    kinds = np.flatnonzero(counts)
    sizes = counts[kinds]
    folds = int(min(TUNING.folds, kinds.size))
    if folds < min(2, parts) + 1:  # too few different parts: use parts in time
        count = TUNING.folds * TUNING.pieces
        for one in rows:
            step = max(1, -(-one.u.size // (2 * count)))
            one.piece = np.repeat(np.arange(2 * count, dtype=np.int8) % count, step)[: one.u.size]
        return TUNING.folds
    filled, piece_of = np.zeros(folds * TUNING.pieces), np.zeros(kinds.size, dtype=np.int64)
    for at in np.argsort(-sizes, kind="stable"):
        fold = int(np.argmin(filled.reshape(TUNING.pieces, folds).sum(axis=0)))
        piece_of[at] = fold + folds * int(np.argmin(filled[fold::folds]))
        filled[piece_of[at]] += sizes[at]
    table = np.full(max(int(label.max()) for label in labels) + 1, piece_of[-1], dtype=np.int8)
    table[kinds] = piece_of
    for one, label in zip(rows, labels, strict=True):
        one.piece = table[label]
    return folds


@njit(cache=True, nogil=True)
def _label(u: Floats, low: float, grid: float, parts: int, size: float) -> Labels:
    """Return a number (N,) for each row: its segment (start and end, on a grid from `low`) and its
    part of it; turns smaller than `size` are ignored."""
    out = np.zeros(u.size, dtype=np.int32)
    first = 0
    while first < u.size and np.isnan(u[first]):
        first += 1
    if first == u.size:
        return out
    origin = extreme = u[first]
    begin = turn = first  # the segment's first row, and the row of its extreme
    direction = 0.0
    for i in range(first, u.size):
        if np.isnan(u[i]):
            continue
        if direction == 0.0:
            if abs(u[i] - origin) > size:
                direction = 1.0 if u[i] > origin else -1.0
                extreme, turn = u[i], i
        elif (u[i] - extreme) * direction >= 0.0:
            extreme, turn = u[i], i
        elif (extreme - u[i]) * direction > size:
            _label_way(out, u, (begin, turn + 1), (origin, extreme), low, grid, parts)
            origin, begin = extreme, turn + 1
            extreme, turn = u[i], i
            direction = -direction
    _label_way(out, u, (begin, u.size), (origin, extreme), low, grid, parts)
    return out


@njit(cache=True, nogil=True)
def _label_way(
    out: Labels,
    u: Floats,
    rows: tuple[int, int],
    ends: tuple[float, float],
    low: float,
    grid: float,
    parts: int,
) -> None:
    """Write the labels of one segment."""
    way = (ends[0] - low) / grid + 0.5
    base = 4 * int(np.ceil(1.0 / TUNING.minor))
    start = int(way) * base + int((ends[1] - low) / grid + 0.5)
    length = max(abs(ends[1] - ends[0]), 1e-300)
    for i in range(rows[0], rows[1]):
        part = 0
        if not np.isnan(u[i]):
            part = min(parts - 1, int(parts * abs(u[i] - ends[0]) / length))
        out[i] = start * parts + part
