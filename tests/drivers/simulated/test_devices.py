"""The simulated actuator and sensor: contract, virtual and clocked time, sharing, faults."""

import gc
import math
from typing import Any

import numpy as np
import pytest

from dehyst.drivers.contract import ActuatorContract, SensorContract
from dehyst.drivers.interface import DriverConfigError
from dehyst.drivers.simulated.devices import (
    SimulatedActuator,
    SimulatedSensor,
    shared_stage,
)
from dehyst.drivers.simulated.settings import StageSettings
from dehyst.drivers.simulated.stage import SimulatedStage


class TestSimulatedActuator(ActuatorContract):
    def make(self) -> SimulatedActuator:
        return SimulatedActuator.from_settings({"stage": "actuator", "period_s": 0.001})

    def true_output(self, device: SimulatedActuator) -> float:
        device.shared.stage.advance(0.1)
        return device.shared.stage.drive_v

    def unplug(self, device: SimulatedActuator) -> None:
        device.shared.plugged = False

    def replug(self, device: SimulatedActuator) -> None:
        device.shared.plugged = True


class TestSimulatedSensor(SensorContract):
    tolerance = 0.2

    def make(self) -> SimulatedSensor:
        return SimulatedSensor.from_settings({"stage": "sensor", "origin_um": 3.0})

    def true_value(self, device: SimulatedSensor) -> float:
        return device.shared.stage.displacement_um

    def unplug(self, device: SimulatedSensor) -> None:
        device.shared.plugged = False

    def replug(self, device: SimulatedSensor) -> None:
        device.shared.plugged = True


def pair(stage: str, settings: dict[str, Any], **clock: Any) -> tuple:
    actuator = SimulatedActuator.from_settings({"stage": stage, **settings}, **clock)
    sensor = SimulatedSensor.from_settings({"stage": stage}, **clock)
    actuator.open()
    sensor.open()
    return actuator, sensor


def test_virtual_time_is_the_stage_itself() -> None:
    """Reading, then writing, once a period gives exactly what SimulatedStage.run gives."""
    actuator, sensor = pair("virtual", {"period_s": 1e-3, "seed": 7, "rc_tau_s": 1e-3})
    volts = 75 - 75 * np.cos(2 * np.pi * 5 * np.arange(300) * 1e-3)
    shown = []
    for v in volts:
        shown.append(sensor.read())
        actuator.write(v)
    stage = SimulatedStage(StageSettings(seed=7, rc_tau_s=1e-3))
    expected = []
    for v in volts:
        expected.append(stage.reading_um())
        stage.advance(1e-3, v)
    assert shown == expected


def test_clocked_time_is_the_clocks() -> None:
    now = [1_000_000_000]
    settings = {"rc_tau_s": 1e-3, "slew_v_per_s": 0.0, "dac_step_v": 0.0}
    actuator, sensor = pair("clocked", settings, clock_ns=lambda: now[0])
    actuator.write(100.0)
    now[0] += 2_000_000
    sensor.read()
    assert actuator.shared.stage.drive_v == pytest.approx(100 * (1 - math.exp(-2)))
    assert actuator.output() == 100.0


def test_both_tables_make_one_stage() -> None:
    actuator = SimulatedActuator.from_settings({"stage": "both", "stroke_um": 11.6})
    sensor = SimulatedSensor.from_settings({"stage": "both", "sensor_noise_um": 0.5})
    assert actuator.shared is sensor.shared
    assert sensor.shared.settings() == StageSettings(stroke_um=11.6, sensor_noise_um=0.5)
    with pytest.raises(DriverConfigError, match=r"stroke_um = 12\.0.*11\.6"):
        SimulatedSensor.from_settings({"stage": "both", "stroke_um": 12.0})
    sensor.open()
    sensor.read()
    with pytest.raises(DriverConfigError, match="mode_hz can no longer be set"):
        SimulatedActuator.from_settings({"stage": "both", "mode_hz": 100.0})


def test_a_stage_that_nobody_holds_is_forgotten() -> None:
    actuator, sensor = pair("forgotten", {"stroke_um": 5.0})
    actuator.close()
    sensor.close()
    again = SimulatedActuator.from_settings({"stage": "forgotten", "stroke_um": 6.0})
    assert again.shared is not actuator.shared
    del actuator, sensor, again
    gc.collect()
    assert shared_stage("forgotten").settings() == StageSettings()


def test_closing_and_opening_does_not_move_the_stage() -> None:
    actuator, sensor = pair("reopened", {"period_s": 1e-3})
    actuator.write(60.0)
    actuator.close()
    sensor.close()
    actuator, sensor = pair("reopened", {"period_s": 1e-3})
    assert actuator.output() == 60.0
    assert sensor.shared.stage.displacement_um > 3


def test_reading_faults() -> None:
    slept: list[float] = []
    actuator, sensor = pair("faulty", {}, clock_ns=lambda: 0, sleep=slept.append)
    stage = actuator.shared.stage
    stage.fault("nan")
    assert math.isnan(sensor.read())
    stage.fault("range")
    assert sensor.read() > sensor.spec.maximum
    stage.fault("late", late_s=0.02)
    sensor.read()
    assert slept == [0.02]


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"strok_um": 1.0}, "strok_um.*known.*stroke_um"),
        ({"period_s": -1.0}, "period_s"),
        ({"period_s": "1 ms"}, "period_s"),
        ({"stage": 3}, "stage"),
        ({"stroke_um": -1.0}, "stroke_um"),
        ({"max_v": 200.0}, "clip_max_v"),
        ({"min_v": 160.0}, "min_v"),
        ({"max_v": "x"}, "max_v"),
    ],
)
def test_wrong_settings_are_named(settings: dict, says: str) -> None:
    with pytest.raises(DriverConfigError, match=says):
        SimulatedActuator.from_settings({"stage": "wrong", **settings})
