"""The emulated bench with the real drivers, in this process and as `dehyst emulate`."""

import json
import math
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from tests.rigs.command_line import exit_status
from tests.rigs.processes import until

from dehyst.drivers.emulated.bench import Bench, BenchSettings
from dehyst.drivers.emulated.control import ask
from dehyst.drivers.emulated.mdt693b_knobs import Mdt693bKnobs
from dehyst.drivers.emulated.process import run_bench
from dehyst.drivers.interface import DeviceGone, DeviceTimeout, DriverConfigError, DriverError
from dehyst.drivers.ksg101 import Ksg101
from dehyst.drivers.mdt693b import Mdt693b
from dehyst.drivers.simulated.settings import StageSettings

PATIENCE_S = 20.0


class Rig:
    """A served bench and open drivers."""

    def __init__(self, folder: Path, log: Path | None = None, **stage: float) -> None:
        knobs = Mdt693bKnobs(latency_s=0.0, jitter_s=0.0, start_v=20.0)
        settings = BenchSettings(StageSettings(**stage), knobs)  # type: ignore[arg-type]
        self.stop = threading.Event()
        self.bench: Bench
        ready = threading.Event()

        def on_ready(ports: dict[str, str]) -> None:
            self.ports = ports
            ready.set()

        def on_started(bench: Bench) -> None:
            self.bench = bench

        self.thread = threading.Thread(
            target=run_bench, args=(folder, settings, self.stop, on_ready, on_started, log)
        )
        self.thread.start()
        assert ready.wait(PATIENCE_S)
        self.amplifier = Mdt693b.from_settings({"port": self.ports["mdt693b"], "timeout_s": 2.0})
        self.gauge = Ksg101.from_settings({"port": self.ports["ksg101"], "timeout_s": 1.0})
        self.amplifier.open()
        self.gauge.open()

    def ask(self, **command: object) -> dict:
        return ask(self.ports["control"], command, PATIENCE_S)

    def close(self) -> None:
        self.amplifier.close()
        self.gauge.close()
        self.stop.set()
        self.bench.amplifier.wake()
        self.thread.join()


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[Rig]:
    made = Rig(tmp_path / "bench")
    yield made
    made.close()


def test_volts_in_micrometres_out(rig: Rig) -> None:
    start_um = rig.gauge.read()
    assert 1.0 < start_um < 3.0  # the amplifier recalled 20 V, where the stage has settled
    rig.amplifier.write(150.0)
    until(lambda: rig.ask()["drive_v"] > 149.99)
    # the step rings for some hundredths of a second
    until(lambda: abs(rig.gauge.read() - rig.ask()["displacement_um"]) < 0.1)
    assert rig.gauge.read() == pytest.approx(17.4, abs=0.4)
    rig.amplifier.write(20.0)
    until(lambda: rig.ask()["drive_v"] < 20.01)
    assert rig.gauge.read() > start_um + 0.5  # hysteresis


def test_unplug_keeps_the_output_and_comes_back(rig: Rig) -> None:
    rig.amplifier.write(80.0)
    state = rig.ask(fault="unplug", device="both")
    assert state["plugged"] == {"mdt693b": False, "ksg101": False}
    with pytest.raises(DriverError):
        rig.amplifier.write(90.0)
    with pytest.raises(DeviceGone):
        rig.gauge.read()
    assert rig.ask()["output_v"] == pytest.approx(80.0, abs=0.003)
    assert rig.ask(clear=True)["plugged"] == {"mdt693b": True, "ksg101": True}
    rig.amplifier.reconnect()
    rig.gauge.reconnect()
    assert rig.amplifier.output() == pytest.approx(80.0, abs=0.003)
    rig.amplifier.write(81.0)
    assert rig.ask()["output_v"] == pytest.approx(81.0, abs=0.003)


def test_timed_unplug_ends_by_itself(rig: Rig) -> None:
    assert not rig.ask(fault="unplug", for_s=0.05)["plugged"]["mdt693b"]
    until(lambda: bool(rig.ask()["plugged"]["mdt693b"]))


def test_gauge_faults(rig: Rig) -> None:
    rig.ask(fault="nan")
    assert math.isnan(rig.gauge.read())
    rig.ask(fault="range")
    assert math.isnan(rig.gauge.read())
    rig.ask(clear=True, fault="stuck")
    first = [rig.gauge.read() for _ in range(5)]
    assert len(set(first)) == 1
    rig.ask(clear=True)
    assert len({rig.gauge.read() for _ in range(5)}) > 1
    rig.ask(gauge={"mute": True})
    with pytest.raises(DeviceTimeout):
        rig.gauge.read()
    rig.ask(clear=True)
    assert rig.gauge.read() > 0


def test_amplifier_faults(rig: Rig) -> None:
    rig.ask(amplifier={"hang": True}, for_s=4.0)
    with pytest.raises(DriverError):
        rig.amplifier.write(30.0)
    until(lambda: not rig.bench.amplifier.unit.faults.hang)
    rig.amplifier.reconnect()
    rig.amplifier.write(31.0)
    assert rig.ask()["output_v"] == pytest.approx(31.0, abs=0.003)


def test_the_stage_changes_without_a_jump(rig: Rig) -> None:
    before = rig.ask()["displacement_um"]
    after = rig.ask(stage={"stroke_um": 12.0, "sensor_noise_um": 0.0})["displacement_um"]
    assert after == pytest.approx(before, abs=0.01)
    rig.ask(inputs={"ext_v": 2.0})  # 30 V on top of the 20
    until(lambda: rig.ask()["drive_v"] > 49.9)
    assert rig.ask()["displacement_um"] - after == pytest.approx(12.0 * 0.2, rel=0.25)


@pytest.mark.parametrize(
    ("command", "says"),
    [
        ({"falt": "unplug"}, "falt"),
        (
            {"fault": "smoke"},
            'fault = .smoke. must be "late", "nan", "range", "stall", "stuck" or "unplug"',
        ),
        (
            {"fault": "unplug", "device": "stage"},
            'device = .stage. must be "both", "bpc303", "kpc101", "kpz101", "ksg101" or "mdt693b"',
        ),
        ({"stage": {"strok_um": 1.0}}, "strok_um"),
        ({"amplifier": {"smoke": True}}, "mdt693b's faults: unknown setting 'smoke'"),
        ({"gauge": 3}, "gauge"),
        ({"inputs": {"force_n": 1.0}}, "force_n"),
        ({"save": True}, "without a log"),
    ],
)
def test_wrong_commands_are_answered(rig: Rig, command: dict, says: str) -> None:
    with pytest.raises(DriverConfigError, match=says):
        rig.ask(**command)


def test_history_of_the_output(tmp_path: Path) -> None:
    log = tmp_path / "history.npz"
    rig = Rig(tmp_path / "bench", log, sensor_noise_um=0.0)
    for volts in (20.0, 40.0, 60.0):
        rig.amplifier.write(volts)
        rig.gauge.read()
    rig.close()
    with np.load(log) as saved:
        np.testing.assert_allclose(saved["volts"][-2:], [40.0, 60.0], atol=0.003)
        assert np.all(np.diff(saved["time_ns"]) > 0)
        assert saved["reading_um"].size == saved["true_um"].size >= 3
    with pytest.raises(DriverConfigError, match=r"npz or \.csv"):
        run_bench(
            tmp_path, BenchSettings(), threading.Event(), lambda p: None, log=tmp_path / "h.txt"
        )


def test_nobody_answers(tmp_path: Path) -> None:
    with pytest.raises(DeviceTimeout, match="no emulated bench"):
        ask(tmp_path / "control", {})


def test_emulate_as_a_process(tmp_path: Path) -> None:
    log = tmp_path / "out.csv"
    command = [sys.executable, "-m", "dehyst.daemon.main", "emulate", "--dir", str(tmp_path / "b")]
    command += ["--dialect", "1.05", "--log", str(log), "--stage", "stroke_um=11.6"]
    environment = {k: v for k, v in os.environ.items() if k != "DEHYST_SUPERVISED"}
    with subprocess.Popen(command, stdout=subprocess.PIPE, env=environment) as process:
        assert process.stdout is not None
        ports = json.loads(process.stdout.readline())
        amplifier = Mdt693b.from_settings({"port": ports["mdt693b"], "timeout_s": 2.0})
        amplifier.open()
        assert "legacy" in amplifier.spec.identity
        amplifier.write(50.0)
        amplifier.close()
        assert ask(ports["control"], {})["output_v"] == pytest.approx(50.0, abs=0.003)
        process.send_signal(signal.SIGTERM)
        assert process.wait(PATIENCE_S) == 0
    last = log.read_text().splitlines()[-1]
    assert float(last.split(",")[1]) == pytest.approx(50.0, abs=0.003)
    assert not list((tmp_path / "b").iterdir())


@pytest.mark.parametrize(
    "words",
    [
        ["--stage", "stroke_um"],
        ["--stage", "strok_um=1"],
        ["--stage", "stroke_um=-1"],
        ["--stage", "y.stroke_um=10"],
        ["--axes", "2", "--axis", "y"],
        ["--axes", "2", "--stage", "x.from_x=0.1"],
        ["--latency-s", "-1"],
        ["--start-v", "200"],
        ["--max-travel-um", "0"],
        ["--log", "/nowhere/x.npz"],
        ["--dir", "/dev/null/x"],
    ],
)
def test_emulate_refuses_in_one_line(words: list[str], capsys: pytest.CaptureFixture) -> None:
    assert exit_status(["emulate", *words]) == 2
    assert capsys.readouterr().err.count("\n") == 1
