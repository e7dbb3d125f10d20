"""A mode and its alias at the sampling rate give nearly the same samples; the lower is named."""

import numpy as np
import pytest
from scipy import signal

from dehyst.models.diagnosis.base import rich_base
from dehyst.models.diagnosis.data.prepare import prepare
from dehyst.models.diagnosis.fit import Problem
from dehyst.models.diagnosis.judge import SearchState, effect_of
from dehyst.models.diagnosis.search import refit_each
from dehyst.models.diagnosis.shortlist import ScreenedCandidate
from dehyst.models.physics import list_candidates
from dehyst.models.recording import Recording

RATE_HZ, FINE, NOISE_UM = 500.0, 40, 2e-3


def ringing(frequency_hz: float, damping: float, seed: int) -> Recording:
    """Return random steps through a mode, run on a grid forty times finer than the recorder's."""
    rng = np.random.default_rng(seed)
    t = np.arange(5000) / RATE_HZ
    u = np.repeat(rng.uniform(1.0, 9.0, 25), 200)
    u = np.convolve(np.r_[np.full(9, u[0]), u], np.ones(10) / 10.0, "valid")  # a ramp of 20 ms
    fine_t = np.arange(t.size * FINE) / (RATE_HZ * FINE)
    fine_u = np.interp(fine_t, t, u)
    w = 2.0 * np.pi * frequency_hz
    _, y, _ = signal.lsim(([w**2], [1.0, 2.0 * damping * w, w**2]), fine_u - u[0], fine_t)
    return Recording(t, u, u[0] + y[::FINE] + NOISE_UM * rng.standard_normal(t.size))


@pytest.mark.parametrize(("frequency_hz", "damping"), [(22.5, 0.0128), (60.0, 0.02)])
def test_a_mode_is_not_named_at_its_mirror_above_half_the_sampling_rate(
    frequency_hz: float, damping: float
) -> None:
    data = prepare([ringing(frequency_hz, damping, 1)])
    problem = Problem(data, rich_base(data))
    null = problem.solve([])
    (mode,) = (c for c in list_candidates(data) if c.key == "resonance")
    mirror = RATE_HZ - frequency_hz
    short = [ScreenedCandidate(mode, (mirror, damping * frequency_hz / mirror, 1.0), 1.0)]
    state = SearchState(problem, NOISE_UM, null, null)
    (trial,) = refit_each(state, short, lambda text, share: None, 0)
    found, ratio, _ = effect_of(trial.fit, "resonance").theta
    assert found == pytest.approx(frequency_hz, rel=0.01)
    assert ratio == pytest.approx(damping, rel=0.15)
