"""Tests of the checks of an amplifier's log: each finds what it should, and nothing else."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.rigs.output import (
    check_held,
    check_range,
    check_speed,
    check_steps,
    during,
    excess,
    worst_by_brute_force,
)

MS = 1_000_000
logs = st.lists(st.tuples(st.integers(0, 30 * MS), st.floats(-20.0, 20.0)), min_size=2, max_size=25)


@given(logs, st.floats(1.0, 3000.0))
def test_the_worst_window_is_that_of_all_pairs(moves: list[tuple[int, float]], rate: float) -> None:
    time_ns = np.cumsum([gap for gap, _ in moves])
    volts = np.cumsum([move for _, move in moves])
    most, i, j = excess(time_ns, volts, rate)
    assert most == pytest.approx(worst_by_brute_force(time_ns, volts, rate), abs=1e-6)
    moved = abs(volts[j] - volts[i - 1])
    assert most == pytest.approx(moved - rate * (time_ns[j] - time_ns[i]) * 1e-9, abs=1e-6)


def test_full_speed_in_equal_steps_is_one_step_and_held() -> None:
    time_ns = np.arange(50) * 10 * MS
    for volts in (np.arange(50) * 10.0, 500.0 - np.arange(50) * 10.0):
        assert check_speed(time_ns, volts, 1000.0, 10.0) == pytest.approx(10.0)


def test_two_steps_that_come_together_are_found_though_each_is_small_enough() -> None:
    time_ns = np.array([0, 10, 20, 39, 40, 50]) * MS  # one write 9 ms late, the next in time
    volts = np.arange(6) * 10.0
    with pytest.raises(AssertionError, match=r"by 3 writes within 11\.00 ms|by 2 writes"):
        check_speed(time_ns, volts, 1000.0, 10.0)


def test_slow_gain_on_the_limit_is_found_over_a_long_window() -> None:
    time_ns = np.arange(200) * 10 * MS
    with pytest.raises(AssertionError, match="199 writes"):
        check_speed(time_ns, np.arange(200) * 10.2, 1000.0, 11.0)  # 2 % too fast, continuously


def test_one_jump_is_found_and_a_late_write_is_not() -> None:
    time_ns = np.array([0, 10, 200, 210]) * MS
    check_speed(time_ns, np.array([0.0, 10.0, 20.0, 30.0]), 1000.0, 10.0)
    with pytest.raises(AssertionError, match=r"30\.000 V by 1 writes"):
        check_speed(time_ns, np.array([0.0, 10.0, 30.0, 40.0]), 1000.0, 10.0)


def test_a_step_may_be_as_large_as_the_glide_and_the_way_since_the_last_write() -> None:
    time_ns = np.array([0, 10, 30, 32]) * MS
    check_steps(time_ns, np.array([0.0, 5.6, 13.2, 17.2]), 2.0, 200.0, 0.008)
    for i, step in ((1, 5.7), (2, 7.7), (3, 4.1)):
        volts = np.where(np.arange(4) >= i, step, 0.0)
        with pytest.raises(AssertionError, match="a step from"):
            check_steps(time_ns, volts, 2.0, 200.0, 0.008)


def test_an_empty_log_is_not_a_log_within_its_range() -> None:
    none = np.zeros(0)
    with pytest.raises(AssertionError, match="empty"):
        check_range(none, 0.0, 150.0)
    with pytest.raises(AssertionError, match="empty"):
        check_held(none, none, 0)
    check_range(np.array([0.0, 150.001]), 0.0, 150.0)
    for volts in (-0.01, 150.01):
        with pytest.raises(AssertionError):
            check_range(np.array([75.0, volts]), 0.0, 150.0)


def test_held_is_the_same_voltage_from_before_the_beginning_to_the_end() -> None:
    time_ns, volts = np.array([0, 10, 20, 30]) * MS, np.array([1.0, 2.0, 2.0, 3.0])
    assert check_held(time_ns, volts, 15 * MS, 25 * MS) == 2.0
    for begin, end in ((5, 15), (15, 35)):
        with pytest.raises(AssertionError, match=r"moved by 1\.000 V"):
            check_held(time_ns, volts, begin * MS, end * MS)


def test_a_part_of_the_log_begins_with_the_voltage_in_force() -> None:
    time_ns, volts = np.array([0, 10, 20]) * MS, np.array([1.0, 2.0, 3.0])
    part = during(time_ns, volts, 15 * MS)
    assert part[0].tolist() == [15 * MS, 20 * MS]
    assert part[1].tolist() == [2.0, 3.0]
