"""The path in the plane: each point joins samples of the same moment, whatever was lost."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from dehyst.daemon.page.trail import KEPT, POINT_NS, Trail, join_trails
from dehyst.daemon.rings.records import TELEMETRY


def telemetry(first: int, count: int, period_ns: int) -> np.ndarray:
    """Return samples whose target is the time in s and whose reading is twice that."""
    out = np.zeros(count, TELEMETRY)
    out["scheduled_ns"] = period_ns * np.arange(first, first + count)
    out["target"] = 1e-9 * out["scheduled_ns"]
    out["measured"] = 2.0 * out["target"]
    return out


@given(
    st.lists(st.integers(1, 400), min_size=1, max_size=8),
    st.sampled_from([200_000, 1_000_000, 5_000_000, 20_000_000]),
)
@settings(max_examples=40, deadline=None)
def test_whatever_the_batches_a_point_is_the_first_sample_of_its_time(
    sizes: list[int], period_ns: int
) -> None:
    samples = telemetry(0, sum(sizes), period_ns)
    trail, at = Trail(), 0
    for size in sizes:
        trail.add(samples[at : at + size])
        at += size
    piece = trail.since(-1)
    numbers, first = np.unique(samples["scheduled_ns"] // POINT_NS, return_index=True)
    assert piece.number.tolist() == numbers.tolist()
    assert piece.target.tolist() == samples["target"][first].tolist()
    after = int(numbers[len(numbers) // 2])
    assert trail.since(after).number.tolist() == numbers[numbers > after].tolist()


def test_it_holds_so_many_points_and_begins_anew_with_the_clock() -> None:
    trail = Trail()
    trail.add(telemetry(10_000, KEPT + 100, POINT_NS))
    assert trail.since(-1).number.size == KEPT
    trail.add(telemetry(3, 5, POINT_NS))
    assert trail.since(-1).number.tolist() == [3, 4, 5, 6, 7]


def test_what_one_axis_lost_is_in_no_axis_of_the_picture() -> None:
    x, y = Trail(), Trail()
    samples = telemetry(0, 50, POINT_NS)
    x.add(samples[:20])
    x.add(samples[30:])
    y.add(samples[5:])
    of_x, of_y = join_trails([x.since(-1), y.since(-1)])
    assert of_x.number.tolist() == [*range(5, 20), *range(30, 50)]
    assert np.array_equal(of_x.number, of_y.number)
    assert np.array_equal(of_x.measured, of_y.measured)
    assert join_trails([]) == []
