"""The deadline rule against a brute-force count of grid points, for any pattern of finishes."""

import itertools

from hypothesis import given
from hypothesis import strategies as st

from dehyst.daemon.ticks import Ticks

PERIOD = 1000


@given(st.lists(st.integers(0, 12_000), max_size=60))
def test_every_grid_point_is_served_or_counted_as_missed(delays: list[int]) -> None:
    ticks = Ticks(5000, PERIOD)
    served, in_time, now = [], 0, 5000
    for delay in delays:
        now = max(now, ticks.scheduled_ns)
        served.append(ticks.scheduled_ns)
        now += delay
        in_time += now < served[-1] + PERIOD
        ticks.finish(now)
    assert all(point % PERIOD == 0 for point in served)
    assert all(b > a for a, b in itertools.pairwise(served))
    passed = (ticks.scheduled_ns - 5000) // PERIOD
    assert ticks.samples == len(delays)
    # grid points behind us: in time, or missed (late or skipped), nothing counted twice
    assert in_time + ticks.missed == passed


@given(st.integers(0, 50_000))
def test_a_stall_is_never_made_up_by_a_burst(delay: int) -> None:
    ticks = Ticks(0, PERIOD)
    ticks.finish(delay)
    assert ticks.scheduled_ns > delay - PERIOD
    assert ticks.scheduled_ns <= max(delay, PERIOD)


def test_lateness_is_not_negative() -> None:
    assert Ticks(5000, PERIOD).lateness_ns(4000) == 0
    assert Ticks(5000, PERIOD).lateness_ns(5250) == 250
