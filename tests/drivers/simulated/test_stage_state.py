"""The stage as an object: seeds, noise, both ways of running it, changes and faults."""

import math

import numpy as np
import pytest

from dehyst.drivers.interface import DriverConfigError
from dehyst.drivers.settings import read_settings
from dehyst.drivers.simulated.settings import STAGE_KEYS, StageSettings
from dehyst.drivers.simulated.stage import SimulatedStage

T = np.arange(600) * 1e-3
VOLTS = 75 - 75 * np.cos(2 * np.pi * 3 * T)


def test_run_is_the_same_as_step_by_step() -> None:
    settings = StageSettings(sensor_delay_s=2e-3, hum_um=0.05, rate_per_decade=0.05)
    whole = SimulatedStage(settings).run(T, VOLTS)
    stage = SimulatedStage(settings)
    true_um, shown_um = np.empty(T.size), np.empty(T.size)
    for n, volts in enumerate(VOLTS):
        if n:
            stage.advance(T[n] - T[n - 1])
        true_um[n], shown_um[n] = stage.displacement_um, stage.reading_um()
        stage.command(volts)
    np.testing.assert_array_equal(true_um, whole[0])
    np.testing.assert_array_equal(shown_um, whole[1])


def test_seed_repeats_and_differs() -> None:
    first, again, other = (SimulatedStage(StageSettings(seed=s)).run(T, VOLTS) for s in (5, 5, 6))
    np.testing.assert_array_equal(first[1], again[1])
    assert not np.array_equal(first[1], other[1])
    np.testing.assert_array_equal(first[0], other[0])


def test_noise_is_white_normal_and_as_large_as_asked() -> None:
    stage = SimulatedStage(StageSettings().quiet(sensor_noise_um=0.02))
    noise = np.array([stage.reading_um() for _ in range(20_000)])
    assert noise.std() == pytest.approx(0.02, rel=0.03)
    assert abs(noise.mean()) < 0.0006
    assert np.mean(np.abs(noise) < 0.02) == pytest.approx(0.6827, abs=0.012)
    assert abs(np.corrcoef(noise[:-1], noise[1:])[0, 1]) < 0.025
    assert 3.3 < np.abs(noise).max() / 0.02 < 5.5


def test_advance_to_follows_a_clock() -> None:
    stage = SimulatedStage(StageSettings().quiet(rc_tau_s=1e-3))
    stage.advance_to(5_000_000_000, 100.0)  # the origin of time
    stage.advance_to(5_001_000_000)
    assert stage.drive_v == pytest.approx(100 * (1 - math.exp(-1)))
    stage.advance_to(4_000_000_000)  # a time in the past does not advance it
    assert stage.time_s == pytest.approx(1e-3)


def test_settle_ends_at_rest() -> None:
    stage = SimulatedStage()
    stage.settle(80.0)
    before = stage.displacement_um
    stage.advance(0.1)
    assert stage.displacement_um == pytest.approx(before, abs=0.002)
    assert stage.drive_v == pytest.approx(80.0, abs=0.002)


@pytest.mark.parametrize(
    "change",
    [
        {"stroke_um": 14.0},
        {"creep_gain_per_decade": 0.05},
        {"mode_hz": 300.0, "mode_share": 0.8},
        {"hysteresis_width": 0.06},
        {"sensor_delay_s": 0.004, "sensor_tau_s": 0.001},
        {"gain_per_k": 0.01, "drift_um_per_s": 0.1},
        {"friction_um": 0.1},
    ],
)
def test_change_at_run_time_does_not_jump(change: dict[str, float]) -> None:
    stage = SimulatedStage(StageSettings(sensor_noise_um=0.0))
    stage.run(T, VOLTS)
    stage.set_inputs(temperature_k=2.0)
    stage.advance(0.5)
    before = stage.displacement_um
    shown = stage.reading_um()
    stage.change(**change)
    assert stage.displacement_um == pytest.approx(before, abs=1e-12)
    assert stage.reading_um() == pytest.approx(shown, abs=1e-3)
    stage.advance(1e-3)
    assert stage.displacement_um == pytest.approx(before, abs=0.005)


def test_change_acts_from_then_on() -> None:
    stage = SimulatedStage(StageSettings().quiet())
    stage.advance(1e-3, 75.0)
    stage.change(stroke_um=8.7)
    stage.advance(1e-3, 150.0)
    assert stage.displacement_um == pytest.approx(8.7 + 4.35)
    jumping = SimulatedStage(StageSettings().quiet())
    jumping.advance(1e-3, 75.0)
    jumping.change(jump=True, stroke_um=8.7)
    assert jumping.displacement_um == pytest.approx(4.35)


def test_faults_of_the_reading() -> None:
    stage = SimulatedStage()
    stage.advance(0.01, 50.0)
    last = stage.reading_um()
    stage.fault("stuck", for_s=0.05)
    stage.advance(0.02, 100.0)
    assert stage.reading_um() == last
    stage.advance(0.04)
    assert stage.reading_um() > last + 1
    stage.fault("nan")
    assert math.isnan(stage.reading_um())
    stage.fault("range")
    assert stage.reading_um() > 60
    stage.fault("late", late_s=0.02)
    assert stage.late_s == 0.02
    assert stage.reading_um() == pytest.approx(stage.displacement_um, abs=0.2)
    stage.clear_fault()
    assert stage.late_s == 0.0
    with pytest.raises(DriverConfigError, match="stuck, nan, range, late"):
        stage.fault("smoke")


@pytest.mark.parametrize(
    ("table", "says"),
    [
        ({"strok_um": 1.0}, "strok_um.*known.*stroke_um"),
        ({"stroke_um": 0.0}, "stroke_um"),
        ({"mode_damping": 1.0}, "mode_damping"),
        ({"rc_tau_s": -1.0}, "rc_tau_s"),
        ({"rc_tau_s": math.nan}, "rc_tau_s"),
        ({"clip_min_v": 200.0}, "clip_min_v"),
        ({"seed": 1.5}, "seed"),
        ({"full_scale_v": "150"}, "full_scale_v"),
    ],
)
def test_wrong_settings_are_named(table: dict, says: str) -> None:
    with pytest.raises(DriverConfigError, match=says):
        read_settings(StageSettings, table)
    assert set(table) - {"strok_um"} <= set(STAGE_KEYS)


IMPOSSIBLE = {
    "a voltage that is no number": lambda stage: stage.command(math.nan),
    "an infinite voltage": lambda stage: stage.advance(1e-3, math.inf),
    "backwards in time": lambda stage: stage.advance(-1.0),
    "times that stand still": lambda stage: stage.run(np.array([0.0, 0.0]), np.zeros(2)),
    "times without voltages": lambda stage: stage.run(np.array([0.0, 1.0]), np.zeros(3)),
}


@pytest.mark.parametrize("name", IMPOSSIBLE)
def test_impossible_commands_are_refused(name: str) -> None:
    with pytest.raises(DriverConfigError, match="stage"):
        IMPOSSIBLE[name](SimulatedStage())
