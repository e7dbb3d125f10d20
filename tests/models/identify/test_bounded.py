"""The bounded solver, compared with scipy, and the threshold elimination, with brute force."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from dehyst.models.identify.bounded import bounded_solve
from dehyst.models.identify.equations import Normal
from dehyst.models.identify.thresholds import eliminate, space_thresholds


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 12), st.booleans())
def test_same_solution_as_scipy(seed: int, size: int, collinear: bool) -> None:
    rng = np.random.default_rng(seed)
    a = rng.standard_normal((40, size)) * 10.0 ** rng.uniform(-3, 3, size)
    if collinear and size > 2:
        size_of = np.linalg.norm(a, axis=0)
        a[:, 1] = a[:, 0] + 1e-2 * a[:, 2] * size_of[0] / size_of[2]
    b = rng.standard_normal(40)
    low = np.where(rng.random(size) < 0.7, rng.uniform(-0.5, 0.5, size), -np.inf)
    found, free = bounded_solve(a.T @ a, a.T @ b, low)
    best = lsq_linear(a, b, bounds=(low, np.inf), method="bvls", tol=1e-13)
    misfit = 0.5 * np.sum((a @ found - b) ** 2)
    assert np.all(found >= low - 1e-9 * np.abs(np.where(np.isfinite(low), low, 0)))
    assert misfit <= best.cost * (1 + 1e-6) + 1e-12
    assert np.all(found[~free] == pytest.approx(low[~free]))


def test_elimination_is_the_fit_of_the_smaller_model() -> None:
    """Every grid's misfit equals that of a plain bounded fit with the tied columns summed."""
    rng = np.random.default_rng(3)
    finest, rows = 6, 200
    a = rng.standard_normal((rows, 2 * finest + 1))
    b = rng.standard_normal(rows)
    eq = Normal(a.T @ a, a.T @ b, float(b @ b), rows, float(b @ b))
    low = np.r_[np.full(2 * finest, 0.05), -np.inf]
    grids = eliminate(eq, low, finest, True)
    assert [len(g.kept) for g in grids] == [6, 5, 4, 3, 2, 1]
    for grid in grids:
        edges = [*grid.kept, finest]
        merged = [a[:, s + i : s + j].sum(1) for s in (0, finest) for i, j in pairwise(edges)]
        columns = np.column_stack([*merged, a[:, -1]])
        bounds = np.r_[np.full(2 * len(grid.kept), 0.05), -np.inf]
        best = lsq_linear(columns, b, bounds=(bounds, np.inf), method="bvls", tol=1e-13)
        assert grid.misfit == pytest.approx(2 * best.cost, rel=1e-6)


def test_cubic_thresholds_are_fine_where_small() -> None:
    r = space_thresholds(10, 10.0)
    assert r[0] == 0
    assert np.all(np.diff(r, 2) > 0)
    assert r[-1] < 5.0
    many = space_thresholds(200, 10.0)
    assert many[1] == pytest.approx(space_thresholds(48, 10.0)[1])
    assert np.all(np.diff(many, 2) > 0)
