"""The drive rate at which each operator joins in, and the range of z, for random drives."""

import numpy as np
import pytest

from dehyst.models.hysteresis.monotone import find_wrong_way
from dehyst.models.hysteresis.z_range import bound_z, find_rates, is_invertible
from dehyst.models.model import Hysteresis
from dehyst.models.recording import Floats

T, RATE, ACCELERATION = 1e-3, 200.0, 1.1e4
R = np.array([0.0, 4e-4, 3e-3, 0.02, 0.1, 0.3, 0.6, 0.9, 2.0])


def drive_by_chance(seed: int, n: int = 20_000) -> Floats:
    """Return a random drive (N,) from 0 to 8 V; its rate, the difference of samples, stays below
    RATE and changes by at most ACCELERATION, which it often does."""
    rng = np.random.default_rng(seed)
    most = ACCELERATION * T
    u, rate = np.zeros(n), 0.0
    wish, left = 0.0, 0
    for t in range(1, n):
        if left == 0:
            wish, left = (
                rng.uniform(-RATE, RATE) * rng.choice([0.02, 0.2, 1.0]),
                rng.integers(1, 60),
            )
        left -= 1
        stop = rate * rate / (2 * ACCELERATION) + 1.5 * abs(rate) * T
        if u[t - 1] + stop > 8.0 and rate >= 0.0:
            wish, left = -RATE, 30
        elif u[t - 1] - stop < 0.0 and rate <= 0.0:
            wish, left = RATE, 30
        rate += min(max(wish - rate, -most), most)
        u[t] = u[t - 1] + rate * T
    return u


def run_plays(u: Floats) -> Floats:
    """Return D_j (N, n): the state of each operator minus the next operator's."""
    h, out = np.zeros(R.size), np.empty((u.size, R.size))
    for t, v in enumerate(u):
        h = np.maximum(v - R, np.minimum(v + R, h))
        out[t] = -np.diff(h, append=0.0)
    return out


@pytest.mark.parametrize("seed", range(4))
def test_no_operator_joins_in_at_a_higher_rate(seed: int) -> None:
    u = drive_by_chance(seed)
    rate = np.abs(np.diff(u)) / T
    assert np.max(np.abs(np.diff(u, 2))) / T**2 <= ACCELERATION * (1 + 1e-6)
    moved = np.abs(np.diff(run_plays(u), axis=0)) > 1e-9
    rates = find_rates(R, RATE, ACCELERATION, T)
    met = np.array([rate[moved[:, j]].max() for j in range(R.size)])
    assert np.all(met <= rates * (1 + 1e-9))
    assert np.all(met[1:5] > 0.5 * rates[1:5])  # and the bounds are not loose


def test_without_a_bound_on_the_acceleration_every_rate_is_the_largest() -> None:
    assert np.all(find_rates(R, RATE) == RATE)
    assert np.all(find_rates(R, RATE, 2 * RATE / T, T) == RATE)  # a corner at full speed
    assert np.all(np.diff(find_rates(R, RATE, ACCELERATION, T)) >= 0.0)


@pytest.mark.parametrize("seed", range(4))
def test_z_stays_within_its_bounds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rates = find_rates(R, RATE, ACCELERATION, T)
    p = np.sort(rng.uniform(0.2, 1.2, R.size))
    q = rng.choice([-0.98, 0.98]) * p / rates
    h = Hysteresis(r=R, b=np.diff(p, prepend=0.0), k=np.diff(q, prepend=0.0), c=[0.0, 1.0])
    assert is_invertible(h, 0.0, 8.0, rates)
    assert find_wrong_way(h, 0.0, 8.0, rates) is None
    assert not is_invertible(h, 0.0, 8.0, RATE)
    assert find_wrong_way(h, 0.0, 8.0, RATE) is not None
    u = drive_by_chance(seed + 50)
    rate = np.diff(u, prepend=0.0) / T
    d = run_plays(u)
    z = d @ p + rate * (d @ q)
    low, high = bound_z(h, 0.0, 8.0, rates)
    assert low <= z.min()
    assert z.max() <= high
