"""A mode above half the sampling rate: what the samples show is its alias."""

import numpy as np
import pytest

from dehyst.models.diagnosis.data.prepare import prepare
from dehyst.models.physics.resonance import Resonance
from dehyst.models.recording import Recording

RATE_HZ = 1000.0


def is_refused(frequency_hz: float, u: np.ndarray) -> bool:
    """Return whether a hardly damped mode is implausible in a recording of this drive."""
    noise = 0.01 * np.random.default_rng(1).standard_normal(u.size)
    data = prepare([Recording(np.arange(u.size) / RATE_HZ, u, u + noise)])
    return bool(Resonance(data).implausible((frequency_hz, 1e-3, 1.0), np.zeros(0), data))


@pytest.mark.parametrize(
    ("frequency_hz", "refused"), [(985.0, True), (1010.0, True), (850.0, False), (20.0, False)]
)
def test_an_alias_among_the_frequencies_of_a_smooth_drive_is_no_mode(
    frequency_hz: float, refused: bool
) -> None:
    t = np.arange(8000) / RATE_HZ
    u = 5.0 + 3.0 * np.sin(2 * np.pi * 2.0 * t) + np.sin(2 * np.pi * 11.0 * t)
    assert is_refused(frequency_hz, u) is refused


def test_steps_excite_any_mode() -> None:
    u = np.repeat(np.random.default_rng(2).uniform(0.0, 10.0, 20), 400)
    assert not is_refused(985.0, u)
