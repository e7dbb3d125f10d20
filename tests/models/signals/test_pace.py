"""The pace of a drive, compared with its definition row by row."""

import numpy as np
import pytest

from dehyst.models.recording import Floats
from dehyst.models.signals.pace import WAY, measure_pace, measure_slowest_s


def by_definition(t: Floats, u: Floats, u_range: float) -> Floats:
    begins = np.zeros(u.size, int)
    for i in range(u.size):
        away = np.flatnonzero(np.abs(u[: i + 1] - u[i]) > WAY * u_range)
        begins[i] = away[-1] + 1 if away.size else 0
    return np.asarray(t - t[np.maximum.accumulate(begins)])


@pytest.mark.parametrize("seed", range(4))
def test_it_is_the_time_since_the_drive_was_a_part_of_its_range_away(seed: int) -> None:
    rng = np.random.default_rng(seed)
    u = np.cumsum(rng.standard_normal(600)) * rng.uniform(0.3, 3.0)
    u[200:300] = u[200]
    t = np.cumsum(rng.uniform(0.5e-3, 1.5e-3, 600))
    np.testing.assert_allclose(measure_pace(t, u, 20.0), by_definition(t, u, 20.0))


def test_of_a_long_recording_it_is_as_slow_as_of_a_short_one() -> None:
    t = np.arange(200_000) / 1e4
    u = np.where(t < 10.0, 50.0 * np.sin(2 * np.pi * t), 0.0)
    found = measure_pace(t, u, 100.0)
    assert found.size == t.size
    assert found[-1] == pytest.approx(10.0, abs=0.1)
    assert np.median(found[20_000:90_000]) == pytest.approx(0.05 / np.pi * 2**0.5, rel=0.1)


def test_after_a_pause_it_is_that_of_a_recording_that_begins_there() -> None:
    u = 50.0 + 40.0 * np.sin(np.linspace(0.0, 4.0 * np.pi, 500))
    t = np.arange(500) / 100.0
    paused = np.r_[t, t + 3600.0]
    each = measure_pace(t, u, 80.0)
    np.testing.assert_allclose(measure_pace(paused, np.r_[u, u], 80.0), np.r_[each, each])
    assert measure_slowest_s(paused, np.r_[u, u], 80.0) < 2.0
