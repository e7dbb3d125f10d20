"""A gauge whose filter shows a ringing stage late, compared with the responses of scipy's linear
systems at the exact times of the steps and readings."""

from collections.abc import Iterator

import numpy as np
from scipy import signal

from dehyst.models.learning.late_gauge import LateGauge

PERIOD_S, N, PASSES, NOISE = 5e-3, 200, 14, 0.02
TAU = 150e-6
W, DAMPING, SHARE = 2 * np.pi * 780.0, 0.02, 0.3
GRID = np.linspace(0.0, 0.12, 12_001)
MODE_NUM = [SHARE * W * W]
DEN = [1.0, 2 * DAMPING * W, W * W]
RINGS = np.polyadd((1.0 - SHARE) * np.array(DEN), MODE_NUM)
_, STAGE = signal.step((RINGS, DEN), T=GRID)
_, GAUGE = signal.step((RINGS, np.polymul(DEN, [TAU, 1.0])), T=GRID)


Told = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def passes(jitter_s: float, noise: float, count: int = PASSES, seed: int = 1) -> Iterator[Told]:
    """Yield per pass: reading and displacement [um] less the steady sine, steps, times since."""
    rng = np.random.default_rng(seed)
    total = (count + 1) * N
    k = np.arange(total)
    volts = 3.0 * np.sin(2 * np.pi * 5 * k * PERIOD_S)
    set_s = k * PERIOD_S + 1.95e-3 + jitter_s * rng.random(total)
    read_s = k * PERIOD_S + 0.45e-3 + 0.3 * jitter_s * rng.random(total)
    back = np.arange(1, 23)
    for first in range(N, total, N):
        at = np.maximum(np.arange(first, first + N)[:, None] - back, 1)
        steps, since = volts[at] - volts[at - 1], read_s[first : first + N, None] - set_s[at]
        true = (steps * (np.interp(since, GRID, STAGE) - 1.0)).sum(axis=1)
        read = (steps * (np.interp(since, GRID, GAUGE) - 1.0)).sum(axis=1)
        yield read + noise * rng.standard_normal(N), true, steps, since


def test_what_a_late_gauge_hides_is_distinguished_from_readings_that_are_not_quite_on_time() -> (
    None
):
    hidden = np.mean([true - read for read, true, _, _ in passes(0.3e-3, 0.0, 60, 2)], axis=0)
    late, begun = LateGauge(TAU), 0
    for read, _, steps, since in passes(0.3e-3, NOISE):
        since = since[:, : late.back].copy()
        since[::20] += 3e-3  # as reported by a loop that was held up
        reported = late.take(read, steps[:, : late.back], since)
        begun += late.error_redefined
    assert hidden.std() > NOISE
    assert (hidden - reported).std() < 0.35 * hidden.std()
    assert begun == 1


def test_nothing_is_reported_where_the_times_do_not_differ() -> None:
    late = LateGauge(TAU)
    for read, _, steps, since in passes(0.0, NOISE):
        assert not late.take(read, steps[:, : late.back], since[:, : late.back]).any()
        assert not late.error_redefined


def test_nothing_is_reported_of_noise() -> None:
    late = LateGauge(TAU)
    rng = np.random.default_rng(4)
    for _, _, steps, since in passes(0.3e-3, 0.0):
        reported = late.take(
            rng.normal(0.0, NOISE, N), steps[:, : late.back], since[:, : late.back]
        )
        assert reported.std() < 0.2 * NOISE


def test_a_pass_with_a_gap_tells_nothing_and_the_next_ones_go_on() -> None:
    late, number = LateGauge(TAU), 8
    reported = []
    for i, (read, _, steps, since) in enumerate(passes(0.3e-3, NOISE)):
        if i == number:
            read[17] = np.nan
        reported.append(late.take(read, steps[:, : late.back], since[:, : late.back]))
    assert not np.any(reported[number])
    assert np.std(reported[-1]) > 0.5 * NOISE
