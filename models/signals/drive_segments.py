"""Compare a reading with the segments of a drive, each from one turn of the drive to the next."""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from dehyst.models.recording import Floats

BUTTERFLY = (
    "the displacement falls and rises again while the drive moves in one direction (a butterfly "
    "loop, as of a ferroelectric driven through its coercive field)"
)
LONG_WAY = 0.5
"""Least length of a segment that counts, as a fraction of the drive range."""
BACK = 0.25
"""Least return of the reading within one segment, as a fraction of the reading's range."""
ENDS = 0.6
"""Largest distance between the ends of a segment with a return, as a fraction of its range."""
INSIDE = 0.15
"""Least distance of the turn from the ends, as a fraction of the segment: friction acts at once."""
POINTS = 2000
"""Number of points to which a recording is averaged, so that noise does not look like a turn."""
FEWEST = 8
"""Least number of points of a segment that counts."""


def count_reversing_segments(
    u: Floats, y: Floats, u_range: float, y_range: float
) -> tuple[int, int]:
    """Return (number of long segments of the drive, number of those in which the reading reverses
    and returns) for one recording (N,) without gaps."""
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


FAR_TURN, FARTHEST = 0.2, 0.15
"""Of a turn at which jumps are looked for: least travel that follows it, and largest travel up to
the row that is read right after it, as fractions of the drive's range."""


def find_jumps_at_turns(u: Floats, y: Floats, way: float) -> Floats:
    """Return (K,) by how much further the reading moves than a straight line, right after each turn
    of the drive, in the direction of the drive. u, y: (N,) without gaps; way: what counts as right
    after a turn, as a fraction of the drive's range."""
    span, gain = float(np.ptp(u)), float(np.ptp(np.quantile(y, [0.02, 0.98])))  # no outliers
    sense = np.sign(np.polyfit(u, y, 1)[0])
    found = []
    turns = find_turns(u, FAR_TURN * span)
    for turn, end in pairwise([*turns, u.size]):
        moved = np.abs(u[turn:end] - u[turn]) >= way * span
        if not moved.any():
            continue
        after, before = turn + int(np.argmax(moved)), max(turn - 2, 0)  # a gauge may be a row late
        step = float(u[after] - u[turn])
        if abs(step) < FARTHEST * span:
            reading = sense * np.sign(step) * float(y[after] - y[before])
            found.append(reading - gain * abs(step) / span)
    return np.array(found)


SMALL_WAY = 0.05
"""Smallest reversal that counts as a turn, as a fraction of the drive range."""
ALIKE = 1.3
"""Longest over shortest duration (and size) of segments that count as one repeated loop."""
ENDS_LEFT_OUT = 0.1
"""Fraction of a recording's segments, at each end of the sorted order, that is ignored."""
EDGE = 0.1
"""A segment has an edge if half of it is travelled in less than this fraction of its time; a sine
needs a third, a triangle half."""
MOST_POINTS = 20_000
"""Largest number of points of a recording in which turns are searched."""


class DriveSegments(NamedTuple):
    """The segments of one drive from turn to turn: (W,) durations [s], sizes, and fractions of the
    duration in which the fastest half of the segment is travelled."""

    durations: Floats
    sizes: Floats
    fastest: Floats


def find_drive_segments(t: Floats, u: Floats, u_range: float) -> DriveSegments:
    """Return the segments of a drive u (N,) at times t (N,), without those before the first turn
    and after the last; reversals of less than SMALL_WAY are ignored."""
    each = max(1, u.size // MOST_POINTS)
    t, u = t[::each], u[::each]
    turns = find_turns(u, SMALL_WAY * u_range)
    fastest = [_fastest_half(t[a : b + 1], u[a : b + 1]) for a, b in pairwise(turns)]
    at = np.array(turns, int)
    return DriveSegments(np.diff(t[at]), np.abs(np.diff(u[at])), np.array(fastest))


def find_turns(u: Floats, least: float) -> list[int]:
    """Return the rows of the extremes between which the drive moves by more than `least`; the start
    of the first move is not a turn."""
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
    """Return the fraction of the duration in which the fastest half of the travel is done."""
    steps, times = np.abs(np.diff(u)), np.diff(t)
    order = np.argsort(-steps / np.maximum(times, 1e-300))
    done = np.cumsum(steps[order])
    taken = np.cumsum(times[order])
    return float(taken[np.searchsorted(done, 0.5 * done[-1])] / max(taken[-1], 1e-300))


def find_one_period(recordings: Sequence[DriveSegments]) -> float | None:
    """Return the period [s] at which the drive of all recordings repeats, whatever the sizes of its
    segments; None if their durations differ or a recording has edges, which show other rates."""
    known = [ways for ways in recordings if ways.durations.size >= 2]
    if not known or any(float(np.median(ways.fastest)) < EDGE for ways in known):
        return None
    durations = [ways.durations for ways in known]
    return 2.0 * float(np.median(np.concatenate(durations))) if _alike(durations) else None


def repeats_one_loop(recordings: Sequence[DriveSegments]) -> bool:
    """Return whether the segments of all recordings are alike in duration and size, and no
    recording has edges: one loop at one rate cannot show what depends on the rate."""
    known = [ways for ways in recordings if ways.durations.size >= 2]
    if not known:
        return True
    return find_one_period(known) is not None and has_one_size(known)


def has_one_size(recordings: Sequence[DriveSegments]) -> bool:
    """Return whether the segments of all recordings are alike in size: loops of other sizes are not
    shown. Recordings of fewer than two segments show no loop."""
    known = [ways for ways in recordings if ways.durations.size >= 2]
    return not known or _alike([ways.sizes for ways in known])


def _alike(values: Sequence[Floats]) -> bool:
    """Return whether all values of all recordings are nearly equal."""
    ends = np.array([np.quantile(some, (ENDS_LEFT_OUT, 1.0 - ENDS_LEFT_OUT)) for some in values])
    return bool(ends[:, 1].max() <= ALIKE * ends[:, 0].min())
