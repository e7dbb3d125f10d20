"""How a reading goes along the ways of a drive: from one turn of the drive to the next."""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from dehyst.models.recording import Floats

LONG_WAY = 0.5
"""Of the drive's range: a way that counts."""
BACK = 0.25
"""Of the reading's range, that it must come back by within one way."""
ENDS = 0.6
"""Of the way's own range: its ends lie no further apart where it came back."""
INSIDE = 0.15
"""Of the way, that lies to either side of where it turns: friction gives way at once."""
POINTS = 2000
"""Of a recording, to which it is averaged: noise must not look like a turn."""
FEWEST = 8
"""Points of a way that counts."""


def turns_within_ways(u: Floats, y: Floats, u_range: float, y_range: float) -> tuple[int, int]:
    """(long ways of the drive, those in which the reading turns round and comes back) of one
    recording (N,) without gaps."""
    each = max(1, u.size // POINTS)
    u, y = u[::each], y[: u.size // each * each].reshape(-1, each).mean(axis=1)
    u = u[: y.size]
    moves = np.flatnonzero(np.diff(u) != 0)
    turn = np.flatnonzero(np.diff(np.sign(np.diff(u)[moves])) != 0)
    at = moves[turn] + 1 if turn.size else np.zeros(0, int)
    ways = backs = 0
    for a, b in zip(np.r_[0, at], np.r_[at, u.size - 1], strict=True):
        if not abs(u[b] - u[a]) >= LONG_WAY * u_range or b - a < FEWEST:
            continue
        way = y[a : b + 1]
        net, size = abs(float(way[-1] - way[0])), float(np.ptp(way))
        done = (u[a : b + 1] - u[a]) / (u[b] - u[a])
        off_line = way - way[0] - done * (way[-1] - way[0])
        inside = INSIDE < done[np.argmax(np.abs(off_line))] < 1.0 - INSIDE
        ways += 1
        backs += bool(inside) and size - net > BACK * y_range and net < ENDS * size
    return ways, backs


SMALL_WAY = 0.05
"""Of the drive's range: a smaller way back is no turn."""
ALIKE = 1.3
"""Longest over shortest duration (and size) of ways that count as one loop repeated."""
ENDS_LEFT_OUT = 0.1
"""Share of a recording's ways, at each end of the order, that may be anything."""
EDGE = 0.1
"""Of the time of a way, in which half of it is travelled: a sine needs a third, a triangle half."""
MOST_POINTS = 20_000
"""Of a recording, on which turns are sought."""


class Ways(NamedTuple):
    """The ways of one drive from turn to turn: (W,) durations [s], sizes, and shares of the
    duration in which the fastest half of the way is travelled."""

    durations: Floats
    sizes: Floats
    fastest: Floats


def ways_of(t: Floats, u: Floats, u_range: float) -> Ways:
    """The ways of a drive u (N,) at times t (N,); what is before the first turn and after the last
    is left out, and ways back of less than SMALL_WAY are none."""
    each = max(1, u.size // MOST_POINTS)
    t, u = t[::each], u[::each]
    turns = _find_turns(u, SMALL_WAY * u_range)
    fastest = [_fastest_half(t[a : b + 1], u[a : b + 1]) for a, b in pairwise(turns)]
    at = np.array(turns, int)
    return Ways(np.diff(t[at]), np.abs(np.diff(u[at])), np.array(fastest))


def _find_turns(u: Floats, least: float) -> list[int]:
    """Rows of the extremes between which the drive goes by more than this; the first direction that
    it takes is no turn."""
    turns: list[int] = []
    low = high = 0
    direction = 0
    for i in range(u.size):
        if direction >= 0 and u[i] > u[high]:
            high = i
        if direction <= 0 and u[i] < u[low]:
            low = i
        if direction >= 0 and u[high] - u[i] > least:
            turns += [high] if direction else []
            direction, low = -1, i
        elif direction <= 0 and u[i] - u[low] > least:
            turns += [low] if direction else []
            direction, high = 1, i
    return turns


def _fastest_half(t: Floats, u: Floats) -> float:
    """Share of the duration in which the fastest half of the travel is done."""
    steps, times = np.abs(np.diff(u)), np.diff(t)
    order = np.argsort(-steps / np.maximum(times, 1e-300))
    done = np.cumsum(steps[order])
    taken = np.cumsum(times[order])
    return float(taken[np.searchsorted(done, 0.5 * done[-1])] / max(taken[-1], 1e-300))


def repeats_one_loop(recordings: Sequence[Ways]) -> bool:
    """Whether the ways of all recordings are alike in duration and size and none has an edge: one
    loop at one rate, which does not distinguish what depends on the rate from what does not."""
    known = [ways for ways in recordings if ways.durations.size >= 2]
    if not known:
        return True
    if any(float(np.median(ways.fastest)) < EDGE for ways in known):
        return False
    ends = (ENDS_LEFT_OUT, 1.0 - ENDS_LEFT_OUT)
    for which in ("durations", "sizes"):
        found = np.array([np.quantile(getattr(ways, which), ends) for ways in known])
        if found[:, 1].max() > ALIKE * found[:, 0].min():
            return False
    return True
