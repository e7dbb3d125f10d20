"""`dehyst safe` with several axes: all of them ramp at the same time, and none delays another."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from dehyst.daemon import clock
from dehyst.daemon.config import Config, load_controller
from dehyst.daemon.loop.checks import past_output
from dehyst.daemon.rings.records import TELEMETRY
from dehyst.daemon.rings.ring import Ring
from dehyst.daemon.service.pin import pin_units
from dehyst.daemon.service.safe_state import NOTE_S, SHORTEST_PERIOD_S, make_safe
from dehyst.drivers.interface import Actuator, DriverError, UnitIdentity
from dehyst.drivers.mdt693b import Mdt693b
from dehyst.drivers.python_object import PythonActuator
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
    """Return the simulated amplifier of this stage, with its output at `volts`."""
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


@pytest.fixture
def waits(monkeypatch: pytest.MonkeyPatch) -> list[Callable[[], None]]:
    """Waiting takes no time and advances the clock. Functions that are added run at the next
    wait."""
    passed, happens = [0], list[Callable[[], None]]()

    def sleep_s(seconds: float) -> None:
        passed[0] += round(seconds * 1e9)
        now = happens.copy()
        happens.clear()  # what these add is for the next wait
        for one in now:
            one()

    monkeypatch.setattr(clock, "sleep_s", sleep_s)
    monkeypatch.setattr(clock, "monotonic_ns", lambda: time.monotonic_ns() + passed[0])
    return happens


def test_an_amplifier_that_fails_on_the_way_is_tried_again(
    tmp_path: Path, waits: list[Callable[[], None]]
) -> None:
    path = tmp_path / "stage.toml"
    path.write_text(CONFIG.format(folder=tmp_path) + axis("x", "safe-again") + axis("y", "safe-on"))
    again, on = amplifier("safe-again", 60.0), amplifier("safe-on", 60.0)
    stage = again.shared  # type: ignore[attr-defined]

    def unplug() -> None:
        stage.plugged = False
        waits.append(lambda: waits.append(plug_in))

    def plug_in() -> None:
        assert 3.0 < again.output() < 60.0
        stage.plugged = True

    waits.append(unplug)
    assert make_safe(load_controller(path)) == {"stage-1-x": 3.0, "stage-1-y": 3.0}
    assert (again.output(), on.output()) == (3.0, 3.0)


@pytest.mark.usefixtures("waits")
def test_an_axis_that_cannot_be_reached_keeps_no_other_from_its_safe_state(tmp_path: Path) -> None:
    path = tmp_path / "stage.toml"
    gone = f'{{driver = "mdt693b", settings = {{port = "{tmp_path}/none"}}}}'
    text = AXIS.format(axis="x", actuator=gone, stage="none", more="") + axis("y", "safe-left")
    path.write_text(CONFIG.format(folder=tmp_path) + text)
    left = amplifier("safe-left", 60.0)
    with pytest.raises(DriverError, match="stage-1-x: "):
        make_safe(load_controller(path))
    assert left.output() == 3.0


RAMP_V_PER_S = 400.0
BLIND = """
actuator = {driver = "python", settings = {object = "%s:Blind", write = "write", max_v = 100.0, \
    initial_v = 0.0, max_rate_hz = 500.0}}
"""


class Blind:
    """An amplifier that cannot report its output. The first write below `late_v` fails; whether it
    is `taken` all the same, its user cannot know."""

    written: ClassVar[list[float]] = []
    late_v, taken = -1.0, True

    def write(self, volts: float) -> None:
        late = volts < Blind.late_v
        if Blind.taken or not late:
            Blind.written.append(volts)
        if late:
            Blind.late_v = -1.0
            raise TimeoutError("late")


@pytest.fixture
def blind(tmp_path: Path) -> Path:
    """The configuration of a blind amplifier whose loop died at 50 V."""
    path = tmp_path / "stage.toml"
    head, limits, rest = CONFIG.format(folder=tmp_path).partition("limits")
    path.write_text(head + BLIND.strip() % __name__ + "\n" + limits + rest)
    (config,) = load_controller(path).axes
    config.directory.mkdir(parents=True)
    ring = Ring.create(config.directory / "telemetry.ring", TELEMETRY, 64)
    records = np.zeros(3, TELEMETRY)
    records["volts"] = 50.0
    ring.push_many(records)
    Blind.written[:], Blind.late_v, Blind.taken = [50.0], -1.0, True
    return path


def believed(config: Config) -> float:
    """Return the output that the next core believes in."""
    actuator = PythonActuator.from_settings(config.actuator.settings)
    actuator.open()
    try:
        return float(past_output(config, actuator.output(), actuator)[0][-1])
    finally:
        actuator.close()


@pytest.mark.usefixtures("waits")
@pytest.mark.parametrize("taken", [True, False])
def test_a_blind_output_is_ramped_on_from_where_it_failed(blind: Path, taken: bool) -> None:
    Blind.late_v, Blind.taken = 20.0, taken
    assert make_safe(load_controller(blind)) == {"stage-1": 3.0}
    assert Blind.late_v == -1.0  # a write has failed
    steps_v = np.abs(np.diff(Blind.written))
    assert steps_v.max() <= RAMP_V_PER_S * SHORTEST_PERIOD_S + 1e-9
    assert Blind.written[-1] == 3.0


@pytest.mark.usefixtures("waits")
def test_the_next_core_believes_in_what_safe_left(blind: Path) -> None:
    controller = load_controller(blind)
    (config,) = controller.axes
    assert believed(config) == 50.0
    make_safe(controller)
    assert believed(config) == 3.0
    unit = Mdt693b.from_settings({"port": "/dev/null"})
    unit.unit = UnitIdentity("", "MDT693B firmware 1.05", "usb-1")
    past, said = past_output(config, 3.2, unit)  # not ForeignUnit, as without a serial number
    assert (past[-1], said) == (3.0, [])


def test_killed_at_any_step_it_leaves_a_note_of_where_the_output_is(
    blind: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    controller = load_controller(blind)
    apart_v: list[float] = []

    def write(_: Blind, volts: float) -> None:
        apart_v.append(abs(believed(controller.axes[0]) - Blind.written[-1]))  # if it ended here
        Blind.written.append(volts)

    monkeypatch.setattr(Blind, "write", write)
    make_safe(controller)
    step_v = RAMP_V_PER_S * SHORTEST_PERIOD_S
    assert len(apart_v) >= 20
    assert max(apart_v) <= RAMP_V_PER_S * NOTE_S + step_v


@pytest.mark.usefixtures("waits")
def test_pin_forgets_what_safe_left(blind: Path) -> None:
    controller = load_controller(blind)
    make_safe(controller)
    pin_units(controller, blind)
    assert believed(controller.axes[0]) == 0.0  # initial_v
