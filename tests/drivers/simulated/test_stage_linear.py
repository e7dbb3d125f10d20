"""The stage's linear parts, compared with closed forms and scipy's simulation of the circuit."""

import math

import numpy as np
import pytest
from scipy import signal

from dehyst.drivers.simulated.settings import StageSettings
from dehyst.drivers.simulated.stage import SimulatedStage

LINEAR = StageSettings(full_scale_v=100.0, stroke_um=10.0).quiet()


def with_(**settings: float) -> SimulatedStage:
    return SimulatedStage(LINEAR.quiet(**settings))


def test_quiet_stage_is_a_straight_line() -> None:
    stage = with_()
    t = np.arange(200) * 1e-3
    volts = np.random.default_rng(0).uniform(0, 100, t.size)
    true_um, shown_um = stage.run(t, volts)
    np.testing.assert_allclose(true_um[1:], volts[:-1] * 0.1, atol=1e-12)
    np.testing.assert_array_equal(true_um, shown_um)


@pytest.mark.parametrize("dt_s", [1e-5, 1e-4, 1e-3, 3e-2])
def test_rc_step_response(dt_s: float) -> None:
    tau = 210e-6
    stage = with_(rc_tau_s=tau)
    stage.command(80.0)
    for n in range(1, 20):
        stage.advance(dt_s)
        expected = 80.0 * -math.expm1(-n * dt_s / tau)
        assert stage.drive_v == pytest.approx(expected, abs=2e-8)


def test_slew_then_rc() -> None:
    """A ramp through a first-order lag, in closed form, and the hold after it."""
    tau, slew = 200e-6, 40e3
    stage = with_(rc_tau_s=tau, slew_v_per_s=slew)
    stage.command(100.0)  # the ramp lasts 2.5 ms
    for n in range(1, 100):
        stage.advance(7e-5)
        t = n * 7e-5
        ramp = min(t, 2.5e-3)
        end = slew * (ramp - tau * -math.expm1(-ramp / tau))
        expected = 100.0 + (end - 100.0) * math.exp(-(t - ramp) / tau) if t > 2.5e-3 else end
        assert stage.drive_v == pytest.approx(expected, abs=1e-7)


def test_clip_holds_and_says_so() -> None:
    stage = with_(clip_min_v=-5.0, clip_max_v=90.0, ext_gain=10.0)
    stage.set_inputs(ext_v=2.0)
    stage.advance(1e-3, 60.0)
    assert stage.drive_v == pytest.approx(80.0)
    stage.advance(1e-3, 85.0)
    assert stage.drive_v == 90.0


def test_dac_step_rounds_to_the_nearest() -> None:
    stage = with_(dac_step_v=0.5)
    for command, output in ((10.2, 10.0), (10.3, 10.5), (-0.2, 0.0)):
        stage.advance(1e-3, command)
        assert stage.drive_v == pytest.approx(output)


def reference(stage: StageSettings, t: np.ndarray, volts: np.ndarray, fine: int) -> np.ndarray:
    """Return RC, mode with a share, and sensor filter as one transfer function, by scipy."""
    w = 2 * math.pi * stage.mode_hz
    second = np.array([1.0, 2 * stage.mode_damping * w, w * w])
    numerator = (1 - stage.mode_share) * second
    numerator[-1] += stage.mode_share * w * w
    denominator = np.polymul(second, [stage.rc_tau_s, 1.0])
    denominator = np.polymul(denominator, [stage.sensor_tau_s, 1.0])
    fine_t = np.linspace(t[0], t[-1], (t.size - 1) * fine + 1)
    held = np.repeat(volts, fine)[: fine_t.size] * stage.stroke_um / stage.full_scale_v
    _, y, _ = signal.lsim((numerator, denominator), held, fine_t, interp=False)
    return y[::fine]


@pytest.mark.parametrize("dt_s", [1e-3, 1.3e-4])
def test_rc_mode_and_bridge_against_lsim(dt_s: float) -> None:
    settings = LINEAR.quiet(
        rc_tau_s=210e-6, mode_hz=700.0, mode_damping=0.02, mode_share=0.6, sensor_tau_s=150e-6
    )
    t = np.arange(150) * dt_s
    volts = np.where(np.arange(t.size) % 37 < 18, 60.0, 10.0)
    volts[-40:] = 30.0
    _, shown = SimulatedStage(settings).run(t, volts)
    expected = reference(settings, t, volts, 200)
    assert np.abs(shown - expected).max() < 0.004 * 6.0  # of the largest step, 6 um
    assert np.sqrt(np.mean((shown - expected) ** 2)) < 0.008


def test_sub_steps_do_not_change_the_answer() -> None:
    """The same 0.3 s are run in steps of 10 ms and of 0.1 ms."""
    coarse, fine = SimulatedStage(), SimulatedStage()
    for n in range(30):
        volts = 40.0 if n % 10 < 5 else 90.0
        coarse.advance(1e-2, volts)
        for _ in range(100):
            fine.advance(1e-4, volts)
        assert coarse.displacement_um == pytest.approx(fine.displacement_um, abs=2e-4)


def test_long_rest_is_one_step_and_stable() -> None:
    stage = SimulatedStage()
    stage.advance(1.0, 100.0)
    before = stage.displacement_um
    stage.advance(86400.0)
    grown = stage.displacement_um / before - 1
    # 0.012 per decade over log10(86401); the operator ends at 3e4 s
    assert grown == pytest.approx(0.012 * math.log10(3e4), rel=0.15)


def test_sensor_delay_and_filter() -> None:
    stage = with_(sensor_delay_s=3e-3)
    t = np.arange(400) * 1e-4
    volts = 50 + 40 * np.sin(2 * np.pi * 30 * t)
    true_um, shown_um = stage.run(t, volts, straight=True)
    np.testing.assert_allclose(shown_um[40:], true_um[10:-30], atol=0.01)


def test_sensor_static_errors() -> None:
    stage = with_(sensor_gain=1.1, sensor_offset_um=0.4, sensor_bow=0.01, adc_step_um=0.25)
    stage.advance(1e-3, 50.0)
    assert stage.reading_um() == pytest.approx(round((1.1 * (5.0 + 0.1) + 0.4) / 0.25) * 0.25)


def test_additive_effects() -> None:
    settings = LINEAR.quiet(
        gain_per_k=0.01,
        expansion_um_per_k=0.2,
        drift_um_per_s=0.1,
        coupling_um_per_v=0.002,
        hum_um=0.05,
        hum_hz=50.0,
        origin_um=7.0,
    )
    t = np.arange(1000) * 1e-3
    warm, other = np.linspace(0, 3, t.size), 50 + 50 * np.sin(3 * t)
    true_um, _ = SimulatedStage(settings).run(
        t, np.full(t.size, 40.0), temperature_k=warm, other_v=other
    )
    now, before = slice(1, None), slice(None, -1)
    expected = 7.0 + 4.0 * (1 + 0.01 * warm[before]) + 0.2 * warm[before] + 0.1 * t[now]
    expected += 0.002 * other[before] + 0.05 * np.sin(2 * np.pi * 50 * t[now])
    np.testing.assert_allclose(true_um[now], expected, atol=1e-9)


def test_friction_sticks_after_a_turn() -> None:
    stage = with_(friction_um=0.2)
    t = np.arange(101) * 1e-3
    volts = np.concatenate([np.arange(51), 49 - np.arange(50)]).astype(float)
    true_um, _ = stage.run(t, volts)
    np.testing.assert_allclose(true_um[10:51], volts[9:50] * 0.1 - 0.2, atol=1e-12)
    assert np.ptp(true_um[51:55]) == pytest.approx(0.0, abs=1e-12)  # 0.4 um of travel: stuck
    np.testing.assert_allclose(true_um[60:], volts[59:-1] * 0.1 + 0.2, atol=1e-12)
