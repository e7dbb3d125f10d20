"""Rate dependence is identified even if it is weak, but not for a static stage of another class
than the model, whose misfit is correlated with place and rate alike."""

import numpy as np
import pytest

from dehyst.models.cascade.simulate import simulate
from dehyst.models.identify import Options, identify
from dehyst.models.modelfile import shipped
from dehyst.models.recording import Floats, Recording

T = 1e-3


def sines(first: tuple[float, float], second: tuple[float, float]) -> Floats:
    """Return two sines (size, frequency in Hz) from 0 to 10 V."""
    t = np.arange(2800) * T
    u = sum(a * (1.0 - np.cos(2 * np.pi * f * t)) for a, f in (first, second))
    return 10.0 * u / u.max()


def run_preisach(u: Floats) -> Floats:
    """Return a straight line plus a plane of relays, all off at first, of asymmetric density."""
    grid = np.linspace(0.0, 10.0, 121)
    up, down = np.meshgrid(grid, grid, indexing="ij")
    up, down = up[up > down], down[up > down]
    weight = np.exp((down - up) / 3.0) * (1.0 + 0.05 * (up + down))
    on, y = np.zeros(up.size), 0.75 * u
    for t in range(u.size):
        on = np.where(u[t] >= up, 1.0, np.where(u[t] <= down, 0.0, on))
        y[t] += 2.5 * (weight @ on) / weight.sum()
    return y


def run_weakly_dependent(u: Floats) -> Floats:
    """Run Eq. 6, written out: at the largest rates the slopes differ by 0.6 % of their mean."""
    r = np.linspace(0.0, 9.0, 60)
    b, k = np.r_[0.75, 0.018 * np.exp(-r[1:] / 2.5)], np.r_[-5e-5, 2e-6 * np.exp(-r[1:] / 1.5)]
    h, y = np.zeros(60), np.empty(u.size)
    for t in range(u.size):
        h = np.maximum(u[t] - r, np.minimum(u[t] + r, h))
        y[t] = (b + k * ((u[t] - u[t - 1]) / T if t else 0.0)) @ h
    return y


@pytest.mark.parametrize(
    "parts", [((2.89, 4.32), (2.7, 4.38)), ((2.72, 6.01), (2.36, 6.6)), ((2.9, 1.65), (2.39, 1.49))]
)
def test_a_static_stage_of_another_class_is_given_no_rate(
    parts: tuple[tuple[float, float], tuple[float, float]],
) -> None:
    """Two sines of nearly the same frequency pass every place at few rates."""
    u = sines(*parts)
    y = run_preisach(u) + 0.02 * np.random.default_rng(5).standard_normal(u.size)
    assert not identify([Recording(np.arange(u.size) * T, u, y)]).shape.rate


def test_a_weak_rate_dependence_is_taken() -> None:
    """A static model leaves a tenth of the noise power more, which only shows in the total."""
    u = sines((1.35, 5.6), (1.8, 4.2))
    noise = 0.02 * np.random.default_rng(6).standard_normal(u.size)
    rec = Recording(np.arange(u.size) * T, u, run_weakly_dependent(u) + noise)
    assert identify([rec]).shape.rate
    static = identify([rec], Options(rate=False)).model.fit
    assert static.rms is not None
    assert static.rms < 1.2 * 0.02


def run_paper(u: Floats) -> Floats:
    """Run Eq. 12, written out, with a drive range ten times as wide."""
    of = shipped("paper-eq12").hysteresis
    r, b, k = 10.0 * of.r, of.b / 10.0, of.k / 100.0
    h, z = np.zeros(r.size), np.empty(u.size)
    for t in range(u.size):
        h = np.maximum(u[t] - r, np.minimum(u[t] + r, h))
        z[t] = (b + k * ((u[t] - u[t - 1]) / T if t else 0.0)) @ h
    return np.asarray(np.polynomial.polynomial.polyval(z, of.c))


@pytest.mark.parametrize("seed", [9901, 9904])
def test_weights_that_depend_on_the_rate_are_not_taken_for_a_lag_about_a_bias(seed: int) -> None:
    """Two sines of 10 and 5 Hz in a fifth of the range: a static model with a delay of 9 ms leaves
    little more, and predicts another drive with four times to eighteen times the error."""
    t = np.arange(10000) * T
    full = sum(a * (1.0 - np.cos(2 * np.pi * f * t)) for a, f in ((20.0, 10.0), (30.0, 5.0)))
    lead = np.linspace(0.0, 40.0, 500)
    u = np.r_[lead, 40.0 + 20.0 * full / full.max()]
    y = run_paper(u) + 0.02 * np.random.default_rng(seed).standard_normal(u.size)
    model = identify([Recording(t, u[500:], y[500:], name="about a bias.csv")]).model
    assert model.blocks == ()
    assert np.any(model.hysteresis.k)
    other = np.r_[lead, 50.0 - 10.0 * np.cos(np.pi * np.arange(4000) * 2e-3)]
    error = simulate(model, np.arange(other.size) * T, other) - run_paper(other)
    assert np.std(error[1500:]) < 0.02
