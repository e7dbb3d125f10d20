"""How the calls of a unit are timed: its late replies count, this machine's delays do not."""

from collections.abc import Callable, Iterable

import pytest

from dehyst.drivers.call_times import Batches


def calls(durations_s: Iterable[float]) -> tuple[Callable[[], None], Callable[[], float]]:
    """Return a call that takes these times in turn, and the clock that it advances."""
    now, left = [0.0], iter(durations_s)

    def call() -> None:
        now[0] += next(left)

    return call, lambda: now[0]


def test_every_tenth_reply_is_late_and_counts() -> None:
    """2 ms, every tenth 2.6 ms: at 500 Hz 10 replies in 100 would be late."""
    batches = Batches(size=30, most=4)
    times = batches.best(*calls([2.6e-3 if i % 10 == 9 else 2e-3 for i in range(120)]))
    assert batches.late_s(times) == pytest.approx(2.6e-3)
    assert times.percentile_s(50.0) == pytest.approx(2e-3)


def test_a_machine_that_is_busy_for_a_while_is_waited_for() -> None:
    slow, good = [9e-3, 2e-3] * 15, [2e-3] * 28 + [2.1e-3] * 2
    batches = Batches(size=30, most=4)
    assert batches.late_s(batches.best(*calls([*slow, *slow, *good]))) == pytest.approx(2.1e-3)


def test_where_it_is_never_still_the_best_batch_counts() -> None:
    rows = [late for late in (9e-3, 5e-3, 7e-3) for late in [2e-3] * 20 + [late] * 10]
    batches = Batches(size=30, most=3)
    assert batches.late_s(batches.best(*calls(rows))) == pytest.approx(5e-3)
