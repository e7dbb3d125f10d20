"""What can be distinguished from the loop if a drive hardly reverses."""

import numpy as np
import pytest

from dehyst.models.diagnosis.data.drive_path import (
    can_be_distinguished,
    count_turns,
    has_few_turns,
    has_long_rest,
    is_single_loop,
)
from dehyst.models.diagnosis.data.prepare import prepare
from dehyst.models.physics import list_candidates
from dehyst.models.recording import Recording
from dehyst.models.signals.joined import Data, Floats

T = np.arange(4000) * 0.01
TRIANGLE = 10.0 * np.interp(T, [0.0, 20.0, 40.0], [0.0, 1.0, 0.0])
STEP = np.where(T < 2.0, 4.0 * T, 8.0)
SINES = 5.0 - 5.0 * np.cos(2 * np.pi * 0.1 * T)  # four periods


def recorded(drive: Floats, **channels: Floats) -> Data:
    y = drive + 1e-3 * np.random.default_rng(3).standard_normal(T.size)
    return prepare([Recording(T, drive, y, channels=channels, name="one.csv")])


@pytest.mark.parametrize(("drive", "expected"), [(TRIANGLE, 1), (STEP, 0), (SINES, 7)])
def test_turns_are_counted(drive: Floats, expected: int) -> None:
    data = recorded(drive)
    assert count_turns(data) == expected
    assert has_few_turns(data) == (expected < 3)


def reported(data: Data) -> set[str]:
    return {c.key for c in list_candidates(data) if can_be_distinguished(c, data)}


def test_one_triangle_tells_lines_and_what_moves_by_itself_alone() -> None:
    """Its time is its path: a slow change or a force at the turn looks like a part of the loop."""
    force = np.exp(-(((T - 20.0) / 2.0) ** 2))
    other = np.sin(2 * np.pi * 0.7 * T)
    data = recorded(TRIANGLE, force_nn=force, u2_v=other)
    assert not has_long_rest(data)
    keys = reported(data)
    assert {"hum", "coupling-u2_v"} <= keys
    assert not {"drift-trend", "creep-earlier", "coupling-force_nn", "creep", "lag-drive"} & keys


def test_a_step_and_a_hold_tell_a_slow_change_too() -> None:
    data = recorded(STEP, temp_c=20.0 + 0.1 * T)
    assert has_long_rest(data)
    assert {"drift-trend", "creep-earlier", "drift-temp_c"} <= reported(data)


def test_a_staircase_tells_what_the_drive_causes_in_its_rests() -> None:
    """It reverses once: static causes look like a part of the loop, rests and all."""
    data = recorded(np.round(TRIANGLE))
    assert has_few_turns(data)
    keys = reported(data)
    assert {"resonance", "lag-drive", "creep", "delay"} <= keys
    assert not {c.key for c in list_candidates(data) if c.driven and c.static} & keys


def test_one_loop_again_and_again_is_distinguished_from_inner_loops_and_from_two_frequencies() -> (
    None
):
    assert is_single_loop(recorded(SINES))
    fifth = 2.0 * np.sin(2 * np.pi * 0.5 * T)  # inner loops, in the same period
    assert not is_single_loop(recorded(0.6 * SINES + fifth))
    assert not is_single_loop(recorded(STEP))
    assert not is_single_loop(recorded(SINES * np.linspace(0.3, 1.0, T.size)))
    other = 5.0 - 5.0 * np.cos(2 * np.pi * 0.2 * T)
    pair = [Recording(T, u, u.copy(), name=f"{k}.csv") for k, u in enumerate((SINES, other))]
    assert not is_single_loop(prepare(pair))
    assert is_single_loop(prepare([pair[0], pair[0]]))
