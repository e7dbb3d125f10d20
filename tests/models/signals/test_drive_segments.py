"""Whether a drive repeats one loop at one rate."""

import numpy as np
import pytest

from dehyst.models.recording import Floats
from dehyst.models.signals.drive_segments import (
    find_drive_segments,
    find_one_period,
    repeats_one_loop,
)

T = np.arange(4000) / 500.0


def repeats(*drives: Floats) -> bool:
    return repeats_one_loop([find_drive_segments(T, u, 100.0) for u in drives])


def sine(hz: float, size: float = 50.0, start: float = 0.0) -> Floats:
    return np.asarray(size * np.sin(2 * np.pi * (hz * T + start)))


@pytest.mark.parametrize("start", np.linspace(0.0, 0.9, 7))
def test_a_sine_from_any_start_is_one_loop(start: float) -> None:
    assert repeats(sine(0.4, start=start))


def test_a_second_rate_counts_however_few_ways_it_has() -> None:
    assert not repeats(sine(0.3), sine(30.0))
    assert repeats(sine(1.0), sine(1.1, start=0.3))


def test_a_second_size_counts() -> None:
    assert not repeats(sine(1.0), sine(1.0, size=25.0))


def test_a_drive_of_one_period_may_change_its_size() -> None:
    def period(*drives: Floats) -> float | None:
        return find_one_period([find_drive_segments(T, u, 100.0) for u in drives])

    fades = np.exp(-T / 6.0)
    assert period(fades * sine(2.0)) == pytest.approx(0.5, rel=0.02)
    assert period(sine(1.0), sine(1.0, size=25.0)) == pytest.approx(1.0, rel=0.02)
    assert period(fades * sine(2.0), sine(3.0)) is None
    assert period(np.where(sine(0.5) > 0, 50.0, -50.0)) is None
    assert period(np.zeros(T.size)) is None


def test_an_edge_counts() -> None:
    assert not repeats(np.where(sine(0.5) > 0, 50.0, -50.0))
    assert repeats(np.asarray(np.clip(3.0 * sine(0.5), -50.0, 50.0)))
