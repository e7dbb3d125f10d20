"""Wave tables and wave generators. Pure. Positions are in the stage's unit, one point per step.

The shapes are those of `WAV` in PI's manuals: PNT (points as given), SIN_P (inverted cosine), LIN
(one scan line) and RAMP (up and down); the last two have constant acceleration over the given
number of points at each end of a flank.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from dehyst.daemon.gcs.grammar import GcsCode, GcsError, integer, parse_number
from dehyst.models.arrays import Floats

MOST_POINTS = 1 << 18
"""Most points of one table: 4.4 minutes at 1 kHz, 2 MiB."""
TABLES = 8  # of MOST_POINTS each: at most 16 MiB
MOST_CYCLES = 1 << 30  # 0 stands for endless
MOST_RATE = 10_000  # samples of the loop per point: 10 s at 1 kHz


def segment(kind: str, args: Sequence[str]) -> Floats:
    """Return the points of one `WAV` segment from its arguments after the kind. Raises GcsError."""
    if kind == "PNT":
        return _points(args)
    takes = {"SIN_P": 6, "LIN": 6, "RAMP": 7}
    if kind not in takes:
        raise GcsError(GcsCode.PARAM_SYNTAX, f"wave {kind}: PNT, SIN_P, LIN and RAMP are known")
    if len(args) != takes[kind]:
        raise GcsError(GcsCode.PARAM_COUNT, f"WAV {kind} takes {takes[kind]} numbers")
    length = integer(args[0], 1, MOST_POINTS, "segment length")
    amplitude, offset = parse_number(args[1]), parse_number(args[2])
    curve = integer(args[3], 1, length, "curve length")
    start = integer(args[4], 0, length - 1, "start point")
    if kind == "SIN_P":
        center = integer(args[5], 0, curve, "centre point")
        share = _up_down(_half_cosine(center), _half_cosine(curve - center))
        end = 0.0
    else:
        speed_up = integer(args[5], 0, curve // 2, "speed up/down")
        if kind == "LIN":
            share, end = _flank(curve, speed_up), 1.0
        else:
            center = integer(args[6], 0, curve, "centre point")
            if 2 * speed_up > min(center, curve - center) > 0:
                raise GcsError(
                    GcsCode.PARAM_OUT_OF_RANGE, "speed up/down is longer than a half flank"
                )
            share = _up_down(_flank(center, speed_up), _flank(curve - center, speed_up))
            end = 0.0
    whole = np.full(length, end)
    whole[:start] = 0.0
    room = whole[start : start + curve]
    room[:] = share[: room.size]
    return np.asarray(offset + amplitude * whole)


def _points(args: Sequence[str]) -> Floats:
    if len(args) < 3:
        raise GcsError(GcsCode.PARAM_COUNT, "WAV PNT takes a first point, a length and the points")
    integer(args[0], 1, MOST_POINTS, "first point")
    length = integer(args[1], 1, MOST_POINTS, "number of points")
    values = np.array([parse_number(text) for text in args[2:]])
    if values.size != length:
        raise GcsError(GcsCode.PARAM_COUNT, f"{values.size} points where {length} were announced")
    return values


def _up_down(up: Floats, down: Floats) -> Floats:
    """Join a rising flank and an inverted one, so that the wave begins and ends at 0."""
    return np.concatenate([up, 1.0 - down])


def _half_cosine(n: int) -> Floats:
    return np.asarray(0.5 - 0.5 * np.cos(np.pi * np.arange(n) / max(n, 1)))


def _flank(n: int, speed_up: int) -> Floats:
    """Return (n,) positions from 0 towards 1: constant acceleration over `speed_up` steps, constant
    speed, constant deceleration over as many steps."""
    s, t = float(speed_up), np.arange(n, dtype=float)
    speed = 1.0 / max(n - s, 1.0)
    rising = speed * t * t / (2.0 * s) if s else np.zeros(n)
    falling = 1.0 - speed * (n - t) ** 2 / (2.0 * s) if s else np.ones(n)
    steady = speed * (t - s / 2.0)
    return np.where(t < s, rising, np.where(t > n - s, falling, steady))


@dataclass
class Waves:
    """All tables, and how the generators (one per axis) play them. Numbering starts at 1."""

    axes: tuple[str, ...]
    tables: dict[int, Floats] = field(default_factory=dict)
    chosen: dict[str, int] = field(default_factory=dict)
    cycles: dict[str, int] = field(default_factory=dict)
    offset: dict[str, float] = field(default_factory=dict)
    rate: int = 1

    def write(self, table: int, how: str, points: Floats) -> None:
        """Write points to a table. how: `X` replaces its points, `&` appends, `+` adds the values.
        Raises GcsError."""
        old = self.tables.get(table, np.zeros(0))
        if how == "&":
            points = np.concatenate([old, points])
        elif how == "+":
            longer = np.zeros(max(old.size, points.size))
            longer[: old.size] += old
            longer[: points.size] += points
            points = longer
        elif how != "X":
            raise GcsError(GcsCode.PARAM_SYNTAX, f"{how!r}: X, & and + are known")
        if points.size > MOST_POINTS:
            raise GcsError(GcsCode.WAVE_TOO_LARGE, f"{points.size} points, at most {MOST_POINTS}")
        self.tables[table] = points

    def play_of(self, axes: Sequence[str], step_s: float) -> tuple[Floats, dict[str, Floats], int]:
        """Return (times [s], targets per axis, repetitions, 0: endless) for the generators of these
        axes, started together. Raises GcsError."""
        waves, counts = {}, set()
        for axis in axes:
            points = self.tables.get(self.chosen.get(axis, 0))
            if points is None:
                raise GcsError(
                    GcsCode.NO_WAVE_SELECTED, f"no wave table is selected for axis {axis}"
                )
            waves[axis] = self.offset.get(axis, 0.0) + points
            counts.add(self.cycles.get(axis, 0))
        if len(counts) > 1:
            raise GcsError(
                GcsCode.DIFFERENT_LENGTH, "axes that start together take one cycle count"
            )
        length = math.lcm(*(wave.size for wave in waves.values()))
        if (
            length > MOST_POINTS
            or length < 2
            or (len({w.size for w in waves.values()}) > 1 and 0 not in counts)
        ):
            raise GcsError(
                GcsCode.DIFFERENT_LENGTH, "axes that start together take waves of one length"
            )
        t_s = np.asarray(np.arange(length) * (self.rate * step_s), np.float64)
        targets = {axis: np.tile(wave, length // wave.size) for axis, wave in waves.items()}
        return t_s, targets, counts.pop()
