"""The low end of the range is reported as the high end is."""

import numpy as np
import pytest

from dehyst.models.inverse import sample
from dehyst.models.inverse.compensator import Compensator
from dehyst.models.inverse.offline import invert_streamed
from dehyst.models.inverse.static import BEYOND_DRIVE, BEYOND_SATURATION, static_inverse
from dehyst.models.model import Hysteresis, Model, Validity

DT = 1e-3
STRAIGHT = Model(Hysteresis(r=[0.0, 1.0], b=[0.8, 0.2], c=[0.0, 1.0]), Validity(2.0, 10.0))


@pytest.mark.parametrize("mode", ["static", "preview"])
def test_a_target_below_the_lowest_drive_is_flagged_and_the_drive_stays_at_it(mode: str) -> None:
    c = Compensator(STRAIGHT, DT, 2.0, 10.0, 1e4, mode, 0.05)  # type: ignore[arg-type]
    result = invert_streamed(c, np.full(400, -5.0))
    assert result.drive.min() >= 2.0
    assert result.drive[-1] == pytest.approx(2.0, abs=1e-3)
    assert result.flags[-1] & sample.BEYOND_DRIVE


@pytest.mark.parametrize("mode", ["static", "preview"])
def test_a_target_above_the_highest_drive_is_flagged_and_the_drive_stays_at_it(mode: str) -> None:
    c = Compensator(STRAIGHT, DT, 2.0, 10.0, 1e4, mode, 0.05)  # type: ignore[arg-type]
    result = invert_streamed(c, np.full(400, 25.0))
    assert result.drive.max() <= 10.0
    assert result.drive[-1] == pytest.approx(10.0, abs=1e-3)
    assert result.flags[-1] & sample.BEYOND_DRIVE


@pytest.mark.parametrize("beyond", [-1.0, 1.0])
def test_a_target_beyond_either_end_of_the_saturation_is_flagged(beyond: float) -> None:
    """y = z - z^3 / 300 has its extrema at z = -10 and 10, where it is -6.67 and 6.67."""
    bent = Model(
        Hysteresis(r=[0.0], b=[1.0], c=[0.0, 1.0, 0.0, -1.0 / 300.0]), Validity(-12.0, 12.0)
    )
    inverse = static_inverse(bent)
    drives, flags = inverse.run(beyond * np.array([6.6, 6.8]))
    assert flags[0] == 0
    assert flags[1] & BEYOND_SATURATION
    assert drives[1] == pytest.approx(beyond * 10.0, abs=1e-3)
    c = Compensator(bent, DT, -12.0, 12.0, 1e4, "static", 0.05)
    assert invert_streamed(c, np.full(50, beyond * 6.8)).flags[-1] & sample.BEYOND_SATURATION


@pytest.mark.parametrize(("target", "low"), [(-5.0, 2.0), (25.0, 10.0)])
def test_the_static_inverse_flags_both_ends_of_the_drive(target: float, low: float) -> None:
    drives, flags = static_inverse(STRAIGHT).run(np.array([6.0, target]), None, 2.0)
    assert flags[0] == 0
    assert flags[1] & BEYOND_DRIVE
    assert drives[1] == low


@pytest.mark.parametrize("start", [0.0, 10.0])
def test_a_drive_outside_of_what_was_identified_is_flagged_at_both_ends(start: float) -> None:
    """The amplifier spans 0 to 10 V, the recordings 2 to 8 V; it moves in by 1 V a sample."""
    model = Model(Hysteresis(r=[0.0], b=[1.0], c=[0.0, 1.0]), Validity(2.0, 8.0))
    c = Compensator(model, DT, 0.0, 10.0, 1e3, "static", 0.05)
    result = invert_streamed(c, np.full(20, 5.0), start=start)
    assert result.drive[0] == pytest.approx(1.0 if start == 0.0 else 9.0)
    assert result.flags[0] & sample.OUTSIDE
    assert not result.flags[-1] & sample.OUTSIDE
