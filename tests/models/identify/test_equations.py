"""The equations of the fit, compared with finite differences and plain numpy."""

from dataclasses import replace

import numpy as np
import pytest

from dehyst.models.hysteresis.forward import simulate_hysteresis
from dehyst.models.identify.data.rows import read_rows
from dehyst.models.identify.equations import Params, Shape, assemble, linearise, make_equations
from dehyst.models.identify.fit import fit_shape, make_bounds, make_start
from dehyst.models.identify.setup import set_up
from dehyst.models.physics.dynamics import Dynamics
from dehyst.models.recording import Recording


def _recording(seed: int = 0) -> Recording:
    t = np.arange(600) * 1e-3
    u = 4 - 3 * np.cos(2 * np.pi * 4 * t) - np.cos(2 * np.pi * 11 * t)
    rng = np.random.default_rng(seed)
    return Recording(t, u, 1.2 * u + 0.1 * rng.standard_normal(t.size))


RATES = np.array([40.0, 90.0, 200.0, 200.0])
SHAPES = [Shape(False, (0, 3)), Shape(True, (0, 2, 3)), Shape(True, (0, 3, 5))]


@pytest.mark.parametrize("shape", SHAPES, ids=lambda s: s.name)
def test_jacobian_is_the_derivative(shape: Shape) -> None:
    rows = [read_rows(_recording(0)), read_rows(_recording(1))]
    r = np.array([0.0, 0.1, 0.7, 1.9])
    block = next(iter(make_equations(rows, [x.use for x in rows], r, (0.5, 0.5), RATES, 1.0)))
    rng = np.random.default_rng(5)
    params = Params(
        rng.uniform(0.5, 1.5, 8 if shape.rate else 4), rng.normal(0, 1e-3, len(shape.powers)),
        np.array([0.2]),
    )  # fmt: skip
    jac, err = linearise(block, shape, params)
    p = params.packed()
    for i in range(p.size):
        step = 1e-6 * max(1.0, abs(p[i]))
        up, down = p.copy(), p.copy()
        up[i] += step
        down[i] -= step
        other = [linearise(block, shape, Params.unpacked(x, params))[1] for x in (down, up)]
        slope = (other[0] - other[1]) / (2 * step)
        np.testing.assert_allclose(
            jac[:, i], slope, rtol=1e-5, atol=1e-5 * np.abs(slope).max() + 1e-9
        )
    eq = assemble([block], shape, params)
    np.testing.assert_allclose(eq.gram, jac.T @ jac, rtol=1e-9, atol=1e-9 * np.abs(eq.gram).max())
    np.testing.assert_allclose(eq.right, jac.T @ (err + jac @ p), rtol=1e-8)
    assert eq.misfit == pytest.approx(err @ err)
    assert eq.misfit_at(p) == pytest.approx(err @ err, rel=1e-6)


@pytest.mark.parametrize("by_turns", [False, True])
@pytest.mark.parametrize("shape", SHAPES, ids=lambda s: s.name)
def test_equations_and_forward_model_agree(shape: Shape, by_turns: bool) -> None:
    """The residual of the equations is the residual of the written model when it is run."""
    rec = _recording()
    rows = [read_rows(rec)]
    setup = replace(set_up(rows, True), by_turns=by_turns)
    r = np.array([0.0, 0.1, 0.7, 1.9])
    rng = np.random.default_rng(7)
    slopes = rng.uniform(0.5, 1.5, 8 if shape.rate else 4)
    params = Params(slopes, rng.normal(0, 1e-3, len(shape.powers)), np.zeros(0))
    (error,) = setup.residuals(r, shape, params, 0.3)
    h = setup.hysteresis(r, shape, params, 0.3)
    (lot,) = setup.equations(setup.picks, r, 0.3, rate=shape.rate)
    np.testing.assert_allclose(linearise(lot, shape, params)[1], error[setup.picks[0]], atol=1e-9)
    np.testing.assert_allclose(
        error, rec.displacement - simulate_hysteresis(h, rec.drive, 1e-3), atol=1e-9
    )


@pytest.mark.parametrize("lag", [None, Dynamics("lag", "sensor", (0.004,))], ids=["none", "lag"])
@pytest.mark.parametrize("share", [1.0, 0.1, 0.004])
def test_rows_that_are_passed_over_do_not_change_the_others(
    share: float, lag: Dynamics | None
) -> None:
    """Drives that rest, turn after a rest and are unknown for a while, over several lots."""
    rng = np.random.default_rng(11)
    u = np.clip(np.cumsum(rng.integers(-1, 2, 20_000)), 0, 40).astype(float)
    u[9000:9003] = np.nan
    (rows,) = [read_rows(Recording(np.arange(u.size) * 1e-3, u, u + rng.standard_normal(u.size)))]
    u, r = rows.u, np.array([0.0, 1.5, 4.0, 9.0])  # lone values were left out
    picks = rows.use & (rng.random(u.size) < share)
    lots = list(make_equations([rows], [picks], r, (0.5, 0.5), RATES, 1.0, lag))
    h, want = np.zeros(4), np.full((u.size, 4), np.nan)
    h = np.maximum(rows.came_from - r, np.minimum(rows.came_from + r, h))
    for t in np.flatnonzero(~np.isnan(u)):  # Eq. 1, written out
        h = np.maximum(u[t] - 0.5 - r, np.minimum(u[t] - 0.5 + r, h))
        want[t] = h - np.append(h[1:], 0.0)
    if lag is not None:  # tau y' + y = D, with D in straight lines between the known rows
        known, (tau,) = np.flatnonzero(~np.isnan(u)), lag.theta
        x, y = want[known], want[known]
        for i in range(1, known.size):
            dt = (known[i] - known[i - 1]) * 1e-3
            behind = (x[i] - x[i - 1]) / dt * tau
            y[i] = x[i] - behind + np.exp(-dt / tau) * (y[i - 1] - x[i - 1] + behind)
        want[known] = y
    np.testing.assert_allclose(np.concatenate([lot.d for lot in lots]), want[picks], atol=1e-9)


def test_static_fit_without_saturation_is_plain_least_squares() -> None:
    rec = _recording()
    setup = set_up([read_rows(rec)], True)
    r = np.array([0.0, 0.2, 1.0])
    blocks = setup.equations(setup.picks, r, 0.0)
    shape = Shape(False, (0,))
    start = make_start(3, shape, 1.0, 1)
    found = fit_shape(blocks, shape, start, make_bounds(start, None))
    h = np.zeros(3)
    plays = []
    for u in rec.drive:  # Eq. 1, written out
        h = np.maximum(u - r, np.minimum(u + r, h))
        plays.append(h)
    plays = np.array(plays)
    weights, *_ = np.linalg.lstsq(
        np.column_stack([plays, np.ones(len(plays))]), rec.displacement, rcond=None
    )
    np.testing.assert_allclose(np.diff(found.params.slopes, prepend=0), weights[:3], rtol=1e-6)
    assert found.params.c[0] == pytest.approx(weights[3], rel=1e-6)
