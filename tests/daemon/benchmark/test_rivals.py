"""Each model of the benchmark identifies a stage of its own class; a free run sees no measured
displacement."""

import math

import numpy as np
import pytest

from dehyst.daemon.benchmark.rivals.interface import Rival, solve_not_negative
from dehyst.daemon.benchmark.rivals.narx import NARX
from dehyst.daemon.benchmark.rivals.play_models import CLASSICAL
from dehyst.daemon.benchmark.rivals.preisach import PREISACH, relay_matrix
from dehyst.daemon.benchmark.rivals.rate_equations import BOUC_WEN, DUHEM
from dehyst.models.recording import Floats, Recording

DT = 0.005


def drives() -> tuple[Floats, Floats]:
    """Return (t_s, volts): 0 to 10 V, with loops of many sizes."""
    t = np.arange(3000) * DT
    return t, 5.0 - 2.5 * np.cos(2 * np.pi * 1.0 * t) - 2.5 * np.cos(2 * np.pi * 0.31 * t)


def plays(u: Floats) -> Floats:
    """Return two play operators and a straight line, by their definition."""
    out, h = np.empty(u.size), [0.0, 0.0]
    for i, v in enumerate(u.tolist()):
        h = [max(v - r, min(v + r, x)) for r, x in zip((1.0, 3.0), h, strict=True)]
        out[i] = 0.5 * v + 0.3 * h[0] + 0.2 * h[1]
    return out


def friction(u: Floats) -> Floats:
    """Integrate dh = du - |du| h in steps of 0.001: in the class of Bouc-Wen and of Duhem."""
    out, h, before = np.empty(u.size), 0.0, 0.0
    for i, v in enumerate(u.tolist()):
        parts = max(1, math.ceil(abs(v - before) / 1e-3))
        for _ in range(parts):
            d = (v - before) / parts
            h += d - abs(d) * h
        out[i], before = 2.0 * v - h, v
    return out


def lagging(u: Floats) -> Floats:
    """Return y(k) = 0.9 y(k - 1) + 0.1 u(k), which a NARX model represents exactly."""
    out, y = np.empty(u.size), float(u[0])
    for i, v in enumerate(u.tolist()):
        y = 0.9 * y + 0.1 * v
        out[i] = y
    return out


CASES = [
    (CLASSICAL, plays, 0.005),
    (PREISACH, plays, 0.03),  # the plane has 24 steps
    (BOUC_WEN, friction, 0.005),
    (DUHEM, friction, 0.005),
    (NARX, lagging, 0.001),
]


@pytest.mark.parametrize(("rival", "stage", "most"), CASES, ids=[r.name for r, _, _ in CASES])
def test_a_stage_of_its_own_class_is_found(rival: Rival, stage: object, most: float) -> None:
    t, u = drives()
    assert callable(stage)
    predict = rival.fit(Recording(t, u, stage(u)))
    other = 5.0 - 3.0 * np.cos(2 * np.pi * 0.7 * t) - 2.0 * np.cos(2 * np.pi * 0.2 * t)
    want = stage(other)
    assert np.std(predict(t, other) - want) < most * np.ptp(want)


@pytest.mark.parametrize("rival", [r for r, _, _ in CASES], ids=lambda r: r.name)
def test_what_was_predicted_does_not_depend_on_what_comes_later(rival: Rival) -> None:
    t, u = drives()
    predict = rival.fit(Recording(t, u, plays(u)))
    whole, first = predict(t, u), predict(t[:1000], u[:1000])
    np.testing.assert_array_equal(whole[:1000], first)


def test_relays_switch_at_their_levels() -> None:
    u = np.array([0.0, 0.5, 0.8, 0.5, 0.2, 0.5])
    out = relay_matrix(np.array([0.7]), np.array([0.3]), u)[:, 0]
    assert out.tolist() == [0.0, 0.0, 1.0, 1.0, 0.0, 0.0]


def test_weights_below_zero_are_not_given() -> None:
    rng = np.random.default_rng(1)
    x = rng.standard_normal((400, 3))
    weights, offset = solve_not_negative(x, x @ np.array([2.0, -1.0, 0.5]) + 3.0)
    assert weights[1] == 0.0
    assert weights[[0, 2]] == pytest.approx([2.0, 0.5], abs=0.2)
    assert offset == pytest.approx(3.0, abs=0.2)
