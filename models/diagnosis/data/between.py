"""The drive between two samples, for slow sampling: its path on a finer grid.

A hysteresis turns where the drive turns, and that is seldom at a sample. Straight lines between the
samples of a smooth drive cut its peaks off; with ten samples a period they miss a twentieth of its
swing, with five a fifth, and a delay or a lag is then fitted to what they miss. A smooth drive is
known between its samples: by a spline of the fifth degree, which is close to the band-limited
interpolation (M. Unser, IEEE Signal Process. Mag. 16(6), 1999). A drive counts as smooth if every
second of its samples is predicted by the others.
"""

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.interpolate import make_interp_spline

from dehyst.models.diagnosis.tuning import TUNING
from dehyst.models.signals.joined import Data, Ints

DEGREE = 5
LEAST = 4 * DEGREE  # samples of the shortest part that is refined: half of them carry a spline
THIRDS = 3
"""Refinement that is enough to distinguish a smooth path from steps: straight lines then miss a
ninth of what they missed, and there is room for it at any number of samples."""


def with_path_between(data: Data, sigma: float) -> Data:
    """Return the recordings with the drive's path between their samples; unchanged where it would
    make no difference: where straight lines are near enough, or the drive is not smooth. sigma:
    noise rms."""
    times = refinement_factor(data, sigma)
    return data if times < 2 else _laid_finer(data, times)


def with_smooth_path(data: Data, sigma: float) -> Data:
    """Return the recordings with the path of a drive that is assumed to be smooth, even if straight
    lines miss it by less than the noise; unchanged if nothing of the path is visible, or if it is
    already known."""
    if data.early or data.stepped or data.path is not data:
        return data
    times = min(_wanted_factor(data, sigma), THIRDS)
    return data if times < 2 else _laid_finer(data, times)


def refinement_factor(data: Data, sigma: float) -> int:
    """Return the factor by which the path's grid is refined; 1: not at all."""
    if data.early or data.stepped or data.path is not data:
        return 1
    parts = _parts(data)
    if min(k.size for k in parts) < LEAST:
        return 1
    if _missed_by_lines(data, parts) < sigma or not _is_smooth(data, parts):
        return 1
    most = min(TUNING.between_most, TUNING.most_rows // data.n)
    return min(_wanted_factor(data, sigma), most)


def _wanted_factor(data: Data, sigma: float) -> int:
    """Return the factor of a grid whose straight lines miss a smooth path by a trace of the
    noise."""
    parts = _parts(data)
    if min(k.size for k in parts) < LEAST:
        return 1
    return int(np.ceil(np.sqrt(_missed_by_lines(data, parts) / (TUNING.trace * sigma))))


def _missed_by_lines(data: Data, parts: list[Ints]) -> float:
    """Return the rms, midway between samples, of a spline less the straight line, as far as the
    stage follows: in the unit of the displacement."""
    square = count = 0.0
    for k in parts:
        at, u = np.arange(k.size, dtype=float), data.u[k]
        miss = make_interp_spline(at, u, DEGREE)(at[:-1] + 0.5) - 0.5 * (u[1:] + u[:-1])
        square, count = square + float(miss @ miss), count + miss.size
    return float(np.sqrt(square / count)) * float(np.ptp(data.y)) / data.span


def _is_smooth(data: Data, parts: list[Ints]) -> bool:
    """Return whether a spline through every second sample predicts the others far better than
    straight lines do."""
    lines = splines = 0.0
    for k in parts:
        at, u = np.arange(k.size, dtype=float), data.u[k]
        for first in (0, 1):
            known = slice(first, None, 2)
            inner = np.arange(first + 1, k.size - 1, 2)
            curve = make_interp_spline(at[known], u[known], DEGREE)(inner)
            line = np.interp(inner, at[known], u[known])
            splines += float(np.sum((u[inner] - curve) ** 2))
            lines += float(np.sum((u[inner] - line) ** 2))
    return splines < TUNING.clear**2 * lines


def _laid_finer(data: Data, times: int) -> Data:
    """Return the recordings with their path on a grid finer by that factor."""
    pieces, places, first = [], [], 0
    for k in _parts(data):
        size = (k.size - 1) * times + 1
        at, fine = np.arange(k.size, dtype=float), np.arange(size) / times
        here = int(k[0])
        pieces.append(
            replace(
                data,
                t=np.interp(fine, at, data.t[k]),
                dt=np.full(size, data.dt[here] / times),
                u=make_interp_spline(at, data.u[k], DEGREE)(fine),
                rec=np.full(size, data.rec[here]),
                part=np.full(size, data.part[here]),
                starts=_begun(size, data.starts[here]),
                forgets=_begun(size, data.forgets[here]),
                channels={c: np.interp(fine, at, x[k]) for c, x in data.channels.items()},
            )
        )
        places.append(first + times * np.arange(k.size, dtype=np.int64))
        first += size

    laid = ("t", "dt", "u", "rec", "part", "starts", "forgets")
    joined: dict[str, Any] = {k: np.concatenate([getattr(x, k) for x in pieces]) for k in laid}
    none = np.zeros(first, dtype=np.int64)
    path = replace(
        data,
        **joined,
        y=np.zeros(first),
        rows=none > 0,
        heads=none > 0,
        block=none,
        fold=none,
        channels={c: np.concatenate([x.channels[c] for x in pieces]) for c in data.channels},
        raw_index=none - 1,
    )
    return replace(data, between=path, places=np.concatenate(places))


def _begun(size: int, mark: Any) -> Any:
    """Return (size,) a mark on the first sample alone."""
    out = np.zeros(size, dtype=np.asarray(mark).dtype)
    out[0] = mark
    return out


def _parts(data: Data) -> list[Ints]:
    """Return the samples of each contiguous stretch."""
    return [np.flatnonzero(data.part == p) for p in np.unique(data.part)]
