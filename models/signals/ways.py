"""How a reading goes along the ways of a drive: from one turn of the drive to the next."""

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
"""Share of the ways, at each end of the order, that may be anything (the start, the last one)."""
MOST_POINTS = 20_000
"""Of a recording, on which turns are sought."""


def ways_of(t: Floats, u: Floats, u_range: float) -> tuple[Floats, Floats]:
    """(durations [s], sizes) of the ways (W,) of a drive u (N,) at times t (N,) from turn to turn,
    the first and the last one left out; ways back of less than SMALL_WAY are none."""
    each = max(1, u.size // MOST_POINTS)
    t, u = t[::each], u[::each]
    least = SMALL_WAY * u_range
    turns: list[int] = []
    low = high = 0
    direction = 0
    for i in range(u.size):
        if direction >= 0 and u[i] > u[high]:
            high = i
        if direction <= 0 and u[i] < u[low]:
            low = i
        if direction >= 0 and u[high] - u[i] > least:
            turns.append(high)
            direction, low = -1, i
        elif direction <= 0 and u[i] - u[low] > least:
            turns.append(low)
            direction, high = 1, i
    at = np.array(turns, int)
    return np.diff(t[at]), np.abs(np.diff(u[at]))


def repeats_one_loop(durations: Floats, sizes: Floats) -> bool:
    """Whether ways are all alike in duration and size: one loop at one rate, which does not
    distinguish what depends on the rate from what does not."""
    if durations.size < 2:
        return True
    low, high = ENDS_LEFT_OUT, 1.0 - ENDS_LEFT_OUT
    for values in (durations, sizes):
        shortest, longest = np.quantile(values, [low, high])
        if longest > ALIKE * shortest:
            return False
    return True
