"""The trajectory queue against numpy's own interpolation."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from dehyst.daemon.loop import targets
from dehyst.daemon.loop.targets import TrajectoryQueue

PERIOD = 1_000_000


class Queue(TrajectoryQueue):
    """A queue that runs the loop's kernels on its memory."""

    def begin(self, trajectory: int, start_ns: int) -> None:
        targets.clear(self.numbers[0])
        self.numbers["id"], self.numbers["start_ns"] = trajectory, start_ns

    def append(self, offset_ns: int, value: float, last: bool) -> bool:
        return bool(targets.append(self.numbers[0], self.points, offset_ns, value, 0.0, last))

    def window(self, now_ns: int, period_ns: int, out: np.ndarray) -> int:
        return int(targets.window(self.numbers[0], self.points, now_ns, period_ns, out)[0])

    def starved(self, now_ns: int) -> bool:
        return bool(targets.starved(self.numbers[0], self.times, now_ns))

    def finished(self, now_ns: int) -> bool:
        return bool(targets.finished(self.numbers[0], self.times, now_ns))


@given(
    st.lists(st.tuples(st.integers(1, 5_000_000), st.floats(-10, 10)), min_size=2, max_size=40),
    st.integers(0, 60_000_000),
)
def test_window_is_linear_interpolation(steps: list[tuple[int, float]], start: int) -> None:
    queue = Queue(64)
    queue.begin(7, start)
    times = np.cumsum([s for s, _ in steps])
    values = np.array([v for _, v in steps])
    for i, (time, value) in enumerate(zip(times, values, strict=True)):
        assert queue.append(int(time), float(value), i == len(steps) - 1)
    out = np.zeros(16)
    now = start
    while now < start + times[-1] + 20 * PERIOD:
        assert queue.window(now, PERIOD, out) == out.size
        expected = np.interp(now + PERIOD * np.arange(16) - start, times, values)
        np.testing.assert_allclose(out, expected, atol=1e-9)
        now += 7 * PERIOD
    assert queue.finished(now)


def test_unknown_future_is_not_invented() -> None:
    queue = Queue(16)
    queue.begin(1, 0)
    for i in range(5):
        queue.append(i * PERIOD, float(i), False)
    out = np.full(8, np.nan)
    assert queue.window(2 * PERIOD, PERIOD, out) == 3
    np.testing.assert_allclose(out[:3], [2, 3, 4])
    assert not queue.starved(4 * PERIOD)
    assert queue.starved(5 * PERIOD)
    assert queue.window(6 * PERIOD, PERIOD, out) == 0


def test_refuses_points_out_of_order_duplicated_after_the_end_and_beyond_capacity() -> None:
    queue = Queue(4)
    queue.begin(1, 100)
    assert queue.append(10, 1.0, False)
    assert not queue.append(10, 1.0, False)
    assert not queue.append(5, 1.0, False)
    assert queue.append(20, 1.0, False)
    assert queue.append(30, 1.0, False)
    assert queue.append(40, 1.0, False)
    assert queue.numbers["count"][0] == 4
    assert not queue.append(50, 1.0, True)
    queue.begin(2, 0)
    assert queue.append(1, 0.0, True)
    assert not queue.append(2, 0.0, True)


def test_memory_is_constant_over_a_long_stream() -> None:
    queue = Queue(32)
    queue.begin(1, 0)
    out, sent = np.zeros(4), 0
    for now in range(0, 2000 * PERIOD, PERIOD):
        while sent * PERIOD < now + 20 * PERIOD:
            assert queue.append(sent * PERIOD, float(sent), False)
            sent += 1
        assert queue.window(now, PERIOD, out) == 4
        np.testing.assert_allclose(out, now / PERIOD + np.arange(4))
