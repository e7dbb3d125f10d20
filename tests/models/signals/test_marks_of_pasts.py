"""A mark for a history replaces the drive before the recording: compared with that drive itself."""

import numpy as np
import pytest

from dehyst.models.signals.filters import dahl, plays
from dehyst.models.signals.pasts import FRESH, FROM_ABOVE, FROM_BELOW

R, LENGTHS = np.array([0.0, 0.5, 1.5, 4.0, 12.0]), np.array([0.3, 2.0, 9.0])
U = 5.0 + 2.0 * np.sin(0.05 * np.arange(400)) + 1.5 * np.sin(0.013 * np.arange(400))
U[300], U[350] = 10.0, 0.0  # the range of the history
LEGS: dict[int, list[float]] = {FRESH: [], FROM_ABOVE: [0.0, 10.0], FROM_BELOW: [0.0, 10.0, 0.0]}


@pytest.mark.parametrize("past", LEGS)
def test_a_past_is_its_turning_points(past: int) -> None:
    marks = np.zeros(U.size, dtype=np.int64)
    marks[0] = past
    whole = np.append(LEGS[past], U)
    once = np.zeros(whole.size, dtype=bool)
    once[0] = True
    assert plays(R, U, marks) == pytest.approx(plays(R, whole, once)[len(LEGS[past]) :])
    assert dahl(LENGTHS, U, marks) == pytest.approx(dahl(LENGTHS, whole, once)[len(LEGS[past]) :])


def test_pasts_differ_until_the_drive_has_been_everywhere() -> None:
    marks = np.zeros((3, U.size), dtype=np.int64)
    marks[:, 0] = FRESH, FROM_ABOVE, FROM_BELOW
    fresh, above, below = (plays(R, U, m)[:, 3] for m in marks)
    assert not np.allclose(fresh[:300], above[:300])
    assert not np.allclose(above[:300], below[:300])
    assert np.array_equal(above[351:], below[351:])
    assert np.array_equal(fresh[351:], below[351:])
