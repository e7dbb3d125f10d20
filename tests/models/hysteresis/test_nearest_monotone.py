"""The nearest monotone model and its price, compared with independent references: a grid of all
candidates, and a bounded least squares by scipy's trust region on columns made by plain loops."""

import numpy as np
import pytest
from scipy.optimize import least_squares, lsq_linear

from dehyst.models.hysteresis.monotone import find_wrong_way, make_typical_drive, nearest_monotone
from dehyst.models.model import Hysteresis, Model, Validity
from dehyst.models.modelfile import shipped

LEAST = 0.05  # of the full-travel slope: the least slope of a nearest monotone model


def plays_by_hand(r: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Return the play operators (N, n), computed from their definition."""
    h, out = np.zeros(r.size), np.empty((u.size, r.size))
    for t, v in enumerate(u):
        h = np.maximum(v - r, np.minimum(v + r, h))
        out[t] = h
    return out


def output_by_hand(
    r: np.ndarray, b: np.ndarray, k: np.ndarray, c: np.ndarray, u: np.ndarray, dt: float
) -> np.ndarray:
    """Return y = S(sum (b + k du/dt) H), Eq. 6 of Qin et al."""
    plays, rates = plays_by_hand(r, u), np.concatenate([[0.0], np.diff(u)]) / dt
    z = plays @ b + rates * (plays @ k)
    return np.polynomial.polynomial.polyval(z, c)


def rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(x**2)))


def slopes_after_reversal(h: Hysteresis, rate: float) -> np.ndarray:
    """Return the partial sums (2, n) at the rates -rate and rate."""
    return np.array([np.cumsum(h.b - rate * h.k), np.cumsum(h.b + rate * h.k)])


BENT = [0.1, 1.0, 0.0, -0.004]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_of_two_operators_it_is_the_best_of_all_on_a_grid(sign: float) -> None:
    """Slopes -0.2 and 1.0 wanted: over a fine grid of both, no allowed pair comes nearer."""
    r, b, c = np.array([0.0, 1.0]), sign * np.array([-0.2, 1.2]), np.array([0.0, 1.0])
    model = Model(Hysteresis(r=r, b=b, c=c), Validity(0.0, 8.0))
    near, price = nearest_monotone(model)
    u, dt = make_typical_drive(0.0, 8.0, 0.0)
    plays, none = plays_by_hand(r, u), np.zeros(2)
    wanted = plays @ b
    grid = [
        (rms(plays @ (sign * np.array([p, q - p])) - wanted), p, q)
        for p in np.linspace(0.05, 0.3, 51)
        for q in np.linspace(0.8, 1.1, 301)
    ]
    least, p, q = min(grid)
    assert price == pytest.approx(least, rel=1e-3)
    assert price <= least + 1e-12
    assert sign * np.cumsum(near.hysteresis.b) == pytest.approx([p, q], abs=2e-3)
    assert sign * near.hysteresis.b[0] == pytest.approx(LEAST, rel=1e-9)  # 5 % of 1.0
    assert price == pytest.approx(
        rms(output_by_hand(r, near.hysteresis.b, none, c, u, dt) - wanted)
    )


@pytest.mark.parametrize("name", ["paper-eq11", "paper-eq12"])
def test_no_other_slopes_come_nearer_than_those_of_a_trust_region(name: str) -> None:
    """The weights b, by bounded least squares on columns weighted by the saturation's slope."""
    h = shipped(name).hysteresis
    v = shipped(name).validity
    near, price = nearest_monotone(shipped(name))
    u, dt = make_typical_drive(v.drive_min, v.drive_max, 0.0)
    plays = plays_by_hand(h.r, u - h.u_offset)
    z = plays @ h.b
    steep = np.abs(np.polynomial.polynomial.polyval(z, np.polynomial.polynomial.polyder(h.c)))
    steep = np.maximum(steep, 1e-3 * steep.max())
    low = LEAST * np.sum(h.b)
    steps = np.column_stack([plays[:, :-1] - plays[:, 1:], plays[:, -1]])
    found = lsq_linear(steps * steep[:, None], z * steep, (low, np.inf), method="trf", tol=1e-14)
    ours = rms((plays @ near.hysteresis.b - z) * steep)
    reference = rms((steps @ found.x - z) * steep)
    assert ours == pytest.approx(reference, rel=1e-4)
    assert np.cumsum(near.hysteresis.b).min() >= low * (1 - 1e-9)
    none = np.zeros(h.n)
    exact = output_by_hand(h.r, h.b, none, h.c, u - h.u_offset, dt)
    other = output_by_hand(h.r, near.hysteresis.b, none, h.c, u - h.u_offset, dt)
    assert price == pytest.approx(rms(other - exact), rel=1e-9)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_with_rates_slopes_of_both_signs_come_near_as_a_free_search_finds_them(sign: float) -> None:
    """k of either sign, so that the model is monotone at rest but not at 20 V/s upwards or
    downwards; a general minimiser over b and k with a barrier finds nothing nearer."""
    rate = 20.0
    r = np.array([0.0, 0.7, 2.0])
    b, k = np.array([0.25, 0.35, 0.4]), sign * np.array([-0.02, 0.012, 0.004])
    model = Model(Hysteresis(r=r, b=b, k=k, c=[0.0, 1.0]), Validity(0.0, 8.0))
    assert find_wrong_way(model.hysteresis, 0.0, 8.0, rate) is not None
    near, price = nearest_monotone(model, rate)
    u, dt = make_typical_drive(0.0, 8.0, rate)
    rates = np.concatenate([[0.0], np.diff(u)]) / dt
    plays = plays_by_hand(r, u)
    wanted = plays @ b + rates * (plays @ k)
    steps = np.column_stack([plays[:, :-1] - plays[:, 1:], plays[:, -1]])
    columns = np.hstack([steps, steps * (rates / rate)[:, None]])  # of P, and of rate times Q

    def misfit(x: np.ndarray) -> np.ndarray:
        """x: slopes at both rates, as square roots of their excess over the least slope."""
        up, down = LEAST + x[:3] ** 2, LEAST + x[3:] ** 2
        return columns @ np.concatenate([0.5 * (up + down), 0.5 * (up - down)]) - wanted

    tries = [least_squares(misfit, np.full(6, start), xtol=1e-15, ftol=1e-15, gtol=1e-15)
             for start in (0.3, 0.8)]  # fmt: skip
    reference = min(rms(found.fun) for found in tries)
    h = near.hysteresis
    exact = output_by_hand(r, b, k, np.array([0.0, 1.0]), u, dt)
    assert price == pytest.approx(rms(output_by_hand(r, h.b, h.k, h.c, u, dt) - exact), rel=1e-9)
    assert price == pytest.approx(reference, rel=1e-3)
    assert slopes_after_reversal(h, rate).min() == pytest.approx(LEAST, rel=1e-6)
    assert np.sign(h.k[0]) == np.sign(k[0])
    assert h.k == pytest.approx(k, abs=0.012)  # near the original, with the same sign


def test_the_price_is_the_difference_in_displacement_not_before_the_saturation() -> None:
    r, b, c = np.array([0.0, 1.0]), np.array([-0.2, 1.2]), np.array(BENT) * 3.0
    model = Model(Hysteresis(r=r, b=b, c=c), Validity(0.0, 8.0))
    near, price = nearest_monotone(model)
    u, dt = make_typical_drive(0.0, 8.0, 0.0)
    none = np.zeros(2)
    exact = output_by_hand(r, b, none, c, u, dt)
    assert price == pytest.approx(
        rms(output_by_hand(r, near.hysteresis.b, none, c, u, dt) - exact), rel=1e-9
    )
    assert 0.05 < price < 0.6


def test_without_rates_the_slopes_k_are_dropped_and_cost_nothing() -> None:
    h = Hysteresis(r=[0.0, 1.0], b=[0.4, 0.6], k=[0.01, -0.03], c=[0.0, 1.0])
    near, price = nearest_monotone(Model(h, Validity(0.0, 8.0)))
    assert price == 0.0
    assert near.hysteresis.k.tolist() == [0.0, 0.0]
    assert near.hysteresis.b.tolist() == [0.4, 0.6]


def test_thresholds_saturation_offset_and_range_stay() -> None:
    model = shipped("paper-eq11")
    near, _ = nearest_monotone(model)
    assert near.hysteresis.r.tolist() == model.hysteresis.r.tolist()
    assert near.hysteresis.c.tolist() == model.hysteresis.c.tolist()
    assert near.hysteresis.u_offset == model.hysteresis.u_offset
    assert near.validity == model.validity
