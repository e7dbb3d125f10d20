"""The stage's hysteresis and creep: a plain loop, widths of real stacks, the logarithmic law."""

import numpy as np
import pytest

from dehyst.drivers.interface import DriverConfigError
from dehyst.drivers.simulated import maxwell_slip
from dehyst.drivers.simulated.settings import StageSettings
from dehyst.drivers.simulated.stage import SimulatedStage

ONLY = StageSettings().quiet(hysteresis_width=0.12, asymmetry=0.15)


def plain(slip: maxwell_slip.Slip, asymmetry: float, x: np.ndarray) -> np.ndarray:
    """Run Maxwell-slip by its definition, element by element and without numba."""
    out = []
    stretch = [0.0] * len(slip.d)
    before = 0.0
    for now in x:
        force = 0.0
        for i, (d, k, a) in enumerate(zip(slip.d, slip.k, slip.bow, strict=True)):
            moved = ((1 - a) * now + a * now**2) - ((1 - a) * before + a * before**2)
            stretch[i] += moved
            if stretch[i] > d:
                stretch[i] = d
            if stretch[i] < -d:
                stretch[i] = -d
            force += k * stretch[i]
        q = (now - force) / slip.norm
        out.append((np.exp(asymmetry * q) - 1) / (np.exp(asymmetry) - 1))
        before = now
    return np.array(out)


def test_against_a_plain_loop() -> None:
    stage = SimulatedStage(ONLY)
    t = np.arange(400) * 1e-3
    rng = np.random.default_rng(3)
    volts = np.clip(75 + np.cumsum(rng.normal(0, 12, t.size)), 0, 150)
    true_um, _ = stage.run(t, volts)
    expected = 17.4 * plain(maxwell_slip.build(0.12, 0.15), 0.15, volts[:-1] / 150)
    np.testing.assert_allclose(true_um[1:], expected, atol=1e-11)


def loop_width(low: float, high: float) -> float:
    """Return the greatest width of the second full loop between two voltages over its stroke."""
    up = np.linspace(low, high, 300)
    volts = np.concatenate([up, up[::-1], up, up[::-1], [0.0]])
    true_um, _ = SimulatedStage(ONLY).run(np.arange(volts.size) * 1e-3, volts)
    true_um = true_um[1:]
    rise, fall = true_um[600:900], true_um[900:1200][::-1]
    return float(np.max(fall - rise) / (rise[-1] - rise[0]))


def test_loop_widths_of_a_real_stack() -> None:
    assert loop_width(0, 150) == pytest.approx(0.12, abs=0.002)
    assert 0.10 < loop_width(0, 150) < 0.15
    assert loop_width(67.5, 82.5) == pytest.approx(0.025, abs=0.01)  # a tenth of the range
    # minor loops depend on their position, which no Prandtl-Ishlinskii model gives
    assert loop_width(130, 145) > 1.15 * loop_width(67.5, 82.5)


def test_stroke_of_a_pzs001() -> None:
    stage = SimulatedStage(ONLY)
    stage.advance(1e-3, 100.0)
    assert 9.6 < stage.displacement_um < 13.6  # 11.6 +- 2 um
    stage.advance(1e-3, 150.0)
    assert stage.displacement_um == pytest.approx(17.4)


@pytest.mark.parametrize("scale", [(3.6, 50.0, 0.0), (10.0, 11.6, -4.0)])
def test_scale_and_origin(scale: tuple[float, float, float]) -> None:
    volts, stroke, origin = scale
    stage = SimulatedStage(ONLY.quiet(full_scale_v=volts, stroke_um=stroke, origin_um=origin))
    assert stage.displacement_um == origin
    stage.advance(1e-3, volts)
    assert stage.displacement_um == pytest.approx(origin + stroke)


def test_rate_independent_unless_asked() -> None:
    up = np.linspace(0, 150, 500)
    volts = np.concatenate([up, up[::-1], up, up[::-1]])

    def width(period_s: float, rate: float) -> float:
        stage = SimulatedStage(ONLY.quiet(hysteresis_width=0.12, rate_per_decade=rate))
        y, _ = stage.run(np.arange(volts.size) * period_s / 1000, volts, straight=True)
        return float(np.max(y[1500:][::-1] - y[1000:1500]) / 17.4)

    assert width(10.0, 0.0) == pytest.approx(width(0.1, 0.0), abs=1e-12)
    assert width(0.1, 0.2) > 1.1 * width(10.0, 0.2)


def test_too_wide_a_loop_is_refused() -> None:
    with pytest.raises(DriverConfigError, match="hysteresis_width"):
        StageSettings(hysteresis_width=0.5)


def test_creep_follows_the_logarithmic_law() -> None:
    gain = 0.015
    stage = SimulatedStage(StageSettings().quiet(creep_gain_per_decade=gain))
    t = np.concatenate([[0.0], np.geomspace(0.05, 2000.0, 120)])
    y, _ = stage.run(t, np.full(t.size, 100.0))
    expected = 11.6 * (1 + gain * np.log10(t[1:] / 0.1))
    assert np.abs(y[1:] - expected).max() < 0.06 * gain * 11.6  # 6 % of the creep in one decade
    assert y[np.searchsorted(t, 0.1)] == pytest.approx(11.6, rel=5e-4)


def test_creep_after_a_step_down_goes_down() -> None:
    stage = SimulatedStage(StageSettings().quiet(creep_gain_per_decade=0.015))
    stage.settle(100.0, rest_s=1000.0)
    stage.advance(0.1, 50.0)
    early = stage.displacement_um
    stage.advance(10.0)
    assert stage.displacement_um - early == pytest.approx(-5.8 * 0.015 * 2, rel=0.15)
