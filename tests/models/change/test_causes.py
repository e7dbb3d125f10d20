"""What a single change to the model in use explains, on a stage whose guide begins to stick."""

from itertools import combinations

import numpy as np
import pytest
from tests.models.change.test_naming import F
from tests.rigs.outside import dry
from tests.rigs.stage_model import kept_model

from dehyst.models.cascade.simulate import simulate
from dehyst.models.change.causes import WeighedCause, find_causes, weigh_causes
from dehyst.models.change.naming import ChangeResiduals, explains_all, find_one_change
from dehyst.models.recording import Recording

PERIOD_S, NOISE_UM, STICKS_UM = 0.005, 0.02, 0.3


def recording(seed: int, sticks_um: float) -> Recording:
    """Return 12 s of sines of two sizes and three rates, read from a stage that follows its guide
    only after the gap of dry friction is taken up."""
    model = kept_model()
    t = np.arange(2400) * PERIOD_S
    low, high = model.validity.drive_min, model.validity.drive_max
    waves = 0.25 * np.sin(2 * np.pi * t) + 0.2 * np.sin(2 * np.pi * 0.3 * t)
    waves += 0.05 * np.sin(2 * np.pi * 6.0 * t)
    u = 0.5 * (low + high) + (high - low) * waves * (0.6 + 0.4 * np.sin(2 * np.pi * 0.11 * t))
    y = dry(simulate(model, t, u), sticks_um)
    y += NOISE_UM * np.random.default_rng(seed).standard_normal(t.size)
    return Recording(
        t_s=t, drive=u, displacement=y, drive_unit="v", displacement_unit="um", name=f"{seed}"
    )


@pytest.fixture(scope="module")
def causes() -> list[WeighedCause]:
    good, flagged, later = (recording(k, s) for k, s in enumerate((0.0, STICKS_UM, STICKS_UM)))
    return weigh_causes(kept_model(), find_causes(kept_model(), flagged), later, good)


def test_two_causes_look_alike_whichever_of_them_says_so(causes: list[WeighedCause]) -> None:
    alike = {one.cause.name: set(one.cause.confused_with) for one in causes}
    assert len(alike) > 2
    for one, other in combinations(alike, 2):
        assert (other in alike[one]) == (one in alike[other]), (one, other)


@pytest.mark.parametrize("reported", ["rate", "lag"])
def test_friction_that_a_diagnosis_takes_for_what_follows_the_rate_is_named(
    reported: str, causes: list[WeighedCause]
) -> None:
    """The refitted loop has absorbed most of the friction, and its speed-dependent rest is taken
    for loops that change with the rate, or a lag. The model in use has left more than the noise
    before, less than friction alone leaves now."""
    best = causes[0]
    assert best.cause.name == "friction"
    in_use = float(np.sqrt(best.new + best.left**2))
    left = ChangeResiduals(in_use, 0.7 * best.left, 0.5 * best.left, 0.2 * best.left)
    assert not explains_all(best, left)
    found = [F(reported), F("shape"), F("creep")]
    assert find_one_change(found, causes, left) is best  # type: ignore[arg-type]
    assert find_one_change([F("creep"), *found[1:]], causes, left) is None  # type: ignore[arg-type]
