"""A reading follows its drive where its changes do: what wanders by itself does not, however well
it agrees with a slow drive, and a weak or late response does."""

import numpy as np
import pytest
from tests.rigs.outside import delayed, ordinary, stage, times

from dehyst.models.recording import Floats
from dehyst.models.signals.following import follows_changes

T_S = times(16.0)
DRIVES = {
    "sine": 75.0 - 75.0 * np.cos(2 * np.pi * 0.5 * T_S),
    "of changing size": 75.0 - 75.0 * np.cos(2 * np.pi * T_S) * np.exp(-T_S / 10.0),
    "steps": np.repeat(np.random.default_rng(1).uniform(0.0, 150.0, 40), T_S.size // 40),
}


def walk(seed: int) -> Floats:
    return np.asarray(np.cumsum(np.random.default_rng(seed).standard_normal(T_S.size)))


@pytest.mark.parametrize("drive", DRIVES)
def test_what_wanders_by_itself_does_not_follow(drive: str) -> None:
    u = DRIVES[drive]
    assert not any(follows_changes(u, walk(seed)) for seed in range(50))
    assert not follows_changes(u, np.exp(-T_S / 5.0))
    assert not follows_changes(u, np.random.default_rng(2).standard_normal(T_S.size))


@pytest.mark.parametrize("late_s", [0.0, 0.1, 0.4])
@pytest.mark.parametrize("drive", DRIVES)
def test_a_response_under_much_noise_follows(drive: str, late_s: float) -> None:
    u = DRIVES[drive]
    y = delayed(stage(u), late_s) if late_s else stage(u)
    noise = 0.5 * np.ptp(y) * np.random.default_rng(3).standard_normal(y.size)
    assert follows_changes(u, y + noise)
    assert follows_changes(u, y + 0.3 * np.ptp(y) * walk(4) / np.ptp(walk(4)))


@pytest.mark.parametrize("seed", range(12))
def test_an_ordinary_recording_follows(seed: int) -> None:
    one = ordinary(seed)
    assert one.displacement is not None
    assert follows_changes(one.drive, one.displacement)


def test_too_few_rows_are_not_judged() -> None:
    assert follows_changes(np.arange(100.0), np.zeros(100))
