"""How often the 95 % intervals of an identification contain the truth, counted.

The truth lies on the grid of thresholds that identification starts from, so that it can be found
exactly; runs in which another threshold was kept have other parameters and are not counted.
"""

import numpy as np
import pytest
from scipy.signal import lfilter

from dehyst.models.hysteresis.forward import simulate_hysteresis
from dehyst.models.identify import Options, identify
from dehyst.models.identify.tuning import TUNING
from dehyst.models.identify.uncertainty import move_saturation
from dehyst.models.model import Hysteresis
from dehyst.models.recording import Recording

T, N, NOISE_UM, RUNS = 1e-3, 3000, 0.01, 54
R = [5.0 * (i / TUNING.fine) ** 3 for i in (0, 15, 26, 38)]  # for a drive from 0 to 10 V
SLOPES = np.array([0.6, 0.8, 1.1, 1.5])
TRUTH = Hysteresis(r=R, b=np.diff(SLOPES, prepend=0.0), c=[0.0, 1.0])


def drive() -> np.ndarray:
    """Return a drive with twelve turns of many sizes, from 0 to 10 V."""
    t = np.arange(N) / N
    u = -np.cos(2 * np.pi * 12 * t) * (0.1 + 0.9 * np.cos(2 * np.pi * 1.5 * t) ** 2)
    return np.asarray(10.0 * (u - u.min()) / np.ptp(u))


@pytest.mark.parametrize("together", [0, 3], ids=["white", "noise that hangs together"])
def test_95_of_100_intervals_hold_the_true_value(together: int) -> None:
    """together: samples over which the noise is correlated. Between 90 and 98 of 100, no slack."""
    u = drive()
    y, t = simulate_hysteresis(TRUTH, u, T), np.arange(N) * T
    pole = np.exp(-1 / together) if together else 0.0
    hits: list[bool] = []
    for seed in range(RUNS):
        noise = np.random.default_rng(seed).standard_normal(N)
        noise = lfilter([NOISE_UM * np.sqrt(1 - pole**2)], [1, -pole], noise)
        found = identify(
            [Recording(t, u, y + noise)],
            Options(order=4, rate=False, saturation=1, bias=False),
        )
        if not np.allclose(found.model.hysteresis.r, R, atol=1e-3):
            continue
        error = np.append(found.params.slopes - SLOPES, found.params.c)
        allowed = 1.96 * np.append(found.errors.slopes, found.errors.c)
        hits += (np.abs(error) <= allowed).tolist()
    assert len(hits) >= 200
    assert 0.90 <= np.mean(hits) <= 0.98


def test_errors_of_a_saturation_that_is_written_about_another_zero() -> None:
    """Compared with random parameters, expanded about the other zero."""
    rng = np.random.default_rng(0)
    root = rng.normal(size=(3, 3))
    powers, shift = (0, 2, 3), 1.7
    draws = rng.multivariate_normal(np.zeros(3), root @ root.T, 200_000)
    full = np.zeros((draws.shape[0], 4))
    for power, c in zip(powers, draws.T, strict=True):
        full[:, : power + 1] += c[:, None] * (np.poly1d([1.0, -shift]) ** power).coeffs[::-1]
    found = move_saturation(root @ root.T, powers, shift)
    assert found == pytest.approx(full[:, list(powers)].std(axis=0), rel=0.02)
