"""A mode is inverted exactly if it carries a part of the stroke, otherwise led by derivatives."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import StateSpace, cont2discrete

from dehyst.models.inverse.compensator import Compensator, CompensatorState
from dehyst.models.model import Block, Hysteresis, Model, Validity
from dehyst.models.physics import resonance

DT = 5e-3


def plain(hertz: float, damping: float, share: float) -> Model:
    """Return 0.1 um/V with a mode."""
    block = Block("resonance", "stage", {"frequency_hz": hertz, "damping": damping, "share": share})
    return Model(Hysteresis([0.0], [0.1], [0.0, 1.0]), Validity(0.0, 150.0), blocks=(block,))


def run(model: Model, target: np.ndarray, limit: float = 1e9) -> np.ndarray:
    """Return drives (N,) for targets; the voltage before them is at rest."""
    c = Compensator(model, DT, 0.0, 150.0, limit)
    state: CompensatorState = c.init(10.0 * float(target[0]))
    drives = []
    for i in range(target.size):
        window = target[i : i + c.window_samples]
        c.step(state, window, window.size, np.zeros(0))
        c.applied(state, state.drive)
        drives.append(state.drive)
    return np.array(drives)


def moved(drives: np.ndarray, hertz: float, damping: float, share: float) -> np.ndarray:
    """Return the stage's motion by scipy's first-order hold, from rest at the first drive."""
    w = 2 * np.pi * hertz
    a, b = [[0.0, 1.0], [-w * w, -2 * damping * w]], [[0.0], [w * w]]
    mode = StateSpace(a, b, [[share, 0.0]], [[1.0 - share]])
    ad, bd, cd, dd, _ = cont2discrete((mode.A, mode.B, mode.C, mode.D), DT, "foh")
    x, out = np.zeros(2), []
    for value in 0.1 * (drives - drives[0]):  # scipy's state already holds a part of the input
        out.append(float((cd @ x + dd[:, 0] * value)[0]))
        x = ad @ x + bd[:, 0] * value
    return 0.1 * drives[0] + np.array(out)


def smooth(seconds: float = 4.0) -> np.ndarray:
    """Return sines of 2 and 8 Hz about 7 um that begin at rest."""
    t = np.arange(round(seconds / DT)) * DT
    begin = np.clip(t / 0.5, 0.0, 1.0) ** 2 * (3 - 2 * np.clip(t / 0.5, 0.0, 1.0))
    return 7.0 + begin * (2.0 * np.sin(2 * np.pi * 2 * t) + 0.7 * np.sin(2 * np.pi * 8 * t))


@pytest.mark.parametrize(("hertz", "damping"), [(11.0, 0.2), (12.0, 0.14), (15.0, 0.1)])
def test_a_mode_beside_other_stroke_is_undone_exactly(hertz: float, damping: float) -> None:
    target = smooth()
    drives = run(plain(hertz, damping, 0.8), target)
    reached = moved(drives, hertz, damping, 0.8)
    bare = moved(10.0 * target, hertz, damping, 0.8)
    assert np.abs(bare - target).max() > 0.2
    assert np.abs(reached - target).max() < 1e-9


@pytest.mark.parametrize("limit", [400.0, 4000.0])
def test_a_step_that_the_slew_rate_takes_from_ends_at_rest(limit: float) -> None:
    """3 um in a sample ask for 100 V, the limit allows 2 or 20: the missing part rings like the
    mode, and has decayed after 2 s (exp(-2 pi 12 0.14 2) = 7e-10); so has the drive's."""
    target = np.r_[np.full(100, 5.0), np.full(700, 8.0)]
    drives = run(plain(12.0, 0.14, 0.8), target, limit)
    assert np.abs(np.diff(drives)).max() <= limit * DT * (1 + 1e-9)
    assert np.abs(np.diff(drives)[-200:]).max() < 1e-4
    assert np.abs(moved(drives, 12.0, 0.14, 0.8)[-200:] - 8.0).max() < 1e-5


def test_a_mode_that_carries_all_of_it_is_led() -> None:
    """Its sampled form has a zero outside the unit circle: the exact inverse's drive would grow."""
    target = smooth()
    drives = run(plain(12.0, 0.14, 1.0), target)
    assert 0.0 < drives.min() < drives.max() < 150.0
    off = np.abs(moved(drives, 12.0, 0.14, 1.0) - target)
    assert off.max() < 0.1 * np.abs(moved(10.0 * target, 12.0, 0.14, 1.0) - target).max()


@settings(max_examples=60, deadline=None)
@given(
    ratio=st.floats(1e-3, 2.0),
    damping=st.floats(1e-4, 2.0),
    share=st.floats(0.0, 1.0),
    held=st.booleans(),
    seed=st.integers(0, 99),
)
def test_where_it_is_undone_exactly_no_target_makes_it_grow(
    ratio: float, damping: float, share: float, held: bool, seed: int
) -> None:
    """ratio: frequency times the period. White targets of 1: bounded by what rings in 0.5 s."""
    dt = 1e-2
    p = np.array([ratio / dt, damping, share, held * dt])
    if not resonance.KIND.inverse.is_solved(p, dt):  # type: ignore[union-attr]
        return
    state = np.zeros(24)
    solve, step = resonance.KIND.inverse.solve, resonance.KIND.step  # type: ignore[union-attr]
    there = np.zeros(24)
    for target in np.random.default_rng(seed).normal(size=2000):
        x = solve(p, state, target, dt=dt)
        assert abs(x) < 1e5
        assert step(p, there, x, dt=dt) == pytest.approx(target, abs=1e-6)
