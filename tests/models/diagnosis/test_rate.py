"""Loops that change with the rate: closed forms, and stages whose laws are not the library's."""

import numpy as np
import pytest
from tests.models.diagnosis.test_names import bouc_wen
from tests.rigs.diagnosis import diagnose_without_limits

from dehyst.models.cascade.simulate import simulate
from dehyst.models.diagnosis import Diagnosis
from dehyst.models.diagnosis.base import rich_base
from dehyst.models.diagnosis.data.prepare import prepare
from dehyst.models.diagnosis.fit import Problem
from dehyst.models.diagnosis.search_problem import choose_earlier_drive
from dehyst.models.model import Block, Hysteresis, Model, Validity
from dehyst.models.physics import list_candidates
from dehyst.models.recording import Recording

DT, NOISE_UM = 1e-3, 0.01


def wide_play(u: np.ndarray, half: np.ndarray) -> np.ndarray:
    """Run a play whose half width (N,) changes in time, sample by sample."""
    out, p = np.empty(u.size), float(u[0])
    for t, (v, r) in enumerate(zip(u.tolist(), half.tolist(), strict=True)):
        p = max(v - r, min(v + r, p))
        out[t] = p
    return out


def widening(u: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Add plays whose thresholds grow with the log of the speed; the library uses a power."""
    speed = np.abs(np.gradient(u, DT))
    speed = np.convolve(speed, np.exp(-np.arange(20) / 3.0) * 0.2835)[: u.size]
    for r in (0.15, 0.4, 0.8, 1.3):
        still = wide_play(u, np.full(u.size, r))
        y = y + 0.1 * (wide_play(u, r * (1.0 + 0.25 * np.log1p(speed / 10.0))) - still)
    return y


def fading(u: np.ndarray, y: np.ndarray, half: float = 0.06) -> np.ndarray:
    """Add friction, of 0.12 um if not stated, that decreases with the speed: loops are narrower at
    high speed."""
    speed = np.abs(np.gradient(y, DT))
    rubs = y - wide_play(y, np.full(u.size, half))
    return y - 2.0 * rubs * (0.3 + 0.7 * np.exp(-((speed / 40.0) ** 2)))


def recordings(law: object) -> list[Recording]:
    rng = np.random.default_rng(11)
    out = []
    for k in range(2):
        t = np.arange(8000) * DT
        lines = ((2.2, 0.7, 0.3), (1.0, 3.1, 1.0), (0.7, 11.0, 2.0), (0.3, 23.0, 0.1))
        u = sum(a * np.sin(2 * np.pi * f * (1 + 0.15 * k) * t + p + k) for a, f, p in lines)
        u = (5 + u * 4.5 / np.abs(u).max()) * np.clip(t / 0.4, 0, 1)
        y = law(u, bouc_wen(u)) + NOISE_UM * rng.standard_normal(t.size)  # type: ignore[operator]
        out.append(Recording(t, u, y, name=f"r{k}.csv"))
    return out


def diagnosed(law: object) -> Diagnosis:
    return diagnose_without_limits(recordings(law))


def test_loops_that_widen_are_reported_as_rate() -> None:
    d = diagnosed(widening)
    assert next(f.name for f in d.findings if f.name != "shape") == "rate"
    assert not {"lag", "delay", "resonance", "friction"} & {f.name for f in d.findings}


def test_loops_that_narrow_are_not_reported_as_rate() -> None:
    d = diagnosed(fading)
    assert next(f.name for f in d.findings if f.name != "shape") == "friction"
    assert "rate" not in {n for f in d.findings for n in (f.name, *f.ambiguous_with)}
    assert not any("one row before" in words for words in d.data.says)


@pytest.mark.parametrize("half_um", [0.1, 0.12])
def test_loops_that_narrow_are_no_recorder_that_is_a_row_off(half_um: float) -> None:
    """Readings and drive are of the same moments. Friction that fades looks early: a drive moved by
    a row leaves a third of the misfit, which is still many times the noise."""
    data = prepare(recordings(lambda u, y: fading(u, y, half_um)))
    problem = Problem(data, rich_base(data))
    moved = choose_earlier_drive(problem, problem.solve([]), NOISE_UM)
    assert moved is None


@pytest.mark.parametrize(
    ("weights", "together"),
    [((1.0, 0.5, 0.2, 0.0, 0.1), True), ((-1.0, -0.5, -0.2, 0.0, -0.1), False),
     ((-0.9, 0.5, -0.1, 0.3, 0.2), False), ((1.4, 0.7, -0.5, 0.2, -0.2), False),
     ((0.49, 0.12, -0.22, 0.89, 0.44), True)],
)  # fmt: skip
def test_loops_widen_with_the_rate_together(weights: tuple[float, ...], together: bool) -> None:
    t = np.arange(4000) * DT
    u = 5 - 4 * np.cos(2 * np.pi * t) + np.sin(60 * t)
    data = prepare([Recording(t, u, 1.1 * u, name="r.csv")])
    rate = next(c for c in list_candidates(data) if c.key == "rate")
    amplitudes = np.r_[weights, np.zeros(5)]
    assert (rate.implausible((0.5, 0.1), amplitudes, data) == "") == together


@pytest.mark.parametrize("power", [0.5, 1.0])
def test_a_dilating_play_lags_by_its_threshold_at_a_steady_rate(power: float) -> None:
    """Far from the turns of a triangle the play lags the drive by r + d |dv/dt|^p."""
    t, rate = np.arange(8000) * DT, 15.0  # v/s, over 0 to 10 V
    u = 10.0 - np.abs((rate * t) % 20.0 - 10.0)
    params: dict[str, float | tuple[float, ...]] = {
        "thresholds_v": (0.5,), "weights": (0.8,), "slopes": (0.0,), "dilation": 0.03,
        "power": power, "smoothing_s": 2e-3, "scale_v": 5.0, "center_v": 0.0,
    }  # fmt: skip
    straight = Hysteresis(r=np.zeros(1), b=np.ones(1), c=np.array([0.0, 1.0]))
    model = Model(straight, Validity(0.0, 10.0), blocks=(Block("rate", "stage", params),))
    added = simulate(model, t, u, {}) - u
    late = 0.8 * 0.03 * (rate / 5.0) ** power
    turned_back = (rate * t) % 20.0
    up, down = ((turned_back > a) & (turned_back < a + 4.0) & (t > 1.0) for a in (5.0, 15.0))
    np.testing.assert_allclose(added[up], -late, atol=1e-9)
    np.testing.assert_allclose(added[down], late, atol=1e-9)


@pytest.mark.parametrize(
    ("frequency", "damping", "rings"),
    [(300.0, 0.02, True), (300.0, 0.5, False), (1000.0, 0.007, False), (1010.0, 0.01, False),
     (850.0, 0.02, True), (1150.0, 0.02, True), (850.0, 0.1, False)],
)  # fmt: skip
def test_a_mode_rings_in_the_samples_or_is_none(
    frequency: float, damping: float, rings: bool
) -> None:
    """Sampled at 1 kHz, a mode at 1010 Hz appears at 10 Hz, and decays before one oscillation."""
    t = np.arange(4000) * DT
    u = 5 - 4 * np.cos(2 * np.pi * t)
    data = prepare([Recording(t, u, 1.1 * u, name="r.csv")])
    mode = next(c for c in list_candidates(data) if c.key == "resonance")
    assert (mode.implausible((frequency, damping, 1.0), np.zeros(0), data) == "") == rings
