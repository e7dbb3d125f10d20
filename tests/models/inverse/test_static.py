"""The exact inverse: round trip on random monotone models, and refusal of the others."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dehyst.models.errors import BadModel, NotInvertible
from dehyst.models.hysteresis.forward import simulate_hysteresis
from dehyst.models.hysteresis.monotone import find_wrong_way, nearest_monotone
from dehyst.models.inverse.static import (
    BEYOND_DRIVE,
    BEYOND_SATURATION,
    static_inverse,
)
from dehyst.models.model import Hysteresis, Model, Validity
from dehyst.models.modelfile import shipped


def _random_model(rng: np.random.Generator) -> Model:
    """Return a monotone model of either direction; thresholds may coincide or start above 0."""
    n = int(rng.integers(1, 15))
    r = np.sort(rng.uniform(0, 6, n))
    if rng.random() < 0.7:
        r[0] = 0.0
    if n > 3 and rng.random() < 0.3:
        r[2] = r[1]
    sums = rng.uniform(0.01, 1.0, n) * rng.choice([1.0, 1e-3, 30.0])
    b = np.diff(sums, prepend=0.0) * rng.choice([-1.0, 1.0])
    low = rng.uniform(-10, 9)
    high = rng.uniform(low + 0.5, 10)
    offset = rng.choice([0.0, 0.5 * (low + high), rng.uniform(-3, 3)])
    reach = float(np.sum(np.abs(b))) * 20.0
    degree = int(rng.integers(1, 6))
    # A derivative that is a square plus a constant never changes its sign.
    root = rng.normal(0, 1, degree // 2 + 1) / reach ** np.arange(degree // 2 + 1)
    slope = np.convolve(root, root)
    slope[0] += 0.05
    c = np.concatenate([[rng.normal()], slope / np.arange(1, slope.size + 1)])
    c[1:] *= rng.choice([-1.0, 1.0]) * rng.uniform(0.2, 3) / np.sum(np.abs(b))
    return Model(Hysteresis(r=r, b=b, c=c, u_offset=offset), Validity(low, high))


@settings(max_examples=150, deadline=None)
@given(st.integers(0, 2**31))
def test_round_trip_from_displacement_to_displacement(seed: int) -> None:
    rng = np.random.default_rng(seed)
    model = _random_model(rng)
    v = model.validity
    inverse = static_inverse(model)
    start = float(rng.uniform(v.drive_min, v.drive_max))
    # A history with turning points, steps, holds and both ends of the range.
    u = rng.uniform(v.drive_min, v.drive_max, 60)
    u = np.concatenate(
        [[start], u, [v.drive_min, v.drive_max, v.drive_max], np.linspace(*u[:2], 20), u[-3:]]
    )
    y = simulate_hysteresis(model.hysteresis, u, 1.0)
    got, flags = inverse.run(y, None, start)
    assert np.all(got >= v.drive_min)
    assert np.all(got <= v.drive_max)
    back = simulate_hysteresis(model.hysteresis, np.concatenate([[start], got]), 1.0)[1:]
    assert np.max(np.abs(back - y)) < 1e-9 * max(1.0, float(np.max(np.abs(y))))
    scale = abs(v.drive_max - v.drive_min)
    assert np.count_nonzero((flags != 0) & (np.abs(back - y) > 1e-9 * scale)) == 0


@pytest.mark.parametrize("name", ["paper-eq11", "paper-eq12"])
def test_round_trip_on_the_papers_nearest_monotone_models(name: str) -> None:
    model, price = nearest_monotone(shipped(name))
    assert 0 < price < 0.06
    inverse = static_inverse(model)
    t = np.arange(5000) * 1e-3
    y = 6.0 + 3.5 * np.sin(2 * np.pi * 1.3 * t) * np.cos(2 * np.pi * 0.21 * t)
    u, flags = inverse.run(y)
    assert np.all(flags == 0)
    assert np.max(np.abs(simulate_hysteresis(model.hysteresis, u, 1e-3) - y)) < 1e-9


def test_unreachable_targets_are_flagged_and_the_nearest_is_given() -> None:
    model, _ = nearest_monotone(shipped("paper-eq11"))
    inverse = static_inverse(model)
    u, flags = inverse.run(np.array([5.0, 30.0, 5.0, -30.0, 5.0]))
    assert u[1] == 10.0
    assert u[3] == 0.0
    assert flags[1] & BEYOND_DRIVE
    assert flags[3] & BEYOND_DRIVE
    assert flags[0] == flags[2] == flags[4] == 0


@pytest.mark.parametrize(("way", "end"), [([1.0, 0.5, -5.0], 0.0), ([10.0, 9.0, 9.5, 30.0], 10.0)])
def test_beyond_the_range_is_flagged_where_a_play_would_join_in_outside_of_it(
    way: list[float], end: float
) -> None:
    """Displacements that drives inside the range reach, and then one that none reaches."""
    model = Model(Hysteresis(r=[0.0, 2.0], b=[1.0, 1.0], c=[0.0, 1.0]), Validity(0.0, 10.0))
    reached = simulate_hysteresis(model.hysteresis, np.array(way[:-1]), 1.0)
    u, flags = static_inverse(model).run(np.append(reached, way[-1]))
    assert flags[:-1].tolist() == [0] * (len(way) - 1)
    assert flags[-1] & BEYOND_DRIVE
    assert u[-1] == end


def test_a_saturation_that_turns_over_is_inverted_up_to_its_extremum() -> None:
    # y = z - 0.05 z^2 has its extremum at z = 10; the drive reaches z = 12.
    model = Model(Hysteresis(r=[0.0, 1.0], b=[1.0, 0.0], c=[0.0, 1.0, -0.05]), Validity(0.0, 12.0))
    inverse = static_inverse(model)
    u, flags = inverse.run(np.array([2.0, 4.999, 5.5]))
    assert flags.tolist() == [0, 0, BEYOND_SATURATION]
    assert u[2] == pytest.approx(10.0, abs=1e-6)
    assert np.allclose(simulate_hysteresis(model.hysteresis, u[:2], 1.0), [2.0, 4.999], atol=1e-9)


def test_refusal_says_at_which_reversal_and_by_how_much() -> None:
    with pytest.raises(NotInvertible, match=r"0\.04588 V.*-0\.173.*nearest monotone.*rms"):
        static_inverse(shipped("paper-eq11"))
    found = find_wrong_way(shipped("paper-eq11").hysteresis, 0.0, 10.0)
    assert found is not None
    assert found.operator == 1
    # Independent reference: drive up, turn, and see how far the output continues.
    h = shipped("paper-eq11").hysteresis
    u = np.concatenate([np.linspace(0, 9, 200), np.linspace(9, 8.8, 20001)])
    y = simulate_hysteresis(h, u, 1.0)[200:]
    overshoot = y.max() - y[0]
    assert overshoot > 0.0
    assert 0.5 * overshoot < found.wrong_way < 2.0 * overshoot
    assert 9.0 - u[200 + int(np.argmax(y))] == pytest.approx(found.travel_to, rel=1e-2)


def test_a_bad_drive_range_is_refused() -> None:
    model, _ = nearest_monotone(shipped("paper-eq11"))
    with pytest.raises(BadModel, match="drive range"):
        static_inverse(model, 5.0, 5.0)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**31))
def test_nearest_monotone_model_is_monotone(seed: int) -> None:
    rng = np.random.default_rng(seed)
    model = _random_model(rng)
    h = model.hysteresis
    spoiled = replace(
        model,
        hysteresis=replace(
            h, b=h.b + rng.normal(0, np.abs(h.b).max(), h.n), k=rng.normal(0, 1e-3, h.n)
        ),
    )
    for rate in (0.0, 50.0):
        near, price = nearest_monotone(spoiled, rate)
        v = near.validity
        assert find_wrong_way(near.hysteresis, v.drive_min, v.drive_max, rate) is None
        assert np.isfinite(price)


def test_a_monotone_model_is_its_own_nearest() -> None:
    model = _random_model(np.random.default_rng(5))
    assert nearest_monotone(model) == (model, 0.0)
