"""The path of a move at a set velocity."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from dehyst.daemon.epics.profile import move_profile


@given(
    start=st.floats(-20, 20),
    end=st.floats(-20, 20),
    velocity=st.floats(0.01, 200),
    ramp_s=st.floats(0, 1),
    period_s=st.floats(0.001, 0.05),
)
def test_it_arrives_never_faster_than_asked_and_never_turns(
    start: float, end: float, velocity: float, ramp_s: float, period_s: float
) -> None:
    if abs(end - start) < 1e-6 or abs(end - start) / velocity > 60:
        return
    ramp_s = ramp_s if ramp_s >= period_s else 0.0
    t, path = move_profile(start, end, velocity, ramp_s, period_s)
    steps = np.diff(path) * np.sign(end - start)
    assert path[0] == start
    assert path[-1] == end
    assert np.all(steps >= -1e-9)
    assert steps.max() <= velocity * period_s * (1 + 1e-6) + 1e-9
    assert np.allclose(np.diff(t), period_s)
    # closed form: distance over velocity plus one ramp, or a triangle
    distance = abs(end - start)
    whole = distance / velocity + ramp_s
    triangle = 2 * np.sqrt(distance * ramp_s / velocity)
    expected = whole if distance >= velocity * ramp_s else triangle
    assert expected <= t[-1] + 1e-9 <= expected + 2 * period_s
