"""The emulated bench with three axes and the real drivers: one amplifier, three gauges."""

import threading
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pytest

from dehyst.drivers.emulated.bench import Bench, BenchSettings
from dehyst.drivers.emulated.control import ask
from dehyst.drivers.emulated.mdt693b_knobs import Mdt693bKnobs
from dehyst.drivers.emulated.process import run_bench
from dehyst.drivers.interface import DeviceGone, DriverConfigError
from dehyst.drivers.ksg101 import Ksg101
from dehyst.drivers.mdt693b import Mdt693b
from dehyst.drivers.simulated.axes import settings_by_axis

PATIENCE_S = 20.0
QUIET = {"sensor_noise_um": 0.0, "creep_gain_per_decade": 0.0, "cross_share": 0.0}


class Axes(NamedTuple):
    """A served bench, its amplifier's axis y and all gauges."""

    ports: dict[str, str]
    amplifier: Mdt693b
    gauges: dict[str, Ksg101]

    def settled(self, volts: float) -> dict[str, float]:
        """Return the readings once the bench shows that y is at `volts` and no longer rings."""
        self.amplifier.write(volts)
        last_um, still = np.nan, 0
        while still < 20:
            y = ask(self.ports["control"], {"axis": "y"})
            there = abs(y["drive_v"] - volts) < 1e-3
            still = still + 1 if there and abs(y["displacement_um"] - last_um) < 1e-4 else 0
            last_um = y["displacement_um"]
        return {name: gauge.read() for name, gauge in self.gauges.items()}


@pytest.fixture(scope="module")
def axes(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Axes]:
    folder = tmp_path_factory.mktemp("bench")
    stages = settings_by_axis("xyz", dict.fromkeys("xyz", QUIET))
    settings = BenchSettings(
        stages.pop("x"), Mdt693bKnobs(latency_s=0.0, jitter_s=0.0), None, "x", stages
    )
    stop, ready = threading.Event(), threading.Event()
    made: list[Bench] = []
    ports: dict[str, str] = {}

    def on_ready(known: dict[str, str]) -> None:
        ports.update(known)
        ready.set()

    log = folder / "log.npz"
    thread = threading.Thread(
        target=run_bench, args=(folder / "b", settings, stop, on_ready, made.append, log)
    )
    thread.start()
    assert ready.wait(PATIENCE_S)
    amplifier = Mdt693b.from_settings({"port": ports["mdt693b"], "axis": "y"})
    gauges = {
        name: Ksg101.from_settings({"port": ports[f"ksg101-{name}"], "timeout_s": 1.0})
        for name in "xyz"
    }
    for device in (amplifier, *gauges.values()):
        device.open()
    yield Axes(ports, amplifier, gauges)
    for device in (amplifier, *gauges.values()):
        device.close()
    stop.set()
    made[0].amplifier.wake()
    thread.join()
    with np.load(log) as saved:
        assert saved["y_volts"].max() == pytest.approx(100.0, abs=3e-3)
        assert {"time_ns", "true_um", "y_reading_um", "z_reading_um"} <= set(saved.files)


def test_one_axis_moves_the_others_a_little(axes: Axes) -> None:
    before, after = axes.settled(0.0), axes.settled(100.0)
    moved = {name: after[name] - before[name] for name in before}
    own_um = ask(axes.ports["control"], {"axis": "y"})["displacement_um"]
    assert moved["y"] == pytest.approx(own_um, abs=5e-3)
    assert moved["y"] > 8.0
    assert moved["x"] == pytest.approx(0.025 * moved["y"], abs=5e-3)
    assert moved["z"] == pytest.approx(0.02 * moved["y"], abs=5e-3)


def test_a_fault_is_that_of_one_gauge(axes: Axes) -> None:
    control = axes.ports["control"]
    state = ask(control, {"fault": "unplug", "device": "ksg101", "axis": "y"})
    assert [state["axes"][name]["plugged"]["ksg101"] for name in "xyz"] == [True, False, True]
    with pytest.raises(DeviceGone):
        axes.gauges["y"].read()
    assert np.isfinite(axes.gauges["x"].read())
    ask(control, {"fault": "nan", "axis": "z"})
    assert np.isnan(axes.gauges["z"].read())
    assert np.isfinite(axes.gauges["x"].read())
    ask(control, {"clear": True})
    axes.gauges["y"].reconnect()
    assert np.isfinite([axes.gauges[name].read() for name in "yz"]).all()
    with pytest.raises(DriverConfigError, match="axis = 'a' must be one of x, y, z"):
        ask(control, {"axis": "a"})
