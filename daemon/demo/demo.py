"""First part of `dehyst demo`: a user's own steps, with the user's own commands."""

import json
import os
import signal
import socket
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dehyst.daemon import clock
from dehyst.daemon.acquire.one_axis import acquire
from dehyst.daemon.bench.simulated import FULL_SCALE_V, RATE_HZ, exploring_drive, write_bench
from dehyst.daemon.client.client import Client
from dehyst.daemon.config import load_config
from dehyst.daemon.demo.busy import IT_WAS_NOT, MOST_LATE, SO_IT_WAS, TOO_BUSY, Patience
from dehyst.daemon.files.models import load_model, save_model
from dehyst.daemon.files.outputs import whole_file
from dehyst.daemon.files.recordings import read_recording, write_recording
from dehyst.daemon.service.supervisor import DEHYST, BenchProcess
from dehyst.models.errors import DehystError
from dehyst.models.model import Hysteresis, Model, Validity
from dehyst.models.recording import Recording

if TYPE_CHECKING:
    from dehyst.daemon.demo.second_act import Story

SWEEP_HZ = 0.3  # the recorded sine runs from 0.7 to 1.3 Hz: two rates show rate-dependence
CYCLES = 6
STROKE_SHARE = 0.94  # of the reachable range; the remainder is margin at both ends
SECOND_SHARE = 0.9  # the same in the second part
CLEARLY_LESS = 0.5  # of the linear error: late samples, which add to both, do not account for this
START_S, COMMAND_S, END_S = 240.0, 240.0, 60.0
"""Time limits on a quiet machine: the daemon's start (with a cold cache, the kernels are compiled
first), a command, and the end of a command that was asked to stop."""


def free_port() -> int:
    """Return a TCP port on the loopback interface on which nobody listens."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class Demo:
    """One run. folder: scratch; output: files that the user keeps."""

    def __init__(self, folder: Path, output: Path, say: Callable[[str], None]) -> None:
        self.folder, self.output, self.say = folder, output, say
        self.endpoint = f"tcp/127.0.0.1:{free_port()}"
        self.rate_hz = RATE_HZ
        self.stroke_um = 0.0
        self.late_share = 0.0  # of the samples in the worse run
        self.tracks: dict[str, Recording] = {}
        self._children: list[subprocess.Popen[bytes]] = []
        say("1. an emulated MDT693B and KSG101 with a simulated stage")
        self._bench = BenchProcess(folder, [])
        ports = self._bench.ports  # no trim: shows feed-forward alone
        self._config = write_bench(folder, ports, "demo", self.endpoint, None, trim=False)

    def excite_and_record(self, progress: Callable[[float], None]) -> None:
        """Drive the stage open loop through the serial drivers."""
        t_s, volts = exploring_drive(sweep=SWEEP_HZ)
        self.say(f"2. exercise it, drive it open loop for {t_s[-1]:.0f} s over serial, and record")
        recording, ended = acquire(load_config(self._config), t_s, volts, "v", progress=progress)
        if ended:
            raise DehystError(f"the recording ended early: {ended}")
        assert recording.displacement is not None
        write_recording(
            self.output / "recording.csv",
            recording.t_s,
            {"u_v": recording.drive, "y_um": recording.displacement},
            {"source": "dehyst demo, simulated stage"},
        )

    def identify(self) -> None:
        """Run `dehyst identify`, and fit a straight line to the same recording."""
        self.say("3. identify a model from that recording")
        path = self.output / "recording.csv"
        self._dehyst("identify", str(path), "-o", str(self.output / "model.toml"), "--json")
        recording = read_recording(path)
        assert recording.displacement is not None
        good = ~(recording.missing_drive | recording.missing_displacement)
        gain, offset = np.polyfit(recording.drive[good], recording.displacement[good], 1)
        self._linear = Model(
            Hysteresis(r=np.zeros(1), b=np.ones(1), c=np.array([offset, gain])),
            Validity(0.0, FULL_SCALE_V),
        )

    def track(self) -> dict[str, float]:
        """Run the daemon and play a sine with each model; return rms tracking errors by name
        [um]."""
        model = load_model(self.output / "model.toml")
        from dehyst.daemon.config.drives import drive_range
        from dehyst.models.cascade.reach import displacement_range

        save_model(self._linear, self.folder / "model.toml")
        low, high = displacement_range(model, *drive_range(load_config(self._config), model))
        middle, half = 0.5 * (low + high), 0.5 * (high - low) * STROKE_SHARE
        self.stroke_um = 2 * half
        t_s = np.arange(round(CYCLES * self.rate_hz) + 1) / self.rate_hz
        trajectory = self.output / "trajectory.csv"
        write_recording(trajectory, t_s, {"target_um": middle - half * np.cos(2 * np.pi * t_s)}, {})
        self.say("4. run the daemon with a linear gain; a client streams a 1 Hz sine to it")
        core = self._start("core", "--config", str(self._config))
        self._start("gateway", "--config", str(self._config))
        self._ready()
        results = {"linear gain": self._play("linear", trajectory)}
        self.say("5. give it the identified model (SIGHUP), and play the same again")
        save_model(model, self.folder / "model.toml")
        core.send_signal(signal.SIGHUP)
        clock.sleep_s(1.0)
        results["compensated"] = self._play("compensated", trajectory)
        return results

    def second_act(self, seed: int | None) -> "Story":
        """Change the stage while it runs, and let the service find out. Uses a separate daemon with
        the identified model and a doctor."""
        from dehyst.daemon.config.drives import drive_range
        from dehyst.daemon.demo.chance import Chance
        from dehyst.daemon.demo.second_act import LEARN_S, SETTINGS, SecondAct, pattern
        from dehyst.models.cascade.reach import displacement_range

        self._end_children()
        folder = self.folder / "second"
        folder.mkdir()
        self.endpoint = f"tcp/127.0.0.1:{free_port()}"
        model = load_model(self.output / "model.toml")
        ports = self._bench.ports
        config = write_bench(folder, ports, "demo", self.endpoint, model, more=SETTINGS)
        low, high = displacement_range(model, *drive_range(load_config(config), model))
        middle, half = 0.5 * (low + high), 0.5 * (high - low) * SECOND_SHARE
        t_s, target = pattern(middle, half, self.rate_hz)
        trajectory = folder / "trajectory.csv"
        write_recording(trajectory, t_s, {"target_um": target}, {})
        self.say(f"6. second part: the watch learns the stage, {LEARN_S:.0f} s of motion")
        for command in ("core", "gateway", "doctor"):
            self._start(command, "--config", str(config))
        self._ready()
        self._start("play", str(trajectory), "--repeat", "0", "--connect", self.endpoint)
        return SecondAct(self.endpoint, Chance(seed, ports["control"]), self.say).run()

    def _ready(self) -> None:
        """Wait until the daemon answers and its loop runs."""
        patience = Patience(START_S, "for the daemon to start", self.say)
        while not patience.over:
            try:
                with Client(connect=self.endpoint) as client:
                    while not patience.over:
                        status = client.status()
                        if status.core_alive and status.state != "start":
                            return
                        clock.sleep_s(0.2)
                        patience.look()
            except DehystError:
                clock.sleep_s(0.2)
            patience.look()
        raise DehystError(f"the daemon did not start within {patience.spent_s:.0f} s")

    def _play(self, name: str, trajectory: Path) -> float:
        """Stream the trajectory from a separate process while another records; return the rms error
        [um]."""
        path = self.output / f"track-{name}.csv"
        to = ("--connect", self.endpoint)
        recorder = self._start("record", *to, "-o", str(path), "--force")
        played = self._dehyst("play", str(trajectory), *to, "--allow-unreachable", "--json")
        self.late_share = max(
            self.late_share, played["missed_deadlines"] / max(1, played["expected_samples"])
        )
        recorder.send_signal(signal.SIGINT)
        self._wait_for(recorder, "for the recording to be written", END_S)
        recording = read_recording(path)
        self.tracks[name] = recording
        target = recording.channels["target_um"]
        return rms_error(recording, sine_part(recording.t_s, target))

    def _start(self, *arguments: str) -> subprocess.Popen[bytes]:
        child = subprocess.Popen(
            [*DEHYST, *arguments],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            env={**os.environ, "DEHYST_SUPERVISED": str(os.getpid())},
        )
        self._children.append(child)
        return child

    def _dehyst(self, *arguments: str) -> Any:
        """Run a command and return its JSON."""
        with tempfile.TemporaryFile() as said:
            child = subprocess.Popen([*DEHYST, *arguments], stdin=subprocess.DEVNULL, stdout=said)
            try:
                self._wait_for(child, f"for `dehyst {arguments[0]}`", COMMAND_S)
            finally:
                child.kill()
            if child.returncode not in (0, 1):
                raise DehystError(f"`dehyst {arguments[0]}` ended with code {child.returncode}")
            said.seek(0)
            return json.loads(said.read())

    def _wait_for(self, child: subprocess.Popen[bytes], waits: str, seconds: float) -> None:
        """Wait until the process has ended, longer on a busy machine."""
        patience = Patience(seconds, waits, self.say)
        while child.poll() is None:
            if patience.over:
                child.kill()
                raise DehystError(f"waited {patience.spent_s:.0f} s {waits}")
            clock.sleep_s(0.05)
            patience.look()

    def close(self) -> None:
        """Stop everything that was started, the bench last."""
        self._end_children()
        self._bench.close()

    def _end_children(self) -> None:
        for child in reversed(self._children):
            if child.poll() is None:
                child.terminate()
        for child in self._children:
            try:
                child.wait(30.0)
            except subprocess.TimeoutExpired:
                child.kill()
                child.wait(5.0)
        self._children.clear()


def sine_part(t_s: NDArray[np.float64], target: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return the samples of the sine after its first period, without the approach and the final
    hold."""
    moving = np.abs(np.gradient(np.nan_to_num(target), t_s)) > 1e-9
    if not moving.any():
        raise DehystError("the daemon did not follow the trajectory")
    last = float(t_s[np.flatnonzero(moving)[-1]])
    return (t_s > last - (CYCLES - 1.0)) & (t_s < last)


def rms_error(recording: Recording, part: NDArray[np.bool_]) -> float:
    """Return the rms of measured minus target over a part [um]."""
    assert recording.displacement is not None
    error = (recording.displacement - recording.channels["target_um"])[part]
    return float(np.sqrt(np.nanmean(error**2)))


def compare_errors(linear: float, compensated: float, late_share: float) -> tuple[int, str]:
    """Return (SO_IT_WAS, IT_WAS_NOT or TOO_BUSY, an explanation): whether compensation reduced the
    rms error. Late samples add to both errors: a clear success is one in spite of them."""
    late = late_share > MOST_LATE
    if late and compensated > CLEARLY_LESS * linear:
        return TOO_BUSY, (
            f"this machine was too busy to judge: {100 * late_share:.0f} % of the samples missed "
            "their deadline; run it again with less other load"
        )
    if compensated < linear:
        although = f", though {100 * late_share:.0f} % of the samples were late" if late else ""
        smaller = f"{linear / compensated:.1f} times smaller"
        return SO_IT_WAS, f"compensation makes the error {smaller}{although}"
    return IT_WAS_NOT, (
        f"compensation did not make the error smaller ({compensated / linear:.1f} times)"
    )


def join_acts(codes: Sequence[int]) -> int:
    """Return the exit status of the whole demo: a failure takes precedence over what cannot be
    judged."""
    return next((code for code in (IT_WAS_NOT, TOO_BUSY) if code in codes), SO_IT_WAS)


def draw_demo(demo: Demo, path: Path) -> None:
    """Draw target, measurement and error over time, and measured over target, as a PNG file."""
    from dehyst.daemon.report import tracking
    from dehyst.daemon.report.plotting import draw_side_by_side

    def track(name: str, label: str) -> tracking.Track:
        recording = demo.tracks[name]
        assert recording.displacement is not None
        target = recording.channels["target_um"]
        part = sine_part(recording.t_s, target)
        t_s = recording.t_s[part] - recording.t_s[part][0]
        return tracking.Track(label, t_s, target[part], recording.displacement[part])

    before, after = track("linear", "linear gain"), track("compensated", "compensated")
    draws = (
        partial(tracking.draw_displacements, before, after, "1 Hz sine over the full stroke"),
        partial(tracking.draw_tracking_error, before, after),
        partial(tracking.draw_measured_over_target, before, after),
    )
    with whole_file(path) as file:
        file.write(draw_side_by_side(draws, (1.5, 1.5, 1.0)))
