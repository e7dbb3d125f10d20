"""The augmented model holds the shape that was found, and goes nowhere astray."""

import numpy as np
import pytest
from tests.rigs.plants.drives import small_scan
from tests.rigs.plants.hysteresis import preisach

from dehyst.models.cascade.simulate import simulate
from dehyst.models.diagnosis import Diagnosis, diagnose
from dehyst.models.recording import Recording

DT, NOISE, LEVEL, SWING = 2e-3, 0.01, 6.0, 2.5


def scan(seed: int) -> Recording:
    """A scan of a Preisach stage about a level to which it came from 0: nobody has seen the way."""
    t = DT * np.arange(4000)
    u = small_scan(LEVEL, SWING)(np.random.default_rng(seed), t, DT)
    way = np.linspace(0.0, LEVEL, 200)
    y = preisach(np.random.default_rng(5))(np.append(way, u))[way.size :]
    noise = NOISE * np.random.default_rng(seed + 10).standard_normal(u.size)
    return Recording(t, u, y + noise, name=f"scan {seed}")


@pytest.fixture(scope="module")
def found() -> Diagnosis:
    return diagnose([scan(1), scan(2)])


def test_the_shape_is_in_the_augmented_model(found: Diagnosis) -> None:
    shape = next(f for f in found.findings if f.name == "shape")
    assert "The augmented model contains it" in shape.says
    for view in found.views:
        k = view.held_out
        assert np.std((view.displacement - view.augmented)[k]) < 1.3 * NOISE
        assert np.std((view.displacement - view.base)[k]) > 2.0 * NOISE


def test_on_the_way_up_that_nobody_has_seen_it_stays_near_the_model_in_use(
    found: Diagnosis,
) -> None:
    low, high = LEVEL - SWING, LEVEL + SWING
    u = np.concatenate([np.linspace(a, b, 300) for a, b in ((low, high), (high, low))])
    augmented, in_use = (simulate(m, 0.05, u) for m in (found.model, found.base_model))
    stroke = float(np.ptp(found.views[0].displacement))
    assert np.abs(augmented - in_use).max() < 0.3 * stroke
