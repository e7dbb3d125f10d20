"""A gauge that repeats its last reading, at regular or irregular intervals, gives the model, the
noise and the judgement of one that does not: the rows that repeat are left out and counted."""

import numpy as np
import pytest
from tests.rigs.outside import RATE_HZ, plays, times

from dehyst.models.cascade.simulate import simulate
from dehyst.models.identify import identify
from dehyst.models.identify.validation import validate
from dehyst.models.recording import Bools, Floats, Recording

N, NOISE_UM = 6000, 0.005
T = times(N / RATE_HZ)
THRESHOLDS, WEIGHTS = np.array([0.0, 5.0, 10.0, 20.0, 30.0]), np.array([6, 2, 1.5, 1, 1]) * 0.01


def drive(seed: int) -> Floats:
    """Return lines of 0.4 to 4.1 Hz in 0 to 100 V that begin at rest."""
    phases = np.random.default_rng(seed).uniform(0.0, 2 * np.pi, 4)
    lines = zip((0.4, 1.1, 2.3, 4.1), (1.0, 0.5, 0.3, 0.15), phases, strict=True)
    u = sum(size * np.sin(2 * np.pi * hz * T + phase) for hz, size, phase in lines)
    return np.clip(T / 0.5, 0.0, 1.0) * (50.0 + 49.0 * u / np.abs(u).max())


def still(u: Floats) -> Floats:
    return plays(u, THRESHOLDS, WEIGHTS)


def at_random(share: float) -> Bools:
    again = np.random.default_rng(5).random(N) < share
    again[0] = False
    return again


def recorded(again: Bools, seed: int) -> Recording:
    """Record the stage with a gauge that repeats its last reading at these rows (N,)."""
    y = still(drive(seed)) + NOISE_UM * np.random.default_rng(seed + 10).standard_normal(N)
    last = np.maximum.accumulate(np.where(again, 0, np.arange(N)))
    return Recording(T, drive(seed), y[last], name="repeating.csv")


KINDS = [at_random(0.0), at_random(0.05), at_random(0.3), at_random(0.6), np.arange(N) % 3 > 0]
NAMES = ["none", "one-in-twenty", "three-in-ten", "six-in-ten", "two-in-three"]


@pytest.mark.parametrize("again", KINDS, ids=NAMES)
def test_repeated_rows_are_no_misfit(again: Bools) -> None:
    found = identify([recorded(again, 1)])
    model, count = found.model, int(again.sum())
    said = [note for note in found.notes if "repeat the previous reading" in note]
    assert [note.split(" rows ")[0] for note in said] == (
        [f"repeating.csv: {count} of {N}"] if count else []
    )
    assert not any("isolated" in note for note in found.notes)
    assert not found.used[0][again].any()
    assert found.noise_rms == pytest.approx(NOISE_UM, rel=0.1)
    assert model.fit.rms < 1.1 * NOISE_UM
    error = still(drive(2)) - simulate(model, T, drive(2))
    assert np.std(error) < 0.4 * NOISE_UM
    assert model.fit.band is not None
    assert model.fit.band < 2.0 * NOISE_UM
    assert np.mean(np.abs(error - error.mean()) <= model.fit.band) > 0.9


@pytest.mark.parametrize("again", KINDS, ids=NAMES)
def test_a_model_is_not_judged_on_repeated_rows(again: Bools) -> None:
    model = identify([recorded(KINDS[0], 1)]).model
    judged = validate(model, recorded(again, 2))
    assert judged.repeats == again.sum()
    assert judged.rms == pytest.approx(NOISE_UM, rel=0.1)
    assert judged.noise == pytest.approx(NOISE_UM, rel=0.1)
    assert not judged.worse
    assert judged.interval_is == ""


def test_a_model_is_not_judged_where_the_gauge_is_stuck() -> None:
    model = identify([recorded(KINDS[0], 1)]).model
    stuck = (np.arange(N) > 0.4 * N) & (np.arange(N) < 0.5 * N)
    judged = validate(model, recorded(stuck, 2))
    assert stuck.sum() <= judged.stuck <= stuck.sum() + 1
    assert judged.rms == pytest.approx(NOISE_UM, rel=0.1)
    assert not judged.worse


def test_a_wrong_model_is_worse_on_the_rows_that_are_left() -> None:
    model = identify([recorded(KINDS[0], 1)]).model
    one = recorded(KINDS[2], 2)
    assert one.displacement is not None
    assert validate(model, Recording(T, one.drive, 1.01 * one.displacement)).worse
