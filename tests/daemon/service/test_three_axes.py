"""`dehyst run` with three axes on one emulated amplifier, through its own commands; real processes.

The amplifier's own report is the evidence of the outputs.
"""

import contextlib
import io
import json
import os
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from tests.rigs.gateway_bench import free_port
from tests.rigs.processes import DTYPES, EmulatedBench, dehyst, until
from tests.rigs.stage_model import kept_model

from dehyst.daemon.bench.simulated import write_axes_bench
from dehyst.daemon.client.client import Refusal
from dehyst.daemon.client.group import Group
from dehyst.daemon.files.recordings import read_recording
from dehyst.daemon.main import main
from dehyst.daemon.rings.ring_file import RingFile
from dehyst.drivers.emulated.control import ask
from dehyst.models.errors import DehystError

SAFE_V = {"x": 5.0, "y": 10.0, "z": 5.0}
MORE = """
[safe]
voltage_v = 5.0
ramp_v_per_s = 200.0
on_fault = "ramp"
[setpoint]
stale_s = 1.0
hold_s = 0.5
[axis.y.safe]
voltage_v = 10.0
"""


class Stage:
    """An emulated bench and its supervisor."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.log = folder, folder / "run.txt"
        self.bench = EmulatedBench(folder, "--axes", "3")
        self.address = f"tcp/127.0.0.1:{free_port()}"
        models = dict.fromkeys("xyz", kept_model())
        self.config = write_axes_bench(
            folder, self.bench.ports, "stage-1", self.address, models, trim=False, rate_hz=50.0,
            more=MORE,
        )  # fmt: skip
        port = f'port = "{self.bench.ports["mdt693b"]}"\n'
        text = self.config.read_text()
        assert text.count(port) == 1
        self.config.write_text(text.replace(port, f"{port}timeout_s = 2.0\n"))
        self.supervisor: subprocess.Popen[str] | None = None

    def start(self) -> None:
        with open(self.log, "ab") as words:
            self.supervisor = dehyst(
                "run", "--config", str(self.config), stdout=words, stderr=words
            )
        try:
            until(lambda: "ready: clients reach" in self.words(), 120.0, "it is ready")
        except AssertionError as error:
            raise AssertionError(f"{error}; it said: {self.words()[-1500:]}") from None

    def words(self) -> str:
        return self.log.read_text(errors="replace") if self.log.exists() else ""

    def core_pid(self) -> int:
        with RingFile(self.folder / "y" / "telemetry.ring", DTYPES["telemetry"]) as ring:
            return ring.pid

    def outputs(self) -> dict[str, float]:
        found = ask(self.bench.ports["control"], {})["axes"]
        return {axis: float(state["output_v"]) for axis, state in found.items()}

    def safe(self) -> bool:
        return all(abs(self.outputs()[axis] - v) < 0.05 for axis, v in SAFE_V.items())

    def up(self, group: Group) -> bool:
        """Send every axis up, before its set-point goes stale; return whether all outputs are."""
        with contextlib.suppress(DehystError):
            group.send({"x": 9.0, "y": 8.0, "z": 7.0})
        return min(self.outputs().values()) > 40.0

    def group(self, axes: str = "xyz") -> Group:
        found: list[Group] = []

        def there() -> bool:
            try:
                group = Group("stage-1", list(axes), self.address)
            except DehystError:
                return False
            found.append(group)
            return all(status.state == "ready" for status in group.status().values())

        until(there, 120.0, f"the gateway\n{self.words()}")
        return found[-1]

    def run(self, *arguments: str) -> tuple[int, str, str]:
        """Run a command in this process; return (exit code, stdout, stderr)."""
        out, err = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            code = main([*arguments, "--to", "stage-1", "--connect", self.address])
        return code, out.getvalue(), err.getvalue()

    def close(self) -> None:
        if self.supervisor is not None and self.supervisor.poll() is None:
            self.supervisor.send_signal(signal.SIGTERM)
            self.supervisor.wait(60.0)
        self.bench.close()


@pytest.fixture(scope="module")
def stage(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stage]:
    stage = Stage(tmp_path_factory.mktemp("stage"))
    try:
        stage.start()
        yield stage
    finally:
        stage.close()


def test_it_says_its_axes_and_each_has_its_events(stage: Stage) -> None:
    words = stage.words()
    assert "clients reach stage-1-x, stage-1-y, stage-1-z at" in words
    for axis in "xyz":
        assert f" {axis}: the loop runs" in words
    code, out, _ = stage.run("status", "--json")
    found = json.loads(out)
    assert list(found["axes"]) == ["x", "y", "z"]
    assert code == (0 if found["ok"] else 1)
    assert stage.run("watch", "--list")[1].count("stage-1-") == 3


def test_a_file_with_two_axes_is_played_and_recorded(stage: Stage, tmp_path: Path) -> None:
    t_s = np.arange(0.0, 2.0, 0.02)
    x, y = 6.0 + np.sin(np.pi * t_s), 6.0 - np.cos(np.pi * t_s)
    path, rec = tmp_path / "way.csv", tmp_path / "rec.csv"
    rows = "".join(f"{a:.3f},{b:.9f},{c:.9f}\n" for a, b, c in zip(t_s, x, y, strict=True))
    path.write_text("t_s,target_x_um,target_y_um\n" + rows)
    recorder = dehyst("record", "-o", str(rec), "--connect", stage.address)
    until(lambda: (tmp_path / "rec-z.csv").exists(), 30.0, "it records")
    code, out, err = stage.run("play", str(path), "--json")
    result = json.loads(out)
    assert result["completed"], err
    assert list(result["axes"]) == ["x", "y"]
    for one in result["axes"].values():
        assert one["samples"] == one["expected_samples"] == 100
    assert code == 0
    assert stage.run("play", str(path), "--offset-um", "y=100")[0] == 2
    assert stage.run("play", str(path), "--offset-um", "1")[0] == 2
    recorder.send_signal(signal.SIGINT)
    recorder.communicate(timeout=60)
    table = read_recording(tmp_path / "rec-x.csv")
    other = read_recording(tmp_path / "rec-y.csv")
    # the channel of y in x's recording equals y's own recording, sample by sample
    beside = table.channels["axis.y"]
    assert other.displacement is not None
    assert np.array_equal(table.t_s, other.t_s)
    assert np.array_equal(beside, other.displacement, equal_nan=True)
    drive = table.channels["axis.y.drive"]
    assert np.array_equal(drive, other.drive, equal_nan=True)
    assert np.nanmax(np.abs(np.diff(drive))) > 1.0  # y has moved


def test_send_needs_to_know_which_axis(stage: Stage) -> None:
    assert stage.run("send", "4")[0] == 2
    code, _, err = stage.run("send", "x=6", "y=5")
    assert code == 0
    assert "stage-1-x: going to 6 um" in err
    assert "stage-1-y: going to 5 um" in err
    assert stage.run("send", "--stop")[0] == 0
    safe = lambda: all(abs(stage.outputs()[axis] - SAFE_V[axis]) < 0.05 for axis in "xy")  # noqa: E731
    until(safe, 30.0, "both outputs are safe")


def test_the_death_of_the_core_brings_every_output_to_its_own_safe_voltage(stage: Stage) -> None:
    with stage.group() as group:
        until(lambda: stage.up(group), 30.0, "all are up")
        pid = stage.core_pid()
        os.kill(pid, signal.SIGKILL)
        until(stage.safe, 60.0, f"all outputs are safe\n{stage.words()}")
        for axis, volts in SAFE_V.items():
            text = f"output of stage-1-{axis} at {volts:.3f} V"
            until(lambda text=text: text in stage.words(), 20.0, text)
        until(lambda: stage.core_pid() != pid, 120.0, "a new loop")
        with pytest.raises(Refusal):  # nothing that was commanded before resumes by itself
            group["x"].chunk(5, 3, np.array([0, 20_000_000]), np.array([6.0, 6.1]), True)


def test_an_end_as_asked_ramps_all_axes_and_ends_with_0(stage: Stage) -> None:
    with stage.group() as group:
        until(lambda: stage.up(group), 30.0, "all are up")
    assert stage.supervisor is not None
    stage.supervisor.send_signal(signal.SIGTERM)
    assert stage.supervisor.wait(60.0) == 0
    assert stage.outputs() == pytest.approx(SAFE_V, abs=0.05)
