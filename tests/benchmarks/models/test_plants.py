"""The proof's own stages behave as their names say, compared with closed forms and brute force."""

import ast
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from tests.benchmarks.models.proof.base import RichBase
from tests.rigs.plants import drives as proof_drives
from tests.rigs.plants import effects as proof_effects
from tests.rigs.plants import effects_more as proof_effects_more
from tests.rigs.plants import effects_shape as proof_effects_shape
from tests.rigs.plants import hysteresis as proof_hysteresis
from tests.rigs.plants import hysteresis_more as proof_hysteresis_more
from tests.rigs.plants.effects import World
from tests.rigs.plants.effects_more import MAKERS, OUTSIDE
from tests.rigs.plants.effects_shape import PARTED, SHAPES, _dahl
from tests.rigs.plants.hysteresis import CLASSES as FIRST_CLASSES
from tests.rigs.plants.hysteresis import _bouc_wen, _everett, _preisach, _slip_bank
from tests.rigs.plants.hysteresis_more import _duhem, dead_zones, duhem, in_class

DT, H = 1e-3, 1.25e-4
CLASSES = {**FIRST_CLASSES, "duhem": duhem, "dead zones": dead_zones, "in the class": in_class}
EVERY = {**MAKERS, **OUTSIDE, **SHAPES, **PARTED}
FOREIGN = [name for name in CLASSES if name != "in the class"]


def world(u, seed=3):
    t = np.arange(u.size) * H
    return World(t, u, 22.0 + t / t[-1], 5.0 + np.sin(2 * np.pi * t), seed)


def grown_sine(n, cycles=5):
    t = np.linspace(0, 1, n)
    return 4.5 + 4.5 * np.sin(2 * np.pi * cycles * t - np.pi / 2) * (0.3 + 0.7 * t)


def test_generator_shares_no_code_with_the_library():
    modules = (
        proof_drives, proof_hysteresis, proof_hysteresis_more, proof_effects, proof_effects_more,
        proof_effects_shape,
    )  # fmt: skip
    for module in modules:
        tree = ast.parse(Path(module.__file__).read_text())
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom):
                assert not (node.module or "").startswith("dehyst")
            if isinstance(node, ast.Import):
                assert not any(a.name.startswith("dehyst") for a in node.names)


@pytest.mark.parametrize("name", CLASSES)
def test_hysteresis_lags_and_does_not_know_the_time(name):
    run = CLASSES[name](np.random.default_rng(4))
    up = np.linspace(0, 9, 500)
    y = run(np.r_[up, up[::-1]])
    assert y[0] == pytest.approx(0.0, abs=1e-9)
    opening = y[500:][::-1] - y[:500]
    assert 0.3 < opening.max() < 2.0
    assert opening[50:].min() > -1e-9
    slow = run(np.interp(np.linspace(0, 999, 4996), np.arange(1000), np.r_[up, up[::-1]]))
    np.testing.assert_allclose(slow[::5], y, atol=1e-5)


def test_preisach_against_a_bank_of_relays():
    rng = np.random.default_rng(1)
    grid = 12.0 / 600
    x = np.arange(601) * grid
    p_density, q_density = np.exp(-((x - 4) ** 2) / 8), np.exp(-((x - 3) ** 2) / 5)
    p = np.r_[0.0, np.cumsum(0.5 * (p_density[1:] + p_density[:-1])) * grid]
    q = np.r_[0.0, np.cumsum(0.5 * (q_density[1:] + q_density[:-1])) * grid]
    pq = p_density * q
    r = np.r_[0.0, np.cumsum(0.5 * (pq[1:] + pq[:-1])) * grid]
    u = rng.uniform(0, 9, 40)
    got = _preisach(u, p, r, q, grid)
    n = 240
    edge = (np.arange(n) + 0.5) * 12.0 / n
    on_at, off_at = np.meshgrid(edge, edge, indexing="ij")
    weight = np.interp(on_at, x, p_density) * np.interp(off_at, x, q_density) * (12.0 / n) ** 2
    weight[on_at < off_at] = 0.0
    state = np.zeros_like(weight)
    want = []
    for v in u:
        state[on_at <= v] = 1.0
        state[off_at >= v] = 0.0
        want.append(np.sum(state * weight))
    # a relay cell is 0.05 V wide, and a row of them has a weight of up to about 0.1
    np.testing.assert_allclose(got, want, atol=0.25)
    assert np.corrcoef(got, want)[0, 1] > 0.999
    assert _everett(2.0, 3.0, p, r, q, grid) == 0.0


def test_bouc_wen_against_an_ode_solver():
    u = np.r_[np.linspace(0, 6, 300), np.linspace(6, 2, 200)]
    beta, gamma, power = 0.5, 0.1, 1.3

    def slope(sign, h):  # dh / d|u|
        return sign - beta * h * abs(h) ** (power - 1) - sign * gamma * abs(h) ** power

    up = solve_ivp(lambda s, h: slope(1.0, h), (0, 6), [0.0], rtol=1e-9).y[0, -1]
    down = solve_ivp(lambda s, h: slope(-1.0, h), (0, 4), [up], rtol=1e-9).y[0, -1]
    got = _bouc_wen(u, beta, gamma, power)
    assert got[299] == pytest.approx(up, rel=1e-4)
    assert got[-1] == pytest.approx(down, rel=1e-4)


def test_slip_elements_do_not_depend_on_the_step_and_saturate():
    yields, strength = np.array([0.1, 1.0]), np.array([0.2, 0.5])
    u = np.r_[np.linspace(0, 9, 10), np.linspace(9, 1, 10)]
    coarse = _slip_bank(u, yields, strength, 1.5)
    fine = _slip_bank(np.interp(np.arange(381) / 20, np.arange(20), u), yields, strength, 1.5)
    np.testing.assert_allclose(coarse, fine[::20], atol=1e-12)
    assert 0.6 < coarse[9] < 0.7


@pytest.mark.parametrize("name", FOREIGN)
def test_hysteresis_is_foreign_to_plays_with_squares(name):
    rng = np.random.default_rng(8)
    u = proof_drives.multisine(rng, np.arange(8000) * DT, DT)
    left = RichBase([u], DT).residual(CLASSES[name](rng)(u))
    assert 5e-4 < np.std(left) < 0.15  # um: beyond rounding, far below the 1 um loop


def test_a_stage_in_the_class_is_not_foreign():
    rng = np.random.default_rng(8)
    u = proof_drives.multisine(rng, np.arange(8000) * DT, DT)
    left = RichBase([u], DT).residual(in_class(rng)(u))
    assert np.std(left) < 0.01  # um: a cubic, and thresholds between those of the base


def test_low_pass_and_delay_and_current_limit():
    ramp = np.arange(4000) * H
    tau = 0.01
    want = ramp - tau * (1 - np.exp(-ramp / tau))
    np.testing.assert_allclose(proof_effects.low_pass(ramp, tau, H), want, atol=1e-12)
    np.testing.assert_allclose(proof_effects.delayed(ramp, 3.3 * H, H)[10:], ramp[10:] - 3.3 * H)
    step = np.r_[np.zeros(10), np.full(500, 5.0)]
    slewed = MAKERS["slew"](np.random.default_rng(0), True, DT).run(step, world(step), 1 / 200.0)
    assert np.max(np.diff(slewed)) == pytest.approx(200.0 * H)
    assert slewed[-1] == pytest.approx(5.0)


def test_resonance_rings_at_its_frequency():
    step = np.r_[np.zeros(800), np.ones(8000)]
    effect = next(
        e for s in range(50)
        if (e := MAKERS["resonance"](np.random.default_rng(s), True, DT)).form == "whole stroke"
    )  # fmt: skip
    y = effect.run(step, world(step), 1 / 80.0)
    late = y[800:] - 1.0
    ups = np.flatnonzero((late[:-1] < 0) & (late[1:] >= 0))
    assert 1 / (np.mean(np.diff(ups[:4])) * H) == pytest.approx(80.0, rel=0.02)
    assert y.max() > 1.5


def test_log_creep_is_straight_over_decades():
    step = np.r_[np.zeros(8), np.ones(80_000)]
    effect = MAKERS["creep"](np.random.default_rng(0), True, DT)
    y = effect.run(step, world(step), 0.01)
    assert y[8 + 80 * 1000 - 1] - y[8 + 8000] == pytest.approx(
        0.01 * np.log10(10.1 / 1.1), rel=0.01
    )


@pytest.mark.parametrize("name", EVERY)
def test_every_effect_grows_with_its_strength_and_is_finite(name):
    u = grown_sine(40_000)
    effect = EVERY[name](np.random.default_rng(2), False, DT)
    w = world(u)
    sizes = [np.std(effect.run(u, w, f * effect.start) - u) for f in (0.5, 1.0)]
    assert all(np.isfinite(sizes))
    assert sizes[1] >= sizes[0]
    assert np.std(effect.run(u, w, effect.top) - u) > 0


def test_dahl_against_an_ode_solver_and_knows_only_the_way():
    x = np.r_[np.linspace(0, 0.3, 60), np.linspace(0.3, 0.1, 40)]
    length, power = 0.1, 1.5

    def slope(sign, z):  # dz / d|x|
        return sign * (1.0 - sign * z) ** power / length

    up = solve_ivp(lambda s, z: slope(1.0, z), (0, 0.3), [0.0], rtol=1e-9).y[0, -1]
    down = solve_ivp(lambda s, z: slope(-1.0, z), (0, 0.2), [up], rtol=1e-9).y[0, -1]
    z = _dahl(x, length, power)
    assert z[59] == pytest.approx(up, rel=1e-4)
    assert z[-1] == pytest.approx(down, rel=1e-4)
    fine = _dahl(np.interp(np.arange(991) / 10, np.arange(100), x), length, power)
    np.testing.assert_allclose(fine[::10], z, atol=1e-9)


def test_an_asymmetric_ceramic_bends_the_rising_branch_only():
    u = np.r_[np.linspace(0, 9, 900), np.linspace(9, 0, 900)]
    effect = SHAPES["asymmetric ceramic"](np.random.default_rng(1), False, DT)
    d = effect.run(np.zeros(u.size), world(u), 0.2)
    assert d[:900].min() < -0.05  # the loop opens: the rising branch lies lower
    assert np.abs(d[1400:]).max() < 1e-9


@pytest.mark.parametrize(("name", "share"), [("hum for a third", 0.33), ("slip", 0.5)])
def test_what_is_there_for_a_part_of_the_time(name, share):
    w = world(np.zeros(80_000))
    d = PARTED[name](np.random.default_rng(1), False, DT).run(np.zeros(w.t.size), w, 0.1)
    assert np.mean(np.abs(d) > 1e-9) == pytest.approx(share, abs=0.21)
    assert np.mean(d[: w.t.size // 10] == 0) == 1.0


def test_duhem_against_an_ode_solver():
    u = np.r_[np.linspace(0, 6, 300), np.linspace(6, 2, 200)]
    alpha, slope, bend, b = 0.6, 1.0, -0.01, 0.7

    def change(sign, v, w):  # dw / d|u|
        return alpha * (slope * v + bend * v * v - w) + sign * b

    up = solve_ivp(lambda v, w: change(1.0, v, w), (0, 6), [0.0], rtol=1e-9).y[0, -1]
    down = solve_ivp(lambda s, w: change(-1.0, 6 - s, w), (0, 4), [up], rtol=1e-9).y[0, -1]
    got = _duhem(u, alpha, slope, bend, b)
    assert got[299] == pytest.approx(up, rel=1e-4)
    assert got[-1] == pytest.approx(down, rel=1e-4)
