"""The forward model, compared with the paper's own figures and a plain brute-force loop."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dehyst.models.cascade.simulate import simulate as simulate_model
from dehyst.models.hysteresis.forward import forward_step, initial_plays, simulate_hysteresis
from dehyst.models.hysteresis.play import play_matrix, play_step
from dehyst.models.model import Hysteresis
from dehyst.models.modelfile import shipped


def _brute_force(h: Hysteresis, u: np.ndarray, dt: float) -> np.ndarray:
    """Run Eq. 1, 3, 5 and 6 of the paper literally, one operator after the other."""
    out = np.zeros(u.size)
    state = [0.0] * h.n
    for t in range(u.size):
        rate = 0.0 if t == 0 else (u[t] - u[t - 1]) / dt
        z = 0.0
        for i in range(h.n):
            x = u[t] - h.u_offset
            state[i] = max(x - h.r[i], min(x + h.r[i], state[i]))
            z += (h.k[i] * rate + h.b[i]) * state[i]
        out[t] = sum(c * z**j for j, c in enumerate(h.c))
    return out


@pytest.mark.parametrize(("name", "at_ten_volts"), [("paper-eq11", 11.69), ("paper-eq12", 11.49)])
def test_paper_models_reach_the_stated_stroke(name: str, at_ten_volts: float) -> None:
    model = shipped(name).hysteresis
    y = simulate_hysteresis(model, np.linspace(0.0, 10.0, 1_000_001), 1.0)
    assert y[0] == 0.0
    assert y[-1] == pytest.approx(at_ten_volts, abs=0.005)


@pytest.mark.parametrize("name", ["paper-eq11", "paper-eq12"])
def test_forward_is_the_brute_force_loop(name: str) -> None:
    h = shipped(name).hysteresis
    t = np.arange(2000) * 1e-3
    u = 5 + 3 * np.sin(2 * np.pi * 5 * t - np.pi / 2) + 2 * np.sin(2 * np.pi * 10 * t - np.pi / 2)
    assert np.max(np.abs(simulate_hysteresis(h, u, 1e-3) - _brute_force(h, u, 1e-3))) < 1e-12


@settings(max_examples=40)
@given(st.integers(0, 100_000), st.integers(1, 14))
def test_random_models_are_the_brute_force_loop(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    h = Hysteresis(
        r=np.sort(rng.uniform(0, 5, n)),
        b=rng.normal(0, 0.3, n),
        k=rng.normal(0, 1e-4, n),
        c=np.append(rng.normal(0, 1, 2), rng.normal(0, 0.05, 2)),
        u_offset=rng.uniform(-5, 5),
    )
    u = rng.uniform(-5, 5, 150)
    want = _brute_force(h, u, 2e-3)
    scale = 1.0 + np.max(np.abs(want))
    assert np.max(np.abs(simulate_hysteresis(h, u, 2e-3) - want)) < 1e-12 * scale


def test_one_sample_form_gives_the_bits_of_the_array_form() -> None:
    h = shipped("paper-eq12").hysteresis
    u = np.random.default_rng(0).uniform(0, 10, 500)
    plays, y, before = np.zeros(h.n), [], u[0]
    for value in u:
        rate = (value - before) / 1e-3
        y.append(forward_step(h.r, h.b, h.k, h.c, h.u_offset, plays, value, rate))
        before = value
    assert np.array_equal(simulate_hysteresis(h, u, 1e-3), y)


def test_state_can_be_carried_over() -> None:
    h = shipped("paper-eq11").hysteresis
    u = 5 + 5 * np.sin(np.arange(400) * 0.05)
    plays = play_matrix(h.r, u[:200], np.zeros(h.n))[-1]
    kept = plays.copy()
    assert np.array_equal(
        simulate_hysteresis(h, u[200:], 1e-3, plays), simulate_hysteresis(h, u, 1e-3)[200:]
    )
    assert np.array_equal(plays, kept)


def test_initial_plays_stand_at_the_drive() -> None:
    h = shipped("paper-eq11").hysteresis
    assert np.array_equal(initial_plays(h, 2.0), np.maximum(2.0 - h.r, 0.0))


@settings(max_examples=50)
@given(st.lists(st.floats(-10, 10), min_size=1, max_size=40), st.floats(0, 5), st.floats(0, 5))
def test_play_stays_within_its_width_and_composes(u: list[float], r: float, s: float) -> None:
    """|H - u| <= r, and the play of width r + s is the play of width s on the play of width r."""
    widths = np.array([r, r + s])
    h, chained = np.zeros(2), np.zeros(1)
    for value in u:
        play_step(widths, h, value)
        play_step(np.array([s]), chained, h[0])
        assert abs(h[0] - value) <= r + 1e-12
        assert h[1] == pytest.approx(chained[0], abs=1e-12)


def test_cascade_without_blocks_is_the_hysteresis() -> None:
    model = shipped("paper-eq12")
    u = 5 + 4 * np.sin(np.arange(1000) * 0.02)
    a = simulate_model(model, 1e-3, u)
    assert np.allclose(a, simulate_hysteresis(model.hysteresis, u, 1e-3), atol=1e-9)
