"""A loop of several axes is refused if it is faster than the amplifier sustains, with the
reason."""

from collections.abc import Sequence

import msgspec
import pytest
from tests.rigs.two_loops import CONFIG

from dehyst.daemon.config import Config, LoopConfig, parse_config
from dehyst.daemon.loop.checks import about_late_replies, check_rates_together, crowded
from dehyst.drivers.interface import DeviceSpec
from dehyst.models.errors import BadInput


class Unit:
    """Sustains 300 Hz for one output, 150 Hz for two and 280 Hz for all three in one command; late
    replies take a fifth longer."""

    together = True

    def rate_hz(self, driven: int) -> float:
        return (300.0, 150.0, 280.0)[driven - 1]

    def late_s(self, driven: int) -> float:
        return 1.2 / self.rate_hz(driven)

    def write_all(self, volts: Sequence[float]) -> None:
        raise AssertionError("nothing is to be written")


def axes(rate_hz: float) -> list[Config]:
    one = parse_config(CONFIG)
    return [
        msgspec.structs.replace(one, axis=axis, loop=LoopConfig(rate_hz=rate_hz)) for axis in "xyz"
    ]


def spec(rate_hz: float, latency_s: float, late_s: float = 0.0) -> DeviceSpec:
    return DeviceSpec("v", 0.0, 150.0, 1e-3, rate_hz, latency_s, late_s=late_s)


def specs(gauge_hz: float, gauge_s: float) -> list[tuple[DeviceSpec, DeviceSpec]]:
    return [(spec(300.0, 1 / 300), spec(gauge_hz, gauge_s))] * 3


def test_the_slowest_number_of_driven_axes_counts() -> None:
    joints = [(Unit(), (0, 1, 2))]
    # 8 ms for two late sets, plus three gauges of 0.1 ms: 8.3 ms are half of 16.6 ms
    with pytest.raises(BadInput, match=r"axes x, y, z sustains 150 Hz with 2 .* to 60 or less"):
        check_rates_together(axes(200.0), specs(2000.0, 1e-4), joints)
    assert check_rates_together(axes(100.0), specs(2000.0, 1e-4), joints) == [1, 1, 1]


def test_the_gauges_of_all_axes_have_to_be_read_in_the_period() -> None:
    joints = [(Unit(), (0, 1, 2))]
    # 1 / 150 s plus three gauges of 1 ms: 9.67 ms; four fifths of a period are 8 ms
    with pytest.raises(BadInput, match=r"3 axes take 9.67 ms of the 10.00 ms period"):
        check_rates_together(axes(100.0), specs(2000.0, 1e-3), joints)
    assert check_rates_together(axes(80.0), specs(50.0, 1e-3), joints) == [2, 2, 2]


def test_amplifiers_of_their_own_are_added_up() -> None:
    # three sets of 3.3 ms plus three gauges of 0.1 ms: 10.3 ms
    with pytest.raises(BadInput, match=r"take 10.30 ms of the 10.00 ms period"):
        check_rates_together(axes(100.0), specs(2000.0, 1e-4), [])
    assert check_rates_together(axes(77.0), specs(2000.0, 1e-4), []) == [1, 1, 1]


def test_what_one_axis_cannot_is_reported_of_that_axis() -> None:
    mixed = specs(2000.0, 1e-5)
    mixed[1] = (spec(50.0, 1e-4), mixed[1][1])
    with pytest.raises(BadInput, match=r"axis y: loop.rate_hz = 60: actuator simulated sustains"):
        check_rates_together(axes(60.0), mixed, [])


@pytest.mark.parametrize("count", [1, 3])
def test_the_rate_that_is_offered_leaves_room_for_late_replies(count: int) -> None:
    """The rate offered in a refusal leaves time for late replies. Sets take 2 ms, late ones 3 ms;
    gauges take 0.1 ms, late ones 0.2 ms. That is 3.2 ms for each axis and half a period for all:
    150 Hz, for three axes 52 Hz. Up to 380 Hz and 127 Hz are accepted."""
    offered = {1: "150", 3: "52"}[count]
    units = [(spec(1000.0, 2e-3, 3e-3), spec(2000.0, 1e-4, 2e-4))] * count
    with pytest.raises(BadInput, match=rf"device calls .* ms period; set .* to {offered} or less"):
        check_rates_together(axes(400.0 / count)[:count], units, [])
    assert check_rates_together(axes(370.0 / count)[:count], units, []) == [1] * count
    words = about_late_replies(370.0 / count, units, [])
    assert len(words) == 1
    assert f"{offered} Hz or less" in words[0]
    assert about_late_replies(float(offered), units, []) == []


def test_where_a_report_and_the_sets_do_not_fit_into_a_period_is_known() -> None:
    """The axes whose set must be skipped for a report are known from the times. With three outputs
    of one unit, two late ones take 8 ms, each gauge 0.5 ms, and a report in place of one gauge 3.33
    ms: 12.33 ms. One axis alone takes 3.33 ms twice."""
    several, one = specs(2000.0, 5e-4), specs(2000.0, 5e-4)[:1]
    joints = [(Unit(), (0, 1, 2))]
    assert crowded(12.8e-3, several, joints) == dict.fromkeys(range(3), (0, 1, 2))
    assert crowded(13.2e-3, several, joints) == {}
    assert crowded(6.9e-3, one, []) == {0: (0,)}
    assert crowded(7.1e-3, one, []) == {}
