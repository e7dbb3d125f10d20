"""What can be concluded from the drive's path: how often it reverses, whether it rests, and whether
it only repeats a single loop.

Where the drive passes each level once up and once down, any slow function of time looks like a
difference between the two branches, and so does a channel that itself goes up and down once. No fit
distinguishes them from a hysteresis, however small the residual.
"""

import numpy as np

from dehyst.models.diagnosis.tuning import TUNING
from dehyst.models.physics.candidate import Candidate
from dehyst.models.signals.drive_segments import (
    find_drive_segments,
    find_one_period,
    find_turns,
    repeats_one_loop,
)
from dehyst.models.signals.joined import Data, Floats, Ints
from dehyst.models.signals.periodic import fundamental_hz

LOOKED_AT = 4000  # samples of a part that are used to count its turns, to save time
LONG = 0.1  # of the range: a turn counts after a longer move
PIECES = 50  # of a part, in each of which the drive moves or rests
STILL = 0.02  # of the range: largest move in a piece at rest; one triangle moves twice as far; of
# the rms move from sample to sample: largest one at rest
STILL_FOR = 0.2  # of all pieces, at rest: long enough for slow effects to show by themselves
SAME_HZ = 0.01  # largest relative difference of the frequencies of one loop
SURELY = 4.0  # standard deviations, as one of many steps may be that large by chance, plus
AGAINST = 0.01  # of the displacement's range: least move against the drive
SAME_PLACE = 1e-3  # of the drive's range: nearer samples count as one place
TURNS_OF_A_LOOP = 2.5  # largest number in a period: a loop turns twice


def is_one_period(data: Data) -> bool:
    """Return whether there is one recording, whose drive repeats with one period, whatever the
    sizes of its loops, or is no longer than a loop."""
    if len(data.names) > 1:
        return False
    ways = [find_drive_segments(data.t, data.u, data.span)]
    return repeats_one_loop(ways) or find_one_period(ways) is not None


def count_turns(data: Data, signal: Floats | None = None) -> int:
    """Return how often the drive, or a signal (N,), reverses after a move of a tenth of its range,
    in all recordings."""
    x = data.u if signal is None else signal
    parts = [x[data.part == p] for p in np.unique(data.part)]
    looked_at = [one[:: max(1, one.size // LOOKED_AT)] for one in parts]
    return sum(len(find_turns(one, LONG * float(np.ptp(x)))) for one in looked_at)


def has_few_turns(data: Data) -> bool:
    """Return whether the drive reverses too seldom to distinguish an effect that it causes from the
    hysteresis loop."""
    return count_turns(data) < TUNING.few


def is_single_loop(data: Data) -> bool:
    """Return whether the drive only repeats one loop, at one frequency: then effects of time and of
    the path look alike, and a held-out row repeats one that was fitted."""
    periods, each = 0.0, []
    for p in np.unique(data.part):
        here = data.part == p
        dt = float(data.dt[here][0])
        each.append(fundamental_hz(data.u[here], dt))
        periods += each[-1] * dt * int(here.sum())
    if min(each) <= 0.0 or max(each) > (1.0 + SAME_HZ) * min(each):
        return False
    return count_turns(data) < TURNS_OF_A_LOOP * periods


def count_distinct_places(data: Data) -> int:
    """Return the number of distinct places of its path at which the drive is sampled: few, where it
    repeats itself within few samples."""
    step = SAME_PLACE * data.span
    near = np.column_stack([np.roll(data.u, 1), data.u, np.roll(data.u, -1)])[data.rows]
    return int(np.unique(np.round(near / step), axis=0).shape[0])


def count_distinct_moments(data: Data) -> int:
    """Return the number of distinct moments of the drive's path: each place with the number of
    samples for which the drive has rested there. A memory of the path has one value in a rest, at
    however many moments it is read."""
    step = SAME_PLACE * data.span
    near = np.column_stack([np.roll(data.u, 1), data.u, np.roll(data.u, -1)]) / step
    moments = np.column_stack([near, count_rested_samples(data)])[data.rows]
    return int(np.unique(np.round(moments), axis=0).shape[0])


def count_rested_samples(data: Data) -> Ints:
    """Return (N,) for how many samples the drive has rested. It rests where it moves by only a
    small fraction of its rms move from sample to sample, however densely it is sampled."""
    step = np.where(data.starts, 0.0, np.diff(data.u, prepend=data.u[0]))
    moved = np.abs(step) > STILL * np.sqrt(np.mean(step**2))
    at = np.arange(data.n)
    return at - np.maximum.accumulate(np.where(moved | data.starts, at, 0))


def is_moving_against_drive(data: Data, noise: float) -> bool:
    """Return whether the displacement moves against the drive where the drive's path rises, or
    falls, from one sample to the next: no hysteresis of any class does that, but delays and lags
    do. noise: rms of a reading. Steps that repeat each other are averaged."""
    path, places = data.path, data.places if data.between is not None else np.arange(data.n)
    rises = np.concatenate([[0], np.cumsum(np.diff(path.u) > 0)])
    falls = np.concatenate([[0], np.cumsum(np.diff(path.u) < 0)])
    up, down = np.diff(rises[places]), np.diff(falls[places])
    inside = data.rows[1:] & data.rows[:-1] & ~data.starts[1:]
    step, sign = np.diff(data.y), np.where(down == 0, 1.0, -1.0)
    one_way = inside & ((up == 0) != (down == 0))
    at = np.round(np.column_stack([data.u[:-1], data.u[1:]])[one_way] / (SAME_PLACE * data.span))
    _, group, count = np.unique(
        np.column_stack([data.rec[1:][one_way], at]),
        axis=0,
        return_inverse=True,
        return_counts=True,
    )
    mean = np.bincount(group.ravel(), (sign * step)[one_way]) / count
    sure = SURELY * noise * np.sqrt(2.0 / count) + AGAINST * float(np.ptp(data.y))
    return bool(np.any(mean < -sure))


def has_long_rest(data: Data) -> bool:
    """Return whether the drive rests long enough that a change in time shows by itself."""
    still = []
    for p in np.unique(data.part):
        pieces = np.array_split(data.u[data.part == p], PIECES)
        still += [float(np.ptp(one)) < STILL * data.span for one in pieces if one.size]
    return float(np.mean(still)) > STILL_FOR


def has_rests(data: Data) -> bool:
    """Return whether the drive rests repeatedly, for some samples each time: what the reading does
    meanwhile is no memory of the drive's path."""
    return float(np.mean(count_rested_samples(data) >= TUNING.settling)) > STILL_FOR


def can_be_distinguished(candidate: Candidate, data: Data) -> bool:
    """Return whether a candidate can be distinguished from the loop of a drive that hardly
    reverses."""
    if candidate.driven:
        return not candidate.static and has_rests(data)
    if candidate.channel and count_turns(data, data.channels[candidate.channel]) >= TUNING.few:
        return True
    return has_long_rest(data) if candidate.slow or candidate.channel else True
