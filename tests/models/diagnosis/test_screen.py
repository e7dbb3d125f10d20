"""The gain that the screen estimates for a part of the samples is that of a fit with the column set
to zero outside of it."""

import numpy as np
import pytest
from tests.models.diagnosis.test_diagnosed_model import NOISE_UM, plain, recordings

from dehyst.models.diagnosis.base import rich_base
from dehyst.models.diagnosis.data.prepare import prepare
from dehyst.models.diagnosis.effects import Effect
from dehyst.models.diagnosis.fit import Problem
from dehyst.models.diagnosis.screen import Screen
from dehyst.models.physics import list_candidates
from dehyst.models.signals.joined import Floats


def solve(design: Floats, ridge: Floats, y: Floats) -> tuple[Floats, float]:
    """Return the coefficients and the sum of squares, each column's ridge included, of a fit by
    least squares over stacked rows."""
    rows = np.vstack([design, np.diag(np.sqrt(ridge))])
    given = np.r_[y, np.zeros(ridge.size)]
    found, *_ = np.linalg.lstsq(rows, given, rcond=None)
    return found, float(np.sum((given - rows @ found) ** 2))


@pytest.mark.parametrize("width", [1, 2])
@pytest.mark.parametrize("fitted", [False, True])
def test_gains_in_parts_are_those_of_fits_by_least_squares(width: int, fitted: bool) -> None:
    data = prepare(recordings(plain, late_s=2e-3))
    problem = Problem(data, rich_base(data)).with_fewer_rows(2000)
    null = problem.solve([])
    if fitted:
        (lag,) = (c for c in list_candidates(data) if c.key == "lag-drive")
        null = problem.refit([Effect(lag, (2e-3,))], start=null)
    screen, rng = Screen(problem, null), np.random.default_rng(1)
    x = NOISE_UM * rng.standard_normal((data.n, width)) + null.residual(data)[:, None]
    inside = np.stack([data.t < 3.0, (data.t > 5.0) | (data.rec == 0), data.rec == 1], axis=1)
    design, rows = null.design, problem.row_index
    if fitted:  # a step in the lag's own time constant is a further column
        _, slopes = problem.jacobian(null, problem.output_of(null))
        design = np.hstack([design, slopes[rows]])
        x[:, 0] += 0.5 * slopes[:, 0]
    gains, first = screen.gains_in(x, screen.split_samples(inside))
    scale = np.sum(design**2, axis=0)
    ridge = np.zeros(scale.size)
    size = null.design.shape[1]
    ridge[:size] = scale[:size] * problem.penalty(size)
    left = null.residual(data)[rows]
    for k in range(inside.shape[1]):
        own = (x * inside[:, [k]])[rows]
        _, without = solve(design, ridge, left)
        found, with_it = solve(np.hstack([design, own]), np.r_[ridge, np.zeros(width)], left)
        assert gains[k] == pytest.approx(without - with_it, rel=1e-2)
        assert first[k] == pytest.approx(found[-width], rel=1e-2, abs=1e-9)


def test_a_column_that_the_base_has_gains_nothing_in_all_of_the_samples() -> None:
    data = prepare(recordings(plain, late_s=2e-3))
    problem = Problem(data, rich_base(data)).with_fewer_rows(2000)
    screen = Screen(problem, problem.solve([]))
    everywhere = np.ones((data.n, 1), dtype=bool)
    for size in np.geomspace(1e-3, 1e3, 13):
        gains, _ = screen.gains_in(np.full((data.n, 1), size), screen.split_samples(everywhere))
        assert abs(gains[0]) < 1e-6 * float(screen.r @ screen.r)
