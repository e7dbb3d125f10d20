"""A core process of several axes, on the simulated stage and on the emulated MDT693B."""

import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from tests.rigs.processes import PATIENT, EmulatedBench, Rings, core, until
from tests.rigs.two_loops import model

from dehyst.daemon.files.models import save_model
from dehyst.daemon.rings.records import COMMAND, LoopCommand, State
from dehyst.drivers.emulated.control import ask

COMMON = """
name = "test"
run_dir = "{run}"
[loop]
rate_hz = {rate}
[model]
file = "{model}"
[limits]
min_v = 0.0
max_v = 150.0
slew_v_per_s = 4000.0
[safe]
voltage_v = 5.0
ramp_v_per_s = 200.0
[setpoint]
stale_s = 30.0
[trim]
enabled = false
"""


class Running(NamedTuple):
    """A core and the rings of each axis."""

    folder: Path
    rings: dict[str, Rings]
    ports: dict[str, str]

    def goes_to(self, axis: str, um: float) -> None:
        """Send an axis a set-point and wait until its model predicts that it was reached."""
        rings = self.rings[axis]
        rings.drive(um, lambda last: abs(last["predicted"] - um) < 0.2, 30.0)

    def states(self) -> dict[str, State | None]:
        return {axis: rings.state() for axis, rings in self.rings.items()}

    def volts(self) -> dict[str, float]:
        return {axis: float(rings.last()["volts"]) for axis, rings in self.rings.items()}


def begun(folder: Path, rate: float, more: str) -> Path:
    save_model(model(), folder / "model.toml")
    text = COMMON.format(run=folder / "run", rate=rate, model=folder / "model.toml")
    (folder / "config.toml").write_text(text + more)
    return folder / "config.toml"


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    folder = tmp_path_factory.mktemp("simulated")
    more = ""
    for axis in "xy":
        device = f'driver = "simulated", settings = {{stage = "{axis}"}}'
        more += f"[axis.{axis}]\nactuator = {{{device}}}\nsensor = {{{device}}}\n"
    with core(begun(folder, 500.0, more), "x"):
        yield Running(folder, {axis: Rings(folder, axis) for axis in "xy"}, {})


def test_one_process_runs_two_axes_in_the_same_samples(simulated: Running) -> None:
    simulated.goes_to("y", 6.0)
    x, y = (simulated.rings[axis].read("telemetry")[-2000:] for axis in "xy")
    shared = np.intersect1d(x["seq"], y["seq"])
    assert shared.size > 100
    np.testing.assert_array_equal(
        x["scheduled_ns"][np.isin(x["seq"], shared)], y["scheduled_ns"][np.isin(y["seq"], shared)]
    )
    # nobody commands x
    assert (x["volts"] == x["volts"][0]).all()
    assert simulated.states() == {"x": State.READY, "y": State.RUNNING}
    statuses = [simulated.rings[axis].last("status") for axis in "xy"]
    assert statuses[0]["pid"] == statuses[1]["pid"]
    for axis in "xy":
        assert "compiled loop" in simulated.rings[axis].events()
        assert list((simulated.folder / "run" / axis).glob("model-*.toml"))


@pytest.fixture(scope="module")
def serial(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    folder = tmp_path_factory.mktemp("serial")
    bench = EmulatedBench(folder, "--axes", "3")
    port = bench.ports["mdt693b"]
    more = f'[actuator]\ndriver = "mdt693b"\nsettings = {{port = "{port}", {PATIENT}}}\n'
    for axis in "xyz":
        port = bench.ports[f"ksg101-{axis}"]
        more += (
            f'[axis.{axis}]\nactuator.settings.axis = "{axis}"\n'
            f'sensor = {{driver = "ksg101", settings = {{port = "{port}", {PATIENT}}}}}\n'
        )
    try:
        with core(begun(folder, 50.0, more), "x"):
            yield Running(folder, {axis: Rings(folder, axis) for axis in "xyz"}, bench.ports)
    finally:
        bench.close()


def together(um: float) -> np.ndarray:
    batch = np.zeros(1, COMMAND)
    batch["kind"], batch["value"] = LoopCommand.SETPOINT, um
    return batch


def test_three_outputs_of_one_amplifier_are_set_in_one_command(serial: Running) -> None:
    for axis, um in (("x", 4.0), ("y", 6.0), ("z", 8.0)):
        serial.goes_to(axis, um)
    for axis, volts in serial.volts().items():
        state = ask(serial.ports["control"], {"axis": axis})
        assert state["output_v"] == pytest.approx(volts, abs=0.05)
    before = ask(serial.ports["control"], {})["sets_of_all"]
    until(lambda: ask(serial.ports["control"], {})["sets_of_all"] > before + 5, 20.0, "one command")


def test_a_dead_gauge_is_its_own_axis_affair(serial: Running) -> None:
    for axis, um in (("x", 4.0), ("y", 6.0), ("z", 8.0)):
        serial.goes_to(axis, um)
    ask(serial.ports["control"], {"fault": "unplug", "device": "ksg101", "axis": "y"})
    until(lambda: np.isnan(serial.rings["y"].last()["measured"]), 20.0, "y has no reading")
    serial.goes_to("y", 5.0)  # open loop
    assert set(serial.states().values()) == {State.RUNNING}
    assert np.isfinite(serial.rings["x"].last()["measured"])
    ask(serial.ports["control"], {"clear": True})
    until(lambda: np.isfinite(serial.rings["y"].last()["measured"]), 20.0, "y has a reading")


def test_a_dead_amplifier_faults_all_axes_and_nothing_moves(serial: Running) -> None:
    for axis, um in (("x", 4.0), ("y", 6.0)):
        serial.goes_to(axis, um)
    serial.rings["z"].command(LoopCommand.RELEASE)
    until(lambda: serial.states()["z"] is State.READY, 20.0, "z is at rest")
    stood = {a: ask(serial.ports["control"], {"axis": a})["output_v"] for a in "xyz"}
    ask(serial.ports["control"], {"fault": "unplug"})
    until(lambda: set(serial.states().values()) == {State.FAULT}, 20.0, "all faulted")
    ask(serial.ports["control"], {"clear": True})
    until(lambda: State.FAULT not in serial.states().values(), 40.0, "all are back")
    time.sleep(0.3)
    now = {a: ask(serial.ports["control"], {"axis": a})["output_v"] for a in "xyz"}
    assert now == pytest.approx(stood, abs=0.01)
    serial.goes_to("x", 5.0)
    assert "the link to the unit was lost" in "".join(r.events() for r in serial.rings.values())
