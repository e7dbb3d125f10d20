"""The validation of a model does not depend on the delays of a busy recorder."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from tests.rigs.outside import noisy, ordinary, stage

from dehyst.models.errors import BadInput
from dehyst.models.identify import Identification, identify
from dehyst.models.identify.validation import Validation, validate
from dehyst.models.recording import Recording
from dehyst.models.signals.error_size import Z95

FINE, EACH = 1e-4, 50  # the stage's own steps, and how many there are in a sample
N = 1600


def recorded(late: int, seed: int, jitter: int = 0) -> Recording:
    """Record a loop that writes the drive at each sample and reads a gauge that lags by 3 ms. late:
    number of samples that come four periods after the previous one; jitter: of every time stamp
    [fine steps]."""
    rng = np.random.default_rng(seed)
    steps = np.full(N, EACH)
    steps[rng.choice(np.arange(N // 2, N), late, replace=False)] *= 4
    steps += rng.integers(-jitter, jitter + 1, N)
    at = np.cumsum(steps)
    t = FINE * np.arange(at[-1] + EACH)
    drive = 50 - 30 * np.cos(2 * np.pi * 0.7 * t) - 20 * np.cos(2 * np.pi * 1.6 * t)
    held = np.repeat(drive[at], np.r_[np.diff(at), EACH])
    moved = stage(held)
    lag = FINE / 3e-3
    seen = np.empty(moved.size)
    y = moved[0]
    for i, x in enumerate(moved):
        y += lag * (x - y)
        seen[i] = y
    return Recording(FINE * at, drive[at], noisy(seen[at - at[0]], seed), name="drive.csv")


@cache
def found() -> Identification:
    return identify([recorded(0, 1)])


def judged(late: int, jitter: int = 0) -> tuple[Validation, float]:
    """Return the validation and the rms over all rows."""
    one = recorded(late, 2, jitter)
    result = validate(found().model, one)
    assert one.displacement is not None
    return result, float(np.std(one.displacement - result.predicted))


def test_rows_at_late_samples_are_not_judged() -> None:
    (usual, _), (busy, of_all) = judged(0), judged(30)
    assert usual.late == 0
    assert 50 <= busy.late <= 60
    assert busy.rms == pytest.approx(usual.rms, rel=0.1)
    assert of_all > 1.5 * busy.rms
    assert not usual.worse
    assert not busy.worse


def test_stamps_that_are_never_regular_are_no_late_samples() -> None:
    assert judged(0, jitter=25)[0].late == 0


def read_with(noise_um: float, error: float = 0.0) -> Validation:
    """Validate on a gauge with more noise, of a stage whose displacement differs by a fraction."""
    one = recorded(0, 2)
    assert one.displacement is not None
    more = noise_um * np.random.default_rng(4).standard_normal(N)
    return validate(
        found().model, replace(one, displacement=(1.0 + error) * one.displacement + more)
    )


def test_the_noise_of_a_noisier_gauge_is_no_error_of_the_model() -> None:
    claim = read_with(0.0).claim
    assert claim is not None
    noisier = read_with(6.0 * claim)
    assert noisier.rms > 5.0 * claim
    assert noisier.white
    assert not noisier.worse


def test_a_wrong_model_is_worse_on_a_noisier_gauge_too() -> None:
    claim = read_with(0.0).claim
    assert claim is not None
    assert read_with(6.0 * claim, error=0.3).worse


def read_at(rows: np.ndarray) -> Validation:
    """Validate with a reading at these rows (N,) only."""
    one = recorded(30, 2)
    assert one.displacement is not None
    seen = np.where(rows, one.displacement, np.nan)
    return validate(found().model, replace(one, displacement=seen))


def test_rows_with_a_reading_are_judged_wherever_they_are() -> None:
    """The gauge may stop before the drive has covered its range, or be read only at late samples
    from then on."""
    one, row = recorded(30, 2), np.arange(N)
    assert one.displacement is not None
    for last in (400, 500):  # the drive has covered its range at row 417
        seen = np.where(row < last, one.displacement, np.nan)
        stopped = validate(found().model, replace(one, displacement=seen))
        assert np.isfinite([stopped.rms, stopped.offset, stopped.noise]).all()
        assert stopped.chance < Z95 / np.sqrt(0.9 * last)
    at_late = np.append(False, np.diff(one.t_s) > 1.2 * np.median(np.diff(one.t_s)))
    at_late[1:] |= at_late[:-1].copy()
    only = read_at(at_late | (row < 60))
    assert np.isfinite([only.rms, only.offset, only.noise]).all()
    assert only.late == 0


@pytest.mark.parametrize("noise_um", [0.0, 0.01])
def test_a_drive_that_never_moves_shows_nothing(noise_um: float) -> None:
    model = identify([ordinary(0)]).model
    y = 3.0 + noise_um * np.random.default_rng(0).standard_normal(2000)
    still = Recording(np.arange(2000) / 500.0, np.full(2000, 40.0), y, name="still.csv")
    with pytest.raises(BadInput, match=r"still.csv: the drive stays at 40 V throughout"):
        validate(model, still)


def test_a_wrong_gain_is_no_noise_where_there_are_few_rows_to_a_cycle() -> None:
    """Four rows to a cycle: the error changes from row to row, as noise does."""
    rng = np.random.default_rng(1)
    t = np.arange(4000) * 0.01
    u = rng.uniform(0.0, 100.0, t.size)
    y = stage(u)
    model = identify([Recording(t, u, y + 0.005 * rng.standard_normal(t.size))]).model
    fresh = rng.uniform(0.0, 100.0, t.size)
    wrong = 1.15 * stage(fresh) + 0.005 * rng.standard_normal(t.size)
    result = validate(model, Recording(t, fresh, wrong))
    assert result.worse
    assert result.noise < 0.05
