"""`dehyst safe` with several axes: all at the same time, and none kept back by another."""

from pathlib import Path

import pytest

from dehyst.daemon.config import load_controller
from dehyst.daemon.service.safe_state import make_safe
from dehyst.drivers.interface import Actuator, DriverError
from dehyst.drivers.registry import load_actuator

CONFIG = """
name = "stage-1"
run_dir = "{folder}/run"
model = {{file = "paper-eq11"}}
limits = {{min_v = 0.0, max_v = 100.0, slew_v_per_s = 4000.0}}
safe = {{voltage_v = 3.0, ramp_v_per_s = 400.0, on_fault = "ramp"}}
sensor = {{driver = "simulated"}}
"""
AXIS = """
[axis.{axis}]
actuator = {actuator}
sensor = {{settings = {{stage = "{stage}-sensor"}}}}
{more}
"""


def axis(name: str, stage: str, more: str = "") -> str:
    actuator = f'{{driver = "simulated", settings = {{stage = "{stage}"}}}}'
    return AXIS.format(axis=name, actuator=actuator, stage=stage, more=more)


def amplifier(stage: str, volts: float) -> Actuator:
    """The simulated amplifier of this stage, its output at so many volts."""
    actuator = load_actuator("simulated").from_settings({"stage": stage})
    actuator.open()
    actuator.write(volts)
    return actuator


def test_every_axis_goes_to_its_own_safe_voltage_or_stays(tmp_path: Path) -> None:
    path = tmp_path / "stage.toml"
    held = '[axis.z.safe]\non_fault = "hold"\nvoltage_v = 9.0'
    text = axis("x", "safe-x") + axis("y", "safe-y", "[axis.y.safe]\nvoltage_v = 20.0")
    path.write_text(CONFIG.format(folder=tmp_path) + text + axis("z", "safe-z", held))
    before = {"safe-x": 60.0, "safe-y": 5.0, "safe-z": 33.0}
    amplifiers = [amplifier(stage, volts) for stage, volts in before.items()]
    found = make_safe(load_controller(path))
    assert found == {"stage-1-x": 3.0, "stage-1-y": 20.0, "stage-1-z": 33.0}
    assert [one.output() for one in amplifiers] == [3.0, 20.0, 33.0]


def test_an_axis_that_cannot_be_reached_keeps_no_other_from_its_safe_state(tmp_path: Path) -> None:
    path = tmp_path / "stage.toml"
    gone = f'{{driver = "mdt693b", settings = {{port = "{tmp_path}/none"}}}}'
    text = AXIS.format(axis="x", actuator=gone, stage="none", more="") + axis("y", "safe-left")
    path.write_text(CONFIG.format(folder=tmp_path) + text)
    left = amplifier("safe-left", 60.0)
    with pytest.raises(DriverError, match="stage-1-x: "):
        make_safe(load_controller(path))
    assert left.output() == 3.0
