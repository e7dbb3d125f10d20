"""The ramp without the loop, as used by `dehyst safe` and by the approach of `dehyst acquire`."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dehyst.daemon.loop.devices import DeviceLink, ramp
from dehyst.drivers.simulated.devices import SimulatedActuator

VOLTS = st.floats(0.0, 140.0)


class Slow:
    """A simulated amplifier that records what was written and how long the ramp slept."""

    def __init__(self) -> None:
        self.amplifier = SimulatedActuator.from_settings({})
        self.amplifier.open()
        self.written: list[float] = []
        self.slept: list[float] = []

    def write(self, volts: float) -> None:
        self.amplifier.write(volts)
        self.written.append(volts)

    def close(self) -> None:
        self.amplifier.close()


@settings(max_examples=60)
@given(start=VOLTS, goal=VOLTS, rate=st.floats(10.0, 1000.0), period_s=st.floats(0.002, 0.05))
def test_no_step_is_larger_than_rate_times_period_and_it_ends_at_the_goal(
    start: float, goal: float, rate: float, period_s: float
) -> None:
    device = Slow()
    link = DeviceLink("actuator", device)
    assert ramp(link, start, goal, rate, period_s, device.slept.append) == goal
    way = np.array([start, *device.written])
    assert way[-1] == goal
    assert np.all(abs(np.diff(way)) <= rate * period_s * (1 + 1e-9))
    assert np.all(np.diff(way) * np.sign(goal - start) >= -1e-12)
    assert device.slept == [period_s] * len(device.written)  # after each step
    link.close()


@pytest.mark.parametrize(("start", "goal"), [(118.0, 5.0), (5.0, 118.0)])
def test_113_v_at_200_v_per_s_take_565_ms(start: float, goal: float) -> None:
    device = Slow()
    ramp(DeviceLink("actuator", device), start, goal, 200.0, 0.005, device.slept.append)
    assert sum(device.slept) == pytest.approx(0.565, abs=0.0051)


def test_where_it_stands_already_nothing_is_written() -> None:
    device = Slow()
    ramp(DeviceLink("actuator", device), 5.0, 5.0, 200.0, 0.005, device.slept.append)
    assert not device.written
