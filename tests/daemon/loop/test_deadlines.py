"""The deadline rule against a brute-force count of grid points, for any pattern of finishes."""

import itertools

from hypothesis import given
from hypothesis import strategies as st

from dehyst.daemon.loop.timing.deadlines import close

PERIOD = 1000


@given(st.lists(st.integers(0, 12_000), max_size=60))
def test_every_grid_point_is_served_or_counted_as_missed(delays: list[int]) -> None:
    scheduled, missed = 5000, 0
    served, in_time, now = [], 0, 5000
    for delay in delays:
        now = max(now, scheduled)
        served.append(scheduled)
        now += delay
        in_time += now < served[-1] + PERIOD
        late, scheduled = close(scheduled, PERIOD, now)
        missed += late
    assert all(point % PERIOD == 0 for point in served)
    assert all(b > a for a, b in itertools.pairwise(served))
    # each past grid point is in time or missed (late or skipped); none is counted twice
    assert in_time + missed == (scheduled - 5000) // PERIOD


@given(st.integers(0, 50_000))
def test_a_stall_is_never_made_up_by_a_burst(delay: int) -> None:
    _, scheduled = close(0, PERIOD, delay)
    assert delay - PERIOD < scheduled <= max(delay, PERIOD)
