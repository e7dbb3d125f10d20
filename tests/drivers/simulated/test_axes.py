"""A simulated stage with several axes: each its own, coupling both ways, a common time."""

import numpy as np
import pytest
from msgspec import structs
from tests.rigs.direct_calls import direct_of, read, write

from dehyst.drivers.interface import DeviceGone, DriverConfigError
from dehyst.drivers.simulated.axes import Platform
from dehyst.drivers.simulated.devices import SimulatedActuator, SimulatedSensor
from dehyst.drivers.simulated.settings import StageSettings
from dehyst.drivers.simulated.stage import SimulatedStage
from dehyst.drivers.simulated.tuning import TUNING

QUIET = {"sensor_noise_um": 0.0, "adc_step_um": 0.0}


def test_one_axis_is_the_stage_itself() -> None:
    """It agrees bit for bit, including the noise."""
    plain, one = (
        SimulatedStage(StageSettings(seed=3)),
        Platform({"x": StageSettings(seed=3)}).axes["x"],
    )
    for volts in 75.0 + 60.0 * np.sin(np.arange(200) * 0.1):
        plain.advance(2e-3, volts)
        one.advance(2e-3, volts)
        assert one.reading_um() == plain.reading_um()


def test_each_axis_moves_the_others_by_its_own_motion() -> None:
    settings = {
        "x": StageSettings(from_y=0.02, from_z=-0.01, **QUIET),
        "y": StageSettings(stroke_um=12.0, hysteresis_width=0.08, from_x=0.03, **QUIET),
        "z": StageSettings(stroke_um=8.0, **QUIET),
    }
    bench = Platform(settings)
    alone = dict.fromkeys(("from_x", "from_y", "from_z"), 0.0)
    lone = {name: SimulatedStage(structs.replace(s, **alone)) for name, s in settings.items()}
    for k in range(300):
        for name, phase in (("x", 0.0), ("y", 1.0), ("z", 2.0)):
            volts = 60.0 + 50.0 * np.sin(0.05 * k + phase)
            bench.axes[name].command(volts)
            lone[name].advance(2e-3, volts)
        bench.advance(2e-3)
    own = {name: stage.displacement_um for name, stage in lone.items()}
    got = {name: stage.displacement_um for name, stage in bench.axes.items()}
    assert got["x"] == pytest.approx(own["x"] + 0.02 * own["y"] - 0.01 * own["z"], abs=1e-3)
    assert got["y"] == pytest.approx(own["y"] + 0.03 * own["x"], abs=1e-3)
    assert got["z"] == pytest.approx(own["z"], abs=1e-5)
    assert abs(got["x"] - own["x"]) > 0.03


def test_the_platforms_mode_rings_at_its_frequency() -> None:
    """A step of y excites x by the step response of a mode of that frequency and damping, delayed
    by the time step at which the axes are coupled."""
    bench = Platform(
        {
            "x": StageSettings(
                from_y=0.1, cross_share=1.0, cross_hz=50.0, cross_damping=0.05, **QUIET
            ),
            "y": StageSettings().quiet(),
        }
    )
    x, y = bench.axes["x"], bench.axes["y"]
    y.command(75.0)
    t = np.arange(1, 400) * 5e-4
    seen = []
    for _ in t:
        bench.advance(5e-4)
        seen.append(x.displacement_um)
    w, damping = 2 * np.pi * 50.0, 0.05
    t -= TUNING.together_s
    wd = w * np.sqrt(1 - damping**2)
    swing = np.exp(-damping * w * t) * (np.cos(wd * t) + damping * w / wd * np.sin(wd * t))
    expected = 0.1 * y.displacement_um * (1.0 - swing)
    assert np.max(np.abs(seen - expected)) < 1e-3 * expected.max()


def test_noise_of_the_axes_is_their_own() -> None:
    bench = Platform({name: StageSettings() for name in "xyz"})
    shown = np.array([[stage.reading_um() for stage in bench.axes.values()] for _ in range(500)])
    assert np.max(np.abs(np.corrcoef(shown.T) - np.eye(3))) < 0.2


def test_a_long_rest_is_one_time_for_all() -> None:
    bench = Platform({"x": StageSettings(from_y=0.02), "y": StageSettings(from_x=0.02)})
    bench.axes["x"].command(50.0)
    bench.advance_to(10**9)
    bench.advance_to(10**9 + 3600 * 10**9)
    assert bench.axes["y"].time_s == pytest.approx(3600.0)
    assert bench.time_s == pytest.approx(3600.0)


def test_an_axis_does_not_couple_to_itself() -> None:
    with pytest.raises(DriverConfigError, match="from_y of axis y"):
        Platform({"y": StageSettings(from_y=0.1)})


def test_virtual_time_passes_when_all_axes_are_written() -> None:
    pairs = {}
    for name in "xy":
        settings = {"stage": "both axes", "axis": name, "period_s": 1e-3}
        pairs[name] = (
            SimulatedActuator.from_settings(settings),
            SimulatedSensor.from_settings(settings),
        )
        for device in pairs[name]:
            device.open()
    stage = pairs["x"][0].shared.stage
    for sample in range(5):
        pairs["x"][0].write(10.0 * sample)
        assert stage.time_s == pytest.approx(sample * 1e-3)
        pairs["y"][0].write(5.0 * sample)
        assert stage.time_s == pytest.approx((sample + 1) * 1e-3)
    pairs["x"][0].write(1.0)
    pairs["x"][0].write(2.0)  # written again before the other axis: its own sample is over
    assert stage.time_s == pytest.approx(6e-3)
    pairs["y"][0].write(2.0)
    assert "axis y" in pairs["y"][0].spec.identity
    pairs["y"][0].close()
    pairs["x"][0].write(1.0)  # the other amplifier is closed, so nothing waits for it
    assert stage.time_s == pytest.approx(8e-3)
    for device in (*pairs["x"], *pairs["y"]):
        device.close()


def test_compiled_calls_are_the_python_calls() -> None:
    """Two stages of one kind, one by C function, one by Python, give the same readings exactly."""
    shown = []
    for stage in ("by python", "by address"):
        pairs = {}
        for name, gain in (("x", "from_y"), ("y", "from_x")):
            settings = {"stage": stage, "axis": name, "period_s": 1e-3, gain: 0.03}
            pairs[name] = (
                SimulatedActuator.from_settings(settings),
                SimulatedSensor.from_settings(settings),
            )
            for device in pairs[name]:
                device.open()
        direct = {
            name: (direct_of(actuator), direct_of(sensor))
            for name, (actuator, sensor) in pairs.items()
        }
        rows = []
        for k in range(100):
            for name in "xy":
                volts = 75.0 + 70.0 * np.sin(0.2 * k + (name == "y"))
                actuator, sensor = pairs[name]
                if stage == "by python":
                    rows.append(sensor.read())
                    actuator.write(volts)
                else:
                    rows.append(read(direct[name][1]))
                    assert write(direct[name][0], volts) is None
        if stage == "by address":
            pairs["y"][1].shared.plugged = False
            assert isinstance(write(direct["y"][0], 0.0), DeviceGone)
            assert write(direct["x"][0], 0.0) is None
        shown.append(rows)
        for device in (*pairs["x"], *pairs["y"]):
            device.close()
    assert shown[0] == shown[1]


def test_axes_of_one_name_have_settings_of_their_own() -> None:
    x = SimulatedActuator.from_settings({"stage": "own", "stroke_um": 10.0, "from_y": 0.02})
    y = SimulatedActuator.from_settings({"stage": "own", "axis": "y", "stroke_um": 5.0})
    for device in (x, y):
        device.open()
        device.write(150.0)
    x.shared.plugged = False
    assert y.shared.plugged
    x.shared.stage.advance(0.5)
    assert y.shared.stage.displacement_um == pytest.approx(5.0, rel=0.05)
    assert x.shared.stage.displacement_um == pytest.approx(10.1, rel=0.05)
    with pytest.raises(DriverConfigError, match="period_s"):
        SimulatedActuator.from_settings({"stage": "own", "axis": "z", "period_s": 1e-3})
