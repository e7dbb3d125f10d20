"""What an amplifier's own log shows of its output: range, speed over any window, rest.

A log is (time_ns, volts): the output is set to volts[i] at time_ns[i] and stays there until the
next entry.
"""

from itertools import pairwise

import numpy as np

DAC_STEP_V = 2.75e-3
"""A set voltage is rounded to the amplifier's steps: each end of a move is off by half a step or
less."""


def excess(time_ns: np.ndarray, volts: np.ndarray, rate_v_per_s: float) -> tuple[float, int, int]:
    """Return how far the output moved beyond rate x length in the worst window, and its ends.

    Of all closed windows [t[i], t[j]], i <= j: the largest |v[j] - v[i-1]| - rate (t[j] - t[i]), i
    and j. The first entry only gives the initial output. O(n): the best beginning of a window that
    ends at j is the smallest v[i-1] - rate t[i] (for an upward move) among the i up to it.
    """
    if volts.size < 2:
        return 0.0, 0, 0
    way = rate_v_per_s * (time_ns - time_ns[0]) * 1e-9
    worst = (-np.inf, 0, 0)
    for side in (volts, -volts):
        end, begin = side[1:] - way[1:], side[:-1] - way[1:]
        over = end - np.minimum.accumulate(begin)
        j = int(np.argmax(over))
        if over[j] > worst[0]:
            worst = float(over[j]), int(np.argmin(begin[: j + 1])) + 1, j + 1
    return worst


def check_speed(
    time_ns: np.ndarray, volts: np.ndarray, rate_v_per_s: float, step_v: float
) -> float:
    """Check that no window, however short or long, moves more than rate x length + one step; return
    the largest movement beyond rate x length [V].

    Raises AssertionError with the worst window.
    """
    most, i, j = excess(time_ns, volts, rate_v_per_s)
    assert most <= step_v + DAC_STEP_V, (
        f"{volts[i - 1]:.3f} to {volts[j]:.3f} V by {j - i + 1} writes within "
        f"{(time_ns[j] - time_ns[i]) * 1e-6:.2f} ms: {most:.3f} V more than {rate_v_per_s:g} V/s "
        f"allow in that time, where one step is {step_v:g} V"
    )
    return most


def check_steps(
    time_ns: np.ndarray, volts: np.ndarray, step_v: float, rate_v_per_s: float, late_s: float
) -> None:
    """Check that no step is larger than step_v plus a movement at this rate since the last write,
    where the last write may have been read late_s too late and this one in time.

    For a glide and a ramp, which consist of steps of a given size.
    """
    steps, gaps = np.abs(np.diff(volts)), np.diff(time_ns) * 1e-9
    over = steps - step_v - rate_v_per_s * (gaps + late_s) - DAC_STEP_V
    if over.size:
        i = int(np.argmax(over))
        assert over[i] <= 0, (
            f"a step from {volts[i]:.3f} to {volts[i + 1]:.3f} V after {1e3 * gaps[i]:.1f} ms, "
            f"where {step_v:g} V and {rate_v_per_s:g} V/s are allowed, and {1e3 * late_s:g} ms late"
        )


def check_range(volts: np.ndarray, low: float, high: float) -> None:
    """Check that the log is not empty and lies within the range."""
    assert volts.size > 0, "the amplifier's log is empty"
    assert volts.min() >= low - 1e-9, volts.min()
    assert volts.max() <= high + DAC_STEP_V, volts.max()


def during(
    time_ns: np.ndarray, volts: np.ndarray, begin_ns: int, end_ns: int | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return the log from begin to end; its first entry is the voltage in force at its
    beginning."""
    inside = time_ns >= begin_ns
    if end_ns is not None:
        inside &= time_ns <= end_ns
    before = np.flatnonzero(time_ns < begin_ns)[-1:]
    where = np.concatenate([before, np.flatnonzero(inside)])
    times = time_ns[where]
    times[: before.size] = begin_ns
    return times, volts[where]


def check_held(
    time_ns: np.ndarray, volts: np.ndarray, begin_ns: int, end_ns: int | None = None
) -> float:
    """Check that the output did not move between two times, not even by one of the amplifier's
    steps; return where it was."""
    _, part = during(time_ns, volts, begin_ns, end_ns)
    assert part.size > 0, "the amplifier's log is empty"
    moved = float(part.max() - part.min())
    assert moved <= DAC_STEP_V / 2, f"the output moved by {moved:.3f} V"
    return float(part[-1])


def worst_by_brute_force(time_ns: np.ndarray, volts: np.ndarray, rate_v_per_s: float) -> float:
    """Compute `excess` by its definition, over all pairs."""
    before = [a for a, _ in pairwise(volts)]
    return max(
        abs(volts[j] - before[i - 1]) - rate_v_per_s * (time_ns[j] - time_ns[i]) * 1e-9
        for j in range(1, volts.size)
        for i in range(1, j + 1)
    )
